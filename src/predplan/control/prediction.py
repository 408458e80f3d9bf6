"""How well observations are foretold: errors on held-out trajectories, one step ahead and several.

An error is the mean square difference to what was really there, each coordinate over its variance in the exploration:
1 is the error of the mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.control.autoregression import fit_autoregression, hold_last, predict_next, standardise, window_moments
from predplan.control.filtering import FilterState, PredictiveModel, filter_trajectories
from predplan.control.tasks import BoolArray, FloatArray
from predplan.control.trajectories import Trajectories

ORDERS = (1, 2, 5, 10, 20)


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


def filter_errors(
    name: str,
    model: PredictiveModel,
    held_out: Trajectories,
    truth: FloatArray,
    variance: FloatArray,
    steps: tuple[int, ...] = (1,),
    least_age: int = 10,
) -> list[PredictionError]:
    """Errors of a filter on trajectories that it was not learned from, at rows of at least that age.

    truth [n, O] is what a perfect sensor would have seen. Several steps ahead, the actions between are known.
    """
    errors = []
    for ahead in steps:
        prediction = predict_ahead(model, held_out, ahead)
        rows = (held_out.age >= least_age) & np.isfinite(prediction).all(axis=1)
        error = normalised_error(prediction, truth, rows, variance)
        errors.append(PredictionError(name, ahead, error, int(rows.sum())))
    return errors


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


def baseline_errors(
    training: Trajectories,
    held_out: Trajectories,
    truth: FloatArray,
    variance: FloatArray,
    orders: tuple[int, ...] = ORDERS,
    lam: float = 1e-8,
    least_age: int = 10,
) -> list[PredictionError]:
    """One step ahead: the last observation, and linear autoregressions with actions of several orders.

    Missing observations are held at the last that was seen, in learning as in prediction.
    """
    standard = standardise(training)
    rows = held_out.age >= least_age
    held = hold_last(held_out, standard.shift)
    last = np.concatenate([held[:1], held[:-1]])
    errors = [PredictionError("last", 1, normalised_error(last, truth, rows, variance), int(rows.sum()))]
    filled = training.with_observation(hold_last(training, standard.shift))
    for order in orders:
        if order >= training.lengths.max():
            continue
        model = fit_autoregression(*window_moments(filled, order, standard), standard, lam)
        prediction = predict_next(model, held_out)
        there = rows & np.isfinite(prediction).all(axis=1)
        error = normalised_error(prediction, truth, there, variance)
        errors.append(PredictionError(f"order {order}", 1, error, int(there.sum())))
    return errors
