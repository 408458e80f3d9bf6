"""Gymnasium's MuJoCo tasks: what a step is worth, when an episode ends, where it starts.

Rewards and ends are those of Gymnasium 1.4's version 5 tasks with their default settings, as functions of many copies
at once; a test compares them with Gymnasium's own, step by step. A task without such functions here is stepped by
Gymnasium itself (see `environments`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from predplan.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class Motion:
    """One step of n copies: positions before it, positions and velocities after it, and the controls that moved them.

    Units are MuJoCo's: m, rad, s; control is in the actuators' own range.
    """

    before: FloatArray  # [n, nq]
    position: FloatArray  # [n, nq]
    velocity: FloatArray  # [n, nv]
    control: FloatArray  # [n, nu]
    duration: float  # s


@dataclass(frozen=True)
class Task:
    """What our batched stepping has to know of a task. Episodes start uniformly within `spread` of the model's own."""

    identity: str  # Gymnasium's
    horizon: int  # steps until an episode is cut off, as in the thesis
    hidden: int  # leading positions that are not observed: where the body is in the world
    spread: float  # of the start, in positions (m, rad) and velocities (m/s, rad/s)
    scale: tuple[float, ...]  # standard deviation of what is observed while exploring: the unit of observation noise
    reward: Callable[[Motion, BoolArray], FloatArray]  # motion, terminated [n] -> [n]
    terminated: Callable[[Motion], BoolArray]


def pole_has_fallen(motion: Motion) -> BoolArray:
    """The pole leans by more than .2 rad."""
    finite = np.isfinite(motion.position).all(axis=1) & np.isfinite(motion.velocity).all(axis=1)
    fallen: BoolArray = ~finite | (np.abs(motion.position[:, 1]) > 0.2)
    return fallen


def hopper_has_fallen(motion: Motion) -> BoolArray:
    """The torso is below .7 m or leans by .2 rad, or a number beyond the first two is 100 or more."""
    height, angle = motion.position[:, 1], motion.position[:, 2]
    rest = np.concatenate([motion.position[:, 2:], motion.velocity], axis=1)
    healthy = (np.abs(rest) < 100.0).all(axis=1) & (height > 0.7) & (height < np.inf) & (np.abs(angle) < 0.2)
    return np.asarray(~healthy)


def walker_has_fallen(motion: Motion) -> BoolArray:
    """The torso is not between .8 and 2 m or leans by 1 rad."""
    height, angle = motion.position[:, 1], motion.position[:, 2]
    fallen: BoolArray = ~((height > 0.8) & (height < 2.0) & (np.abs(angle) < 1.0))
    return fallen


def never(motion: Motion) -> BoolArray:
    """No state ends an episode."""
    return np.zeros(len(motion.position), np.bool_)


def survival(motion: Motion, terminated: BoolArray) -> FloatArray:
    """1 a step."""
    return (~terminated).astype(np.float64)


def forward(effort: float, alive: float) -> Callable[[Motion, BoolArray], FloatArray]:
    """Velocity of the first coordinate (m/s) + alive, if it is - effort |control|²."""

    def reward(motion: Motion, terminated: BoolArray) -> FloatArray:
        speed = (motion.position[:, 0] - motion.before[:, 0]) / motion.duration
        value: FloatArray = speed + alive * ~terminated - effort * np.sum(motion.control**2, axis=1)
        return value

    return reward


# Scales: measured by `exploration.measure_scale` with seed 0; 50 trajectories for Swimmer, 200 for the others.
TASKS = {
    "cartpole": Task("InvertedPendulum-v5", 200, 0, 0.01, (0.0645, 0.112), survival, pole_has_fallen),
    "swimmer": Task("Swimmer-v5", 500, 2, 0.1, (0.73, 1.15, 1.16), forward(1e-4, 0.0), never),
    "hopper": Task(
        "Hopper-v5", 1000, 1, 5e-3, (0.0224, 0.0719, 0.0754, 0.112, 0.207), forward(1e-3, 1.0), hopper_has_fallen
    ),
    "walker2d": Task(
        "Walker2d-v5",
        1000,
        1,
        5e-3,
        (0.0711, 0.319, 0.258, 0.522, 0.446, 0.277, 0.511, 0.439),
        forward(1e-3, 1.0),
        walker_has_fallen,
    ),
}


def find_task(name: str) -> Task | None:
    """The task of that name or of that Gymnasium id; None for another of Gymnasium's MuJoCo tasks.

    Raises InputError where there is no such task.
    """
    for short, task in TASKS.items():
        if name in (short, task.identity):
            return task
    if name in other_tasks():
        return None
    tasks = ", ".join([*TASKS, *other_tasks()])
    raise InputError(f"task: found {name!r}, expected one of MuJoCo's, whose actions are continuous: {tasks}")


def other_tasks() -> tuple[str, ...]:
    """Ids of Gymnasium's remaining MuJoCo tasks of version 5."""
    from gymnasium import registry

    own = {task.identity for task in TASKS.values()}
    return tuple(
        sorted(
            identity
            for identity, spec in registry.items()
            if str(spec.entry_point).startswith("gymnasium.envs.mujoco") and spec.version == 5 and identity not in own
        )
    )
