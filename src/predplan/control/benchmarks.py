"""How fast: MuJoCo alone, sampling with a policy, and a whole training.

Stepping and sampling take turns from the same states, so that what else the machine does slows both alike; a rate is
the median of the turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import mujoco
import numpy as np
from mujoco import rollout

from predplan.control.environments import EnvironmentSettings
from predplan.control.methods import find_method
from predplan.control.tasks import FloatArray, find_task
from predplan.control.training import Schedule, Training
from predplan.errors import InputError


@dataclass(frozen=True)
class Rate:
    """Steps of the environment, all copies counted."""

    wall: float  # a second
    cpu: float  # a second of processor time, all threads counted


@dataclass(frozen=True)
class Rates:
    """Of one task and method."""

    raw: Rate  # mujoco.rollout, a call a step
    sampling: Rate  # with the learned policy: memory, network, rewards, noise and resets
    training: Rate  # exploration, updates and refits, from the first step to the last


def rates(
    settings: EnvironmentSettings, method: str, schedule: Schedule, seed: int = 0, turns: int = 11, length: int = 64
) -> Rates:
    """Train, then step and sample by turns of `length` steps of every copy.

    Raises InputError for a task that Gymnasium's own loop steps, and as `Training`.
    """
    task = find_task(settings.task)
    if task is None:
        raise InputError(f"task: found {settings.task!r}, expected one that mujoco.rollout steps")
    training = Training(settings, find_method(method), schedule, seed)
    generator, steps = np.random.default_rng(seed), schedule.copies * length
    with training.environments:
        learned = _timed(partial(_finish, training), 1)
        learner, physics = training.learner, training.environments.physics
        alone = _Alone(task.identity, min(settings.threads, schedule.copies))
        collect = partial(training.sampler.collect, learner.network, learner.whitening, length, generator)
        raw, sampled = [], []
        for _ in range(turns):
            control = alone.drawn(length, schedule.copies, generator)
            raw.append(_timed(partial(alone.step, physics.state(), control), steps))
            sampled.append(_timed(collect, steps))
        alone.close()
    whole = Rate(learned.wall * training.steps, learned.cpu * training.steps)
    return Rates(_median(raw), _median(sampled), whole)


class _Alone:
    """MuJoCo with threads, and nothing else."""

    def __init__(self, identity: str, threads: int) -> None:
        with gymnasium.make(identity) as made:
            environment: Any = made.unwrapped
            self._model, self._frames = environment.model, int(environment.frame_skip)
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)

    def drawn(self, length: int, copies: int, generator: np.random.Generator) -> FloatArray:
        """Controls [length, copies, frames, nu] in the actuators' range."""
        low, high = self._model.actuator_ctrlrange.T
        control = generator.uniform(low, high, (length, copies, 1, self._model.nu))
        return control.repeat(self._frames, axis=2)

    def step(self, state: FloatArray, control: FloatArray) -> None:
        """From states [copies, ...], a call a step, as a policy must that acts upon what it sees."""
        for one in control:
            states, _ = self._pool.rollout(self._model, self._data, state, one)
            state = states[:, -1]

    def close(self) -> None:
        """Give the threads back."""
        self._pool.close()


def _finish(training: Training) -> None:
    while not training.done:
        training.advance()


def _timed(work: Callable[[], object], steps: int) -> Rate:
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Rate(steps / (time.perf_counter() - wall), steps / (time.process_time() - cpu))


def _median(turns: list[Rate]) -> Rate:
    return Rate(*(float(np.median([getattr(one, name) for one in turns])) for name in ("wall", "cpu")))
