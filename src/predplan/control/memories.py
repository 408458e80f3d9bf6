"""What a policy is told of an episode so far: the last observations, or a predictive state, or both.

A memory steps many copies side by side and has nothing that gradients change; a recurrent policy has a core of its
own behind it (`networks`). An observation that is missing is held at the last that was seen, and a flag says so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from predplan.control.autoregression import hold_last
from predplan.control.filtering import Filtered, FilterState, PredictiveModel
from predplan.control.tasks import FloatArray, IntArray
from predplan.control.trajectories import Trajectories, seen

Arrays = dict[str, NDArray[np.generic]]


def under(arrays: Arrays, name: str) -> Arrays:
    """Those whose names begin with name and a dot, without them."""
    return {key[len(name) + 1 :]: one for key, one in arrays.items() if key.startswith(name + ".")}


class Memory(Protocol):
    """Of n copies."""

    @property
    def size(self) -> int:
        """F, numbers that a policy is told."""

    def begin(self, rows: IntArray, observation: FloatArray) -> None:
        """Those copies start an episode and observe [len(rows), O], NaN where it was lost."""

    def observe(self, action: FloatArray, observation: FloatArray) -> None:
        """All copies did action [n, A] in [-1, 1], and observe [n, O] what came of it."""

    def features(self) -> FloatArray:
        """[n, F] of all copies."""

    def predict(self, action: FloatArray) -> FloatArray:
        """[n, O] expected of actions [n, A]; NaN where the memory expects nothing."""

    def arrays(self) -> Arrays:
        """All that is needed to go on from here."""

    def restore(self, arrays: Arrays) -> None:
        """Go on from there."""


class Window:
    """The last k observations, each with a flag whether it was seen, and the actions that led to them."""

    def __init__(self, copies: int, length: int, centre: FloatArray, actions: int) -> None:
        """centre [O] stands for what was never seen."""
        self._centre, self._actions = centre, actions
        self._rows = np.zeros((copies, length, len(centre) + 1 + actions))

    @property
    def size(self) -> int:
        """k (O + 1 + A)."""
        return int(self._rows.shape[1] * self._rows.shape[2])

    def begin(self, rows: IntArray, observation: FloatArray) -> None:
        """All k rows are the reset's, after action 0."""
        there = seen(observation)
        first = np.where(there[:, None], observation, self._centre)
        flags = np.concatenate([there[:, None], np.zeros((len(rows), self._actions))], axis=1)
        self._rows[rows] = np.concatenate([first, flags], axis=1)[:, None]

    def observe(self, action: FloatArray, observation: FloatArray) -> None:
        """Rows move up by one."""
        o, there = len(self._centre), seen(observation)
        last = np.where(there[:, None], observation, self._rows[:, -1, :o])
        self._rows[:, :-1] = self._rows[:, 1:]
        self._rows[:, -1, :o] = last
        self._rows[:, -1, o] = there
        self._rows[:, -1, o + 1 :] = action

    def features(self) -> FloatArray:
        """The rows of each copy, one after the other."""
        return self._rows.reshape(len(self._rows), -1).copy()

    def predict(self, action: FloatArray) -> FloatArray:
        """Nothing."""
        return np.full((len(action), len(self._centre)), np.nan)

    def arrays(self) -> Arrays:
        """The rows."""
        return {"window": self._rows.copy()}

    def restore(self, arrays: Arrays) -> None:
        """The rows."""
        self._rows = np.array(arrays["window"], np.float64)


class Predictive:
    """A filter's state q, and the last observations where there is a window (RPSP and RPSP+obs of §5.5.3)."""

    def __init__(self, copies: int, model: PredictiveModel, actions: int, window: Window | None = None) -> None:
        self.model, self._window, self._actions = model, window, actions
        self.state = model.initial(copies)

    @property
    def size(self) -> int:
        """p, and the window's."""
        return self.model.state_size + (self._window.size if self._window else 0)

    def begin(self, rows: IntArray, observation: FloatArray) -> None:
        """From q_0 by action 0 and the first observation: the reset is step 0."""
        start = self.model.update(self.model.initial(len(rows)), np.zeros((len(rows), self._actions)), observation)
        counted = replace(start, skipped=start.skipped + self.state.skipped[rows])
        self.state = self.state.put(rows, counted)
        if self._window:
            self._window.begin(rows, observation)

    def observe(self, action: FloatArray, observation: FloatArray) -> None:
        """One step of the filter."""
        self.state = self.model.update(self.state, action, observation)
        if self._window:
            self._window.observe(action, observation)

    def predict(self, action: FloatArray) -> FloatArray:
        """E[o | q, a] [n, O]."""
        return self.model.predict(self.state, action)

    def features(self) -> FloatArray:
        """q, then the window's."""
        if not self._window:
            return self.state.mean.copy()
        return np.concatenate([self.state.mean, self._window.features()], axis=1)

    def arrays(self) -> Arrays:
        """States and window, without the model."""
        state = self.state
        own: Arrays = {"mean": state.mean, "covariance": state.covariance, "skipped": state.skipped}
        return own | (self._window.arrays() if self._window else {})

    def restore(self, arrays: Arrays) -> None:
        """States and window."""
        mean, covariance = (np.array(arrays[name], np.float64) for name in ("mean", "covariance"))
        self.state = FilterState(mean, covariance, np.array(arrays["skipped"], np.int64))
        if self._window:
            self._window.restore(arrays)


def window_features(trajectories: Trajectories, length: int, centre: FloatArray) -> FloatArray:
    """What a Window of that length tells after each row [rows, F]."""
    held = hold_last(trajectories, centre)
    row = np.concatenate([held, trajectories.seen[:, None], trajectories.action], axis=1)
    first = np.repeat(trajectories.first[:-1], trajectories.lengths)
    lags = [np.maximum(np.arange(len(row)) - lag, first) for lag in reversed(range(length))]
    return np.concatenate([row[lag] for lag in lags], axis=1)


def predictive_features(filtered: Filtered, trajectories: Trajectories, length: int, centre: FloatArray) -> FloatArray:
    """What a Predictive memory tells after each row [rows, F]; length 0: without a window."""
    if length == 0:
        return filtered.after
    return np.concatenate([filtered.after, window_features(trajectories, length, centre)], axis=1)
