"""Exploration: blind Gaussian actions, from which a first filter is learned.

Blind actions do not depend on what is observed, so exploration is recorded as it was, and noise and losses can be
added to it afterwards (`degraded`) with the same effect as while it was recorded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.control.bounds import check_whole
from predplan.control.environments import Environments, EnvironmentSettings, degrade
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError, PredplanError

ATTEMPTS = 1000
"""Episodes tried for each one wanted, before a least length is given up: 1 in 40 of CartPole's reaches 12 steps."""


@dataclass(frozen=True)
class ExplorationSettings:
    """How much to explore."""

    trajectories: int = 100  # how many are kept
    least_length: int = 12  # steps a trajectory must have to be kept
    horizon: int | None = None  # steps at most; None: the environment's own

    def __post_init__(self) -> None:
        check_whole(self, "trajectories", "least_length")
        if self.horizon is not None:
            check_whole(self, "horizon")


@dataclass(frozen=True)
class Exploration:
    """What was found, and the steps it took, those of trajectories that were too short included."""

    trajectories: Trajectories
    steps: int


def explore(environments: Environments, settings: ExplorationSettings, generator: np.random.Generator) -> Exploration:
    """Trajectories of actions N(0, I), which the environment clips to [-1, 1], of at least the length wanted.

    Copies run side by side; every episode that was begun is finished, and the trajectories are those first begun, so
    that short ones are not favoured. Raises PredplanError if the length is not reached in ATTEMPTS times as many
    episodes as are wanted.
    """
    horizon = min(settings.horizon or environments.horizon, environments.horizon)
    if settings.least_length > horizon:
        raise InputError(f"least_length: found {settings.least_length}, expected at most the horizon, {horizon}")
    kept: list[_Episodes] = []
    count = steps = episodes = 0
    while count < settings.trajectories:
        if episodes >= ATTEMPTS * settings.trajectories:
            raise PredplanError(
                f"{environments.settings.task}: {count} of {episodes} exploring episodes reached "
                f"{settings.least_length} steps, {settings.trajectories} are wanted; lower least_length"
            )
        batch = _round(environments, horizon, generator)
        episodes += environments.copies
        steps += int(batch.lengths.sum())
        long = np.flatnonzero(batch.lengths >= settings.least_length)[: settings.trajectories - count]
        kept.append(batch.take(long))
        count += len(long)
    return Exploration(_flat(kept), steps)


def degraded(
    trajectories: Trajectories, noise: float, drop: float, scale: FloatArray, generator: np.random.Generator
) -> Trajectories:
    """The same trajectories, observed with noise of `noise` times scale [O], and a share `drop` of them lost."""
    EnvironmentSettings("cartpole", noise, drop)  # the same bounds, the same message
    return trajectories.with_observation(degrade(trajectories.observation, noise * scale, drop, generator))


def measure_scale(task: str, generator: np.random.Generator, trajectories: int = 200) -> tuple[float, ...]:
    """Standard deviation of each observed position (m, rad) while exploring: the unit of observation noise."""
    least = {"cartpole": 12, "hopper": 22, "walker2d": 22}.get(task, 1)
    with Environments(EnvironmentSettings(task), min(trajectories, 50), generator) as environments:
        found = explore(environments, ExplorationSettings(trajectories, least), generator)
    return tuple(float(one) for one in found.trajectories.observation.std(axis=0))


@dataclass(frozen=True)
class _Episodes:
    """One episode of each copy, padded: row 0 is the reset."""

    observation: FloatArray  # [T + 1, n, O]
    action: FloatArray  # [T + 1, n, A]
    reward: FloatArray  # [T + 1, n]
    terminated: np.ndarray  # [n]
    lengths: np.ndarray  # [n] steps

    def take(self, which: np.ndarray) -> _Episodes:
        return _Episodes(
            self.observation[:, which],
            self.action[:, which],
            self.reward[:, which],
            self.terminated[which],
            self.lengths[which],
        )


def _round(environments: Environments, horizon: int, generator: np.random.Generator) -> _Episodes:
    n = environments.copies
    observation = [environments.reset().observation]
    action = [np.zeros((n, environments.action_size))]
    reward = [np.zeros(n)]
    terminated, lengths = np.zeros(n, np.bool_), np.zeros(n, np.int64)
    rows = np.arange(n)
    for _ in range(horizon):
        drawn = np.zeros((n, environments.action_size))
        drawn[rows] = np.clip(generator.standard_normal((len(rows), environments.action_size)), -1.0, 1.0)
        outcome = environments.step(drawn[rows], rows)
        seen, gained = np.zeros((n, environments.observation_size)), np.zeros(n)
        seen[rows], gained[rows] = outcome.observation, outcome.reward
        observation.append(seen)
        action.append(drawn)
        reward.append(gained)
        lengths[rows] += 1
        terminated[rows] = outcome.terminated
        rows = rows[~(outcome.terminated | outcome.truncated)]
        if not len(rows):
            break
    return _Episodes(np.array(observation), np.array(action), np.array(reward), terminated, lengths)


def _flat(batches: list[_Episodes]) -> Trajectories:
    rows = [(batch, e, batch.lengths[e] + 1) for batch in batches for e in range(len(batch.lengths))]
    first = np.concatenate([[0], np.cumsum([length for _, _, length in rows])]).astype(np.int64)
    terminated, truncated = np.zeros(first[-1], np.bool_), np.zeros(first[-1], np.bool_)
    last = first[1:] - 1
    terminated[last] = [batch.terminated[e] for batch, e, _ in rows]
    truncated[last] = ~terminated[last]
    return Trajectories(
        observation=np.concatenate([batch.observation[:length, e] for batch, e, length in rows]),
        action=np.concatenate([batch.action[:length, e] for batch, e, length in rows]),
        reward=np.concatenate([batch.reward[:length, e] for batch, e, length in rows]),
        terminated=terminated,
        truncated=truncated,
        first=first,
    )
