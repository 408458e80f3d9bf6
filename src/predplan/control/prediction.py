"""How well observations are foretold: errors on held-out trajectories, one step ahead and several.

An error is the mean square difference to what was really there, each coordinate over its variance in the exploration:
1 is the error of the mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.control.filtering import FilterState, PredictiveModel, filter_trajectories
from predplan.control.tasks import BoolArray, FloatArray
from predplan.control.trajectories import Trajectories


@dataclass(frozen=True)
class PredictionError:
    """Of one predictor."""

    predictor: str
    steps: int  # ahead
    error: float  # share of the exploration's variance
    rows: int  # compared


def normalised_error(prediction: FloatArray, truth: FloatArray, rows: BoolArray, variance: FloatArray) -> float:
    """Mean over rows and coordinates of (prediction - truth)² / variance. [n, O], rows [n], variance [O]."""
    return float(np.mean((prediction[rows] - truth[rows]) ** 2 / variance))


def predict_ahead(model: PredictiveModel, trajectories: Trajectories, ahead: int) -> FloatArray:
    """Predictions [n, O] of each row from what came up to `ahead` rows before it; NaN in a trajectory's first rows."""
    if ahead == 1:
        return filter_trajectories(model, trajectories).prediction
    result = np.full_like(trajectories.observation, np.nan)
    last = int(trajectories.lengths.max())
    state = model.initial(len(trajectories.lengths))
    first, lengths = trajectories.first[:-1], trajectories.lengths
    nothing = np.full((len(lengths), model.observation_size), np.nan)
    for step in range(last - ahead + 1):
        rolled: FilterState = state
        for extra in range(ahead):
            rows = np.minimum(first + step + extra, trajectories.first[1:] - 1)
            if extra < ahead - 1:
                rolled = model.update(rolled, trajectories.action[rows], nothing)
        there = lengths > step + ahead - 1
        result[rows[there]] = model.predict(rolled, trajectories.action[rows])[there]
        rows = np.minimum(first + step, trajectories.first[1:] - 1)
        state = model.update(state, trajectories.action[rows], trajectories.observation[rows])
    return result
