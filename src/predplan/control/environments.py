"""Many copies of a task, stepped together: positions are observed, with noise, and some observations are lost.

Actions are clipped to [-1, 1] and scaled to the actuators' range. An observation that was dropped is a row of NaN: it
repeats nothing. One that is not finite for another reason reads the same, and filters treat it so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predplan.control.bounds import check_whole
from predplan.control.physics import GymnasiumPhysics, NativePhysics, Physics
from predplan.control.tasks import BoolArray, FloatArray, IntArray, find_task, never
from predplan.errors import InputError, PredplanError


@dataclass(frozen=True)
class EnvironmentSettings:
    """Which task, and how badly it is observed."""

    task: str
    noise: float = 0.0  # standard deviation of the noise on each coordinate, in that coordinate's scale
    drop: float = 0.0  # chance that an observation, the first of an episode too, is lost
    horizon: int | None = None  # steps until an episode is cut off; None: the task's own
    scale: tuple[float, ...] | None = None  # units of the noise; None: the task's own
    threads: int = 2  # that step copies; Gymnasium's own loop has one

    def __post_init__(self) -> None:
        if not (np.isfinite(self.noise) and self.noise >= 0.0):
            raise InputError(f"noise: found {self.noise}, expected a number from 0 on")
        if not 0.0 <= self.drop < 1.0:
            raise InputError(f"drop: found {self.drop}, expected a chance from 0 to below 1")
        if self.horizon is not None:
            check_whole(self, "horizon")
        if self.scale is not None and not all(0.0 <= one < np.inf for one in self.scale):
            raise InputError(f"scale: found {self.scale}, expected finite numbers from 0 on")
        check_whole(self, "threads")
        find_task(self.task)


@dataclass(frozen=True)
class Outcome:
    """What a step of n copies brought. position is what a perfect sensor would have seen."""

    observation: FloatArray  # [n, O]; NaN where it was lost
    position: FloatArray  # [n, O] m, rad
    reward: FloatArray  # [n]
    terminated: BoolArray  # [n] the task ended the episode
    truncated: BoolArray  # [n] the horizon did


class Environments:
    """Copies of a task. A copy is reset before it is first stepped and after its episode ended."""

    def __init__(self, settings: EnvironmentSettings, copies: int, generator: np.random.Generator) -> None:
        """Each copy starts its episodes with a generator of its own, spawned from `generator`; noise has another."""
        if copies < 1:
            raise InputError(f"copies: found {copies}, expected at least 1")
        *starts, self._noise = generator.spawn(copies + 1)
        task = find_task(settings.task)
        self.physics: Physics = (
            NativePhysics(task, starts, settings.threads) if task else GymnasiumPhysics(settings.task, starts)
        )
        self.settings, self.copies = settings, copies
        self.observation_size, self.action_size = self.physics.observation_size, self.physics.action_size
        self.step_duration = self.physics.step_duration
        self.horizon = settings.horizon or self.physics.horizon
        self._all = np.arange(copies)
        self._age = np.full(copies, -1)  # steps since the reset; -1: not to be stepped
        self.in_step = task is None or task.terminated is never  # copies begin together whenever they began together
        self._spread = self._noise_spread()

    def reset(self, rows: IntArray | None = None) -> Outcome:
        """Start the copies in rows [n] (all, if None) anew. The reset is an episode's step 0, after action 0."""
        rows = self._all if rows is None else rows
        position = self.physics.reset(rows)
        self._age[rows] = 0
        ended = np.zeros(len(rows), np.bool_)
        return Outcome(self._observe(position), position, np.zeros(len(rows)), ended, ended)

    def stagger(self) -> None:
        """Count the running episodes as if they had begun at times spread evenly over the horizon."""
        self._age = self.horizon * self._all // self.copies

    def step(self, action: FloatArray, rows: IntArray | None = None) -> Outcome:
        """Step the copies in rows (all, if None) by actions [n, A], clipped to [-1, 1].

        Raises PredplanError where an action is not finite or a copy's episode has ended.
        """
        rows = self._all if rows is None else rows
        if action.shape != (len(rows), self.action_size):
            raise PredplanError(f"action: found shape {action.shape}, expected {(len(rows), self.action_size)}")
        if not np.isfinite(action).all():
            raise PredplanError(f"action: found a number that is not finite, in copy {rows[_first_bad(action)]}")
        if self._age[rows].min(initial=0) < 0:
            raise PredplanError(f"copy {rows[np.argmin(self._age[rows])]} is stepped after its episode ended")
        position, reward, terminated = self.physics.step(np.clip(action, -1.0, 1.0), rows)
        age = self._age[rows] + 1
        truncated = (age >= self.horizon) & ~terminated
        self._age[rows] = np.where(terminated | truncated, -1, age)
        return Outcome(self._observe(position), position, reward, terminated, truncated)

    def arrays(self) -> dict[str, FloatArray | IntArray]:
        """Where all copies are; with `generators`, all that is needed to go on from here."""
        return {"age": self._age.copy(), "state": self.physics.state()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from there."""
        self._age = np.array(arrays["age"], np.int64)
        self.physics.restore(np.array(arrays["state"], np.float64))

    def generators(self) -> list[np.random.Generator]:
        """All that draw: starts of each copy, then noise."""
        return [*self.physics.generators(), self._noise]

    def close(self) -> None:
        """Give threads back."""
        self.physics.close()

    def __enter__(self) -> Environments:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _noise_spread(self) -> FloatArray:
        scale = self.settings.scale or self.physics.scale
        if self.settings.noise > 0.0 and not scale:
            raise InputError(f"scale: none is known for {self.settings.task!r}; noise needs one number a coordinate")
        if scale and len(scale) != self.observation_size:
            raise InputError(f"scale: found {len(scale)} numbers, expected {self.observation_size}")
        return self.settings.noise * np.array(scale or (0.0,) * self.observation_size)

    def _observe(self, position: FloatArray) -> FloatArray:
        return degrade(position, self._spread, self.settings.drop, self._noise)


def degrade(position: FloatArray, spread: FloatArray, drop: float, generator: np.random.Generator) -> FloatArray:
    """Positions [n, O] with Gaussian noise of standard deviations spread [O]; rows lost with chance drop are NaN."""
    observation = position + spread * generator.standard_normal(position.shape) if spread.any() else position.copy()
    if drop > 0.0:
        observation[generator.random(len(position)) < drop] = np.nan
    return observation


def _first_bad(action: FloatArray) -> int:
    return int(np.argmin(np.isfinite(action).all(axis=1)))
