"""What steps copies of a task, behind one interface: without noise, losses and horizon.

The four tasks of the thesis are stepped by `mujoco.rollout` in native threads, other MuJoCo tasks by Gymnasium's own
loop.
"""

from __future__ import annotations

from typing import Any, Protocol

import gymnasium
import mujoco
import numpy as np
from mujoco import rollout

from predplan.control.tasks import BoolArray, FloatArray, IntArray, Motion, Task


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
