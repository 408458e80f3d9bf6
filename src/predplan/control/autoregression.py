"""Linear autoregression with actions: what stage 1 rests on, and the plainest predictor to compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.control.moments import Moments, ridge, second_moments
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories
from predplan.control.windows import window_rows


@dataclass(frozen=True)
class Standard:
    """Units in which observations have mean 0 and variance 1."""

    shift: FloatArray  # [O]
    scale: FloatArray  # [O]

    def __call__(self, observation: FloatArray) -> FloatArray:
        """Of observations [..., O]."""
        scaled: FloatArray = (observation - self.shift) / self.scale
        return scaled


def standardise(trajectories: Trajectories) -> Standard:
    """From what was seen; what never changes keeps its unit."""
    seen = trajectories.observation[trajectories.seen]
    scale = seen.std(axis=0)
    return Standard(seen.mean(axis=0), np.where(scale > 1e-12, scale, 1.0))


@dataclass(frozen=True)
class Layout:
    """Where things are in an extended window: observations of t - P to t, then actions of the same."""

    past: int  # P
    observations: int  # O
    actions: int  # A

    @property
    def size(self) -> int:
        """(P + 1) (O + A)."""
        return (self.past + 1) * (self.observations + self.actions)

    @property
    def before(self) -> FloatArray:
        """Selection [P (O + A), size] of the window that ends before t."""
        return self._pick(0)

    @property
    def through(self) -> FloatArray:
        """Selection [P (O + A), size] of the window that ends with t."""
        return self._pick(1)

    @property
    def observation(self) -> FloatArray:
        """Selection [O, size] of o_t."""
        start = self.past * self.observations
        return np.eye(self.size)[start : start + self.observations]

    @property
    def action(self) -> FloatArray:
        """Selection [A, size] of a_t."""
        return np.eye(self.size)[self.size - self.actions :]

    def _pick(self, later: int) -> FloatArray:
        start = (self.past + 1) * self.observations
        seen = np.arange(self.past * self.observations) + later * self.observations
        done = np.arange(self.past * self.actions) + start + later * self.actions
        chosen: FloatArray = np.eye(self.size)[np.concatenate([seen, done])]
        return chosen


def window_moments(
    trajectories: Trajectories, past: int, standard: Standard, iterations: int = 100, known: Moments | None = None
) -> tuple[Layout, Moments]:
    """Second moments of all extended windows, of standardised observations; missing ones are allowed for.

    iterations, known: as in `moments.second_moments`.
    """
    rows = window_rows(trajectories, past, 0)[:, None] + np.arange(-past, 1)
    observation, action = standard(trajectories.observation[rows]), trajectories.action[rows]
    layout = Layout(past, observation.shape[2], action.shape[2])
    vectors = np.concatenate([observation.reshape(len(rows), -1), action.reshape(len(rows), -1)], axis=1)
    return layout, second_moments(vectors, iterations, known=known)


@dataclass(frozen=True)
class Autoregression:
    """o_t = past · (window before t) + action · a_t + constant, standardised."""

    layout: Layout
    standard: Standard
    past: FloatArray  # [O, P (O + A)]
    action: FloatArray  # [O, A]
    constant: FloatArray  # [O]


def fit_autoregression(layout: Layout, moments: Moments, standard: Standard, lam: float) -> Autoregression:
    """Ridge regression of o_t on the window before it and a_t; lam as in `moments.ridge`."""
    inputs = np.concatenate([layout.before, layout.action])
    chosen = moments.mapped(np.concatenate([inputs, layout.observation]))
    width = len(inputs)
    weights = ridge(chosen, slice(0, width), slice(width, None), lam)
    constant = chosen.mean[width:] - weights @ chosen.mean[:width]
    split = width - layout.actions
    return Autoregression(layout, standard, weights[:, :split], weights[:, split:], constant)


def residual_covariance(model: Autoregression, moments: Moments) -> FloatArray:
    """Covariance [O, O] of standardised observations less what is predicted, from the windows' moments."""
    layout = model.layout
    error = layout.observation - model.past @ layout.before - model.action @ layout.action
    covariance: FloatArray = moments.mapped(error).covariance
    return 0.5 * (covariance + covariance.T)


def predict_next(model: Autoregression, trajectories: Trajectories, ahead: int = 1) -> FloatArray:
    """Predictions [n, O] of each row from what came up to `ahead` rows before it, in the task's units.

    NaN where the window does not fit. What was not seen is taken to be as it was last seen; before anything was, to
    be the mean. Several steps ahead predictions stand for what was not yet seen, and the actions between are known.
    """
    layout, result = model.layout, np.full_like(trajectories.observation, np.nan)
    rows = window_rows(trajectories, layout.past, ahead - 1)
    before = rows[:, None] + np.arange(-layout.past, 0)
    seen, done = model.standard(hold_last(trajectories, model.standard.shift))[before], trajectories.action[before]
    scaled = np.empty((len(rows), layout.observations))
    for step in range(ahead):
        action = trajectories.action[rows + step]
        window = np.concatenate([seen.reshape(len(rows), -1), done.reshape(len(rows), -1)], axis=1)
        scaled = window @ model.past.T + action @ model.action.T + model.constant
        seen = np.concatenate([seen[:, 1:], scaled[:, None]], axis=1)
        done = np.concatenate([done[:, 1:], action[:, None]], axis=1)
    result[rows + ahead - 1] = scaled * model.standard.scale + model.standard.shift
    return result


def hold_last(trajectories: Trajectories, otherwise: FloatArray) -> FloatArray:
    """Observations [n, O] with the last that was seen in place of each missing one, `otherwise` [O] before it."""
    seen, n = trajectories.seen, len(trajectories.observation)
    source = np.where(seen, np.arange(n), -1)
    source = np.maximum.accumulate(source)
    start = np.repeat(trajectories.first[:-1], trajectories.lengths)
    known = source >= start
    filled: FloatArray = np.where(known[:, None], trajectories.observation[np.maximum(source, 0)], otherwise)
    return filled
