"""Trajectories as flat arrays, one after the other, and as steps of a recording.

Time within a trajectory: row t holds the action a_t and the observation o_t that it led to. Row 0 is the reset, with
a_0 = 0, in acting and in learning alike (the thesis leaves a_0 open, and Algorithm 8 acts after o_t).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from predplan.artifacts.recordings import Steps
from predplan.control.tasks import BoolArray, FloatArray, IntArray
from predplan.errors import InputError


def seen(observation: FloatArray) -> BoolArray:
    """[n] whether rows [n, O] were seen: all of their numbers are finite."""
    return np.asarray(np.isfinite(observation).all(axis=1))


@dataclass(frozen=True)
class Trajectories:
    """E trajectories in n rows; trajectory e is rows first[e] to first[e + 1]."""

    observation: FloatArray  # [n, O]; a row that is not finite was not seen
    action: FloatArray  # [n, A] in [-1, 1]
    reward: FloatArray  # [n]; 0 in row 0 of a trajectory
    terminated: BoolArray  # [n] the task ended the trajectory here
    truncated: BoolArray  # [n] the horizon did
    first: IntArray  # [E + 1]

    def __post_init__(self) -> None:
        n = len(self.observation)
        for name in ("action", "reward", "terminated", "truncated"):
            if len(getattr(self, name)) != n:
                raise InputError(f"{name}: found {len(getattr(self, name))} rows, expected {n} as of observations")
        if self.first[0] != 0 or self.first[-1] != n or np.any(np.diff(self.first) < 1):
            raise InputError(f"first: expected to rise from 0 to {n}")

    @property
    def seen(self) -> BoolArray:
        """[n] whether the observation is there."""
        return seen(self.observation)

    @property
    def lengths(self) -> IntArray:
        """[E] rows of each trajectory."""
        return np.diff(self.first)

    @property
    def age(self) -> IntArray:
        """[n] rows since the trajectory's first."""
        return np.arange(len(self.observation)) - np.repeat(self.first[:-1], self.lengths)

    def take(self, which: IntArray) -> Trajectories:
        """Those trajectories, in that order."""
        rows = np.concatenate([np.arange(self.first[e], self.first[e + 1]) for e in which])
        arrays = {field.name: getattr(self, field.name)[rows] for field in fields(self) if field.name != "first"}
        return Trajectories(**arrays, first=np.concatenate([[0], np.cumsum(self.lengths[which])]))

    def padded(self, rows: int) -> Trajectories:
        """The same with each trajectory's first row `rows` times more before it: at rest, as it will start."""
        index = np.concatenate(
            [
                np.concatenate([np.full(rows, start), np.arange(start, end)])
                for start, end in zip(self.first[:-1], self.first[1:], strict=True)
            ]
        )
        arrays = {field.name: getattr(self, field.name)[index] for field in fields(self) if field.name != "first"}
        return Trajectories(**arrays, first=self.first + rows * np.arange(len(self.first)))

    def with_observation(self, observation: FloatArray) -> Trajectories:
        """The same trajectories, otherwise observed."""
        return replace(self, observation=observation)


def join(parts: list[Trajectories]) -> Trajectories:
    """All trajectories of the parts, in order."""
    arrays = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Trajectories)
        if field.name != "first"
    }
    lengths = np.concatenate([part.lengths for part in parts])
    return Trajectories(**arrays, first=np.concatenate([[0], np.cumsum(lengths)]))


def to_steps(
    trajectories: Trajectories,
    step_duration: float,
    state: FloatArray | None = None,
    prediction: FloatArray | None = None,
) -> Steps:
    """Steps of a recording, on one clock (s). state [n, S] and prediction [n, P] are kept where they are given.

    A step pairs an observation with the action done upon it and what came of that, so actions, rewards and ends move
    up by a row; the last row of an episode has action 0 and holds the last observation.
    """
    n = len(trajectories.observation)
    ahead = np.minimum(np.arange(n) + 1, n - 1)
    last = np.zeros(n, np.bool_)
    last[trajectories.first[1:] - 1] = True
    nothing = np.empty((n, 0))
    return Steps(
        times=np.arange(n, dtype=np.float64) * step_duration,
        episode=np.repeat(np.arange(len(trajectories.lengths)), trajectories.lengths),
        observation=np.where(trajectories.seen[:, None], trajectories.observation, np.nan),
        action=np.where(last[:, None], 0.0, trajectories.action[ahead]),
        reward=np.where(last, 0.0, trajectories.reward[ahead]),
        terminated=trajectories.terminated[ahead] & ~last,
        truncated=trajectories.truncated[ahead] & ~last,
        state=nothing if state is None else state,
        prediction=nothing if prediction is None else prediction,
    )


def from_steps(steps: Steps) -> Trajectories:
    """The trajectories that `to_steps` wrote. Raises InputError where there are none or episodes are mixed up."""
    n = len(steps.times)
    change = np.diff(steps.episode)
    if n == 0 or np.any((change != 0) & (change != 1)):
        raise InputError(f"steps: found {n} rows, expected episodes one after the other, numbered in order")
    first = np.concatenate([[0], np.flatnonzero(change) + 1, [n]])
    start = np.zeros(n, np.bool_)
    start[first[:-1]] = True
    behind = np.maximum(np.arange(n) - 1, 0)
    return Trajectories(
        observation=steps.observation,
        action=np.where(start[:, None], 0.0, steps.action[behind]),
        reward=np.where(start, 0.0, steps.reward[behind]),
        terminated=steps.terminated[behind] & ~start,
        truncated=steps.truncated[behind] & ~start,
        first=first,
    )
