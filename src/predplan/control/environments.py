"""Many copies of a task, stepped together: positions are observed, with noise, and some observations are lost.

Actions are clipped to [-1, 1] and scaled to the actuators' range. An observation that was dropped is a row of NaN: it
repeats nothing. One that is not finite for another reason reads the same, and filters treat it so.

The four tasks of the thesis are stepped by `mujoco.rollout` in native threads, other MuJoCo tasks by Gymnasium's own
loop behind the same interface.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol

import gymnasium
import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from predplan.control.bounds import check_whole
from predplan.control.tasks import BoolArray, FloatArray, IntArray, Motion, Task, find_task
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


class Physics(Protocol):
    """Copies without noise, losses and horizon, with observed positions [n, O] and actions [n, A] in [-1, 1]."""

    observation_size: int
    action_size: int
    horizon: int
    step_duration: float  # s
    scale: tuple[float, ...]  # [O], or empty where it is not known

    def reset(self, rows: IntArray) -> FloatArray:
        """Start those copies anew: their positions [len(rows), O]."""

    def step(self, action: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Step those copies: positions, rewards, terminated."""

    def state(self) -> FloatArray:
        """Of all copies, a row each."""

    def restore(self, state: FloatArray) -> None:
        """Go on from there."""

    def generators(self) -> list[np.random.Generator]:
        """Of each copy."""

    def close(self) -> None:
        """Give threads and windows back."""


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
        self._spread = self._noise_spread()

    def reset(self, rows: IntArray | None = None) -> Outcome:
        """Start the copies in rows [n] (all, if None) anew. The reset is an episode's step 0, after action 0."""
        rows = self._all if rows is None else rows
        position = self.physics.reset(rows)
        self._age[rows] = 0
        ended = np.zeros(len(rows), np.bool_)
        return Outcome(self._observe(position), position, np.zeros(len(rows)), ended, ended)

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


class NativePhysics:
    """Copies stepped by mujoco.rollout: every call steps all given copies in native threads."""

    def __init__(self, task: Task, starts: list[np.random.Generator], threads: int) -> None:
        with gymnasium.make(task.identity) as made:
            environment: Any = made.unwrapped
            self._model, self._frames = environment.model, int(environment.frame_skip)
            self._start = np.concatenate([environment.init_qpos, environment.init_qvel])
        model = self._model
        self._task, self._starts = task, starts
        self._position = slice(1, 1 + model.nq)
        self._velocity = slice(1 + model.nq, 1 + model.nq + model.nv)
        self._low, self._high = model.actuator_ctrlrange.T.copy()
        # MuJoCo's whole state, time first; without actuator states, as in these tasks, no more than velocities follow.
        self._state = np.zeros((len(starts), mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        threads = min(threads, len(starts))
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        # One thread is this one: a pool would only add waiting.
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        self.observation_size, self.action_size = model.nq - task.hidden, model.nu
        self.horizon, self.scale = task.horizon, task.scale
        self.step_duration = float(model.opt.timestep) * self._frames

    def reset(self, rows: IntArray) -> FloatArray:
        """Draws positions, then velocities, from the copy's own generator, as Gymnasium does."""
        spread, nq = self._task.spread, self._model.nq
        for row in rows:
            generator = self._starts[row]
            self._state[row] = 0.0
            self._state[row, 1 : 1 + len(self._start)] = self._start
            self._state[row, self._position] += generator.uniform(-spread, spread, nq)
            self._state[row, self._velocity] += generator.uniform(-spread, spread, self._model.nv)
        return self._observed(self._state[rows])

    def step(self, action: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Solvers start cold at each step, where Gymnasium's start from the last; they agree to 1e-9."""
        control = self._low + 0.5 * (action + 1.0) * (self._high - self._low)
        before = self._state[rows]
        held = np.repeat(control[:, None], self._frames, axis=1)
        states, _ = self._pool.rollout(self._model, self._data, before, held)
        after = states[:, -1]
        self._state[rows] = after
        motion = Motion(
            before[:, self._position], after[:, self._position], after[:, self._velocity], control, self.step_duration
        )
        terminated = self._task.terminated(motion)
        return self._observed(after), self._task.reward(motion, terminated), terminated

    def state(self) -> FloatArray:
        """MuJoCo's full physics."""
        return self._state.copy()

    def restore(self, state: FloatArray) -> None:
        """MuJoCo's full physics."""
        self._state = state.copy()

    def generators(self) -> list[np.random.Generator]:
        """Of each copy."""
        return self._starts

    def close(self) -> None:
        """Give the threads back."""
        self._pool.close()

    def _observed(self, state: FloatArray) -> FloatArray:
        return state[:, self._position][:, self._task.hidden :].copy()


class GymnasiumPhysics:
    """Copies stepped one after the other by Gymnasium: any of its MuJoCo tasks, at its speed."""

    def __init__(self, identity: str, starts: list[np.random.Generator]) -> None:
        self._copies: list[Any] = [gymnasium.make(identity).unwrapped for _ in starts]
        for copy, generator in zip(self._copies, starts, strict=True):
            copy.np_random = generator
        first = self._copies[0]
        self._low, self._high = first.model.actuator_ctrlrange.T.copy()
        self._hidden = int(getattr(first, "observation_structure", {}).get("skipped_qpos", 0))
        self.observation_size, self.action_size = first.model.nq - self._hidden, first.model.nu
        self.horizon = int(gymnasium.spec(identity).max_episode_steps or 1000)
        self.step_duration = float(first.dt)
        self.scale: tuple[float, ...] = ()

    def reset(self, rows: IntArray) -> FloatArray:
        """Gymnasium's own reset, with the copy's own generator."""
        for row in rows:
            self._copies[row].reset()
        return self._observed(rows)

    def step(self, action: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Gymnasium's own step."""
        control = self._low + 0.5 * (action + 1.0) * (self._high - self._low)
        outcomes = [self._copies[row].step(one) for row, one in zip(rows, control, strict=True)]
        reward = np.array([float(outcome[1]) for outcome in outcomes])
        return self._observed(rows), reward, np.array([bool(outcome[2]) for outcome in outcomes])

    def state(self) -> FloatArray:
        """What MuJoCo integrates."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        states = np.zeros((len(self._copies), mujoco.mj_stateSize(self._copies[0].model, kind)))
        for row, copy in zip(states, self._copies, strict=True):
            mujoco.mj_getState(copy.model, copy.data, row, kind)
        return states

    def restore(self, state: FloatArray) -> None:
        """What follows from the state is computed anew, and leaves it as it was."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        for row, copy in zip(state, self._copies, strict=True):
            mujoco.mj_setState(copy.model, copy.data, row, kind)
            mujoco.mj_forward(copy.model, copy.data)
            mujoco.mj_setState(copy.model, copy.data, row, kind)

    def generators(self) -> list[np.random.Generator]:
        """Of each copy."""
        return [copy.np_random for copy in self._copies]

    def close(self) -> None:
        """Close Gymnasium's environments."""
        for copy in self._copies:
            copy.close()

    def _observed(self, rows: IntArray) -> FloatArray:
        return np.array([self._copies[row].data.qpos[self._hidden :] for row in rows])


def _first_bad(action: FloatArray) -> int:
    return int(np.argmin(np.isfinite(action).all(axis=1)))
