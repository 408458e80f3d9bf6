"""A nonlinear correction of what a linear filter predicts: its state keeps more than its prediction makes use of.

    ô = C q + D a + d + W φ(q, a),    φ = 1, cos and sin of random frequencies

by ridge regression of the filter's errors. States stay as they were, linear and safe; φ is bounded, and so is what it
adds, wherever states go. Bandwidth and ridge are those that help most on trajectories held out, or none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from predplan.control.bounds import check_number, check_whole
from predplan.control.features import fourier, squared_bandwidth
from predplan.control.filtering import FilterState, filter_trajectories
from predplan.control.linear_filter import LinearFilter
from predplan.control.refinement import hold_out
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError


@dataclass(frozen=True)
class CorrectionSettings:
    """What is tried."""

    frequencies: int = 400
    widths: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)  # squared bandwidths, in medians of squared distances
    lams: tuple[float, ...] = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # of the ridge; φ has mean square 1/2
    share: float = 0.2  # of trajectories, held out
    least_age: int = 3  # of the rows that are learned from; before it the start is not settled

    def __post_init__(self) -> None:
        check_whole(self, "frequencies")
        check_whole(self, "least_age", least=0)
        check_number(self, "share", above=0, below=1)
        for name in ("widths", "lams"):
            values = getattr(self, name)
            if not (values and all(0.0 < value < np.inf for value in values)):
                raise InputError(f"{name}: found {values}, expected finite numbers above 0, one at least")


@dataclass(frozen=True)
class CorrectedFilter:
    """A linear filter that predicts with a correction. It is there to be compared: files (`models`) do not take it."""

    linear: LinearFilter
    shift: FloatArray  # [p + A] of (q, a)
    scale: FloatArray  # [p + A]
    frequencies: FloatArray  # [p + A, f]
    weights: FloatArray  # [1 + 2 f, O], for standardised observations

    @property
    def state_size(self) -> int:
        """p."""
        return self.linear.state_size

    @property
    def observation_size(self) -> int:
        """O."""
        return self.linear.observation_size

    def initial(self, copies: int) -> FilterState:
        """The linear filter's."""
        return self.linear.initial(copies)

    def update(self, state: FilterState, action: FloatArray, observation: FloatArray) -> FilterState:
        """The linear filter's."""
        return self.linear.update(state, action, observation)

    def predict(self, state: FilterState, action: FloatArray) -> FloatArray:
        """The linear filter's, corrected."""
        points = (np.concatenate([state.mean, action], axis=1) - self.shift) / self.scale
        corrected: FloatArray = features(points, self.frequencies) @ self.weights * self.linear.scale
        return self.linear.predict(state, action) + corrected


def features(points: FloatArray, frequencies: FloatArray) -> FloatArray:
    """1, and cosines and sines between -1 and 1: [n, d], [d, f] -> [n, 1 + 2 f]."""
    waves = fourier(points, frequencies) * np.sqrt(frequencies.shape[1])
    return np.concatenate([np.ones((len(points), 1)), waves], axis=1)


def fit_correction(
    model: LinearFilter, trajectories: Trajectories, settings: CorrectionSettings, generator: np.random.Generator
) -> CorrectedFilter:
    """Learn the correction; it is 0 if nothing helps on what is held out. Raises InputError as `hold_out`."""
    training, held_out = hold_out(trajectories, settings.share, generator)
    (inputs, errors), judged = (_samples(model, one, settings.least_age) for one in (training, held_out))
    shift, scale = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), 1e-9)
    drawn = generator.standard_normal((inputs.shape[1], settings.frequencies))
    points, judging = (inputs - shift) / scale, (judged[0] - shift) / scale
    median = squared_bandwidth(points, 50.0, generator)
    lowest, chosen = float(np.mean(judged[1] ** 2)), None
    for width in settings.widths:
        frequencies = drawn / np.sqrt(width * median)
        phi, solve = features(judging, frequencies), _ridge(features(points, frequencies), errors)
        for lam in settings.lams:
            error = float(np.mean((judged[1] - phi @ solve(lam)) ** 2))
            if error < lowest:
                lowest, chosen = error, (frequencies, lam)
    if chosen is None:
        nothing = np.zeros((1 + 2 * settings.frequencies, model.observation_size))
        return CorrectedFilter(model, shift, scale, drawn, nothing)
    frequencies, lam = chosen
    inputs, errors = _samples(model, trajectories, settings.least_age)
    weights = _ridge(features((inputs - shift) / scale, frequencies), errors)(lam)
    return CorrectedFilter(model, shift, scale, frequencies, weights)


def _samples(model: LinearFilter, trajectories: Trajectories, least_age: int) -> tuple[FloatArray, FloatArray]:
    """(q, a) [m, p + A] and the errors [m, O] of standardised predictions, where something was seen."""
    filtered = filter_trajectories(model, trajectories)
    rows = trajectories.seen & (trajectories.age >= least_age)
    if not rows.any():
        raise InputError(f"trajectories: no observation {least_age} rows or more after a start")
    errors = (trajectories.observation[rows] - filtered.prediction[rows]) / model.scale
    return np.concatenate([filtered.state[rows], trajectories.action[rows]], axis=1), errors


def _ridge(inputs: FloatArray, outputs: FloatArray) -> Callable[[float], FloatArray]:
    """Coefficients [d, O] of outputs [m, O] on inputs [m, d] as a function of the ridge: one decomposition for all."""
    values, vectors = np.linalg.eigh(inputs.T @ inputs / len(inputs))
    turned = vectors.T @ (inputs.T @ outputs / len(inputs))
    return lambda lam: vectors @ (turned / (np.maximum(values, 0.0) + lam)[:, None])
