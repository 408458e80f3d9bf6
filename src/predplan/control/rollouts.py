"""Episodes of what acts: played, recorded, and what they were worth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predplan.control.acting import Actor
from predplan.control.bodies import task_model
from predplan.control.comparing import mean_and_error
from predplan.control.environments import Environments, EnvironmentSettings, Outcome
from predplan.control.tasks import FloatArray, IntArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError


@dataclass(frozen=True)
class Moment:
    """A step of the copies in rows, or their reset: what they did, what was expected of it and what came of it."""

    rows: IntArray  # [n]
    action: FloatArray  # [n, A]; 0 at the reset
    prediction: FloatArray  # [n, O] of the observation, before it was made; NaN at the reset
    outcome: Outcome


@dataclass(frozen=True)
class Rollouts:
    """Recorded episodes. Rows are those of the trajectories: action a_t, and what it led to."""

    settings: EnvironmentSettings
    trajectories: Trajectories
    configuration: FloatArray  # [n, nq] all of MuJoCo's positions; the last O of them are observed
    state: FloatArray  # [n, p] of what acts, with the row's observation
    prediction: FloatArray  # [n, O] of the row's observation before it; NaN in an episode's first row, or throughout
    step_duration: float  # s

    @property
    def position(self) -> FloatArray:
        """[n, O] what a perfect sensor would have seen."""
        return self.configuration[:, -self.trajectories.observation.shape[1] :]

    @property
    def returns(self) -> FloatArray:
        """[E]."""
        sums: FloatArray = np.add.reduceat(self.trajectories.reward, self.trajectories.first[:-1])
        return sums


@dataclass(frozen=True)
class Evaluation:
    """What episodes were worth."""

    returns: FloatArray  # [E]
    lengths: IntArray  # [E] steps
    terminated: int  # episodes that the task ended before the horizon did
    prediction_error: float | None  # one step ahead, mean square over that of exploring; None: nothing was predicted

    @property
    def mean(self) -> float:
        """Mean return."""
        return mean_and_error(self.returns)[0]

    @property
    def standard_error(self) -> float | None:
        """Of the mean return; None for one episode."""
        return mean_and_error(self.returns)[1]


def play(environments: Environments, actor: Actor, rows: IntArray) -> Iterator[Moment]:
    """One episode of each copy in rows [n], from reset to end: the reset, then a moment a step of those going on."""
    outcome = environments.reset(rows)
    actor.reset(rows, outcome.observation)
    nothing = np.full_like(outcome.observation, np.nan)
    yield Moment(rows, np.zeros((len(rows), environments.action_size)), nothing, outcome)
    while len(rows):
        action = np.clip(actor.act(rows), -1.0, 1.0)
        prediction = actor.predict(rows, action)
        outcome = environments.step(action, rows)
        actor.observe(rows, action, outcome.observation)
        yield Moment(rows, action, prediction, outcome)
        rows = rows[~(outcome.terminated | outcome.truncated)]


def record(environments: Environments, actor: Actor, episodes: int) -> Rollouts:
    """That many episodes, as many side by side as there are copies, all of them to their ends."""
    positions = slice(1, 1 + task_model(environments.settings.task).nq)  # time comes first
    parts: list[dict[str, NDArray[Any]]] = []
    for begun, rows in _rounds(environments, episodes):
        for moment in play(environments, actor, rows):
            outcome = moment.outcome
            parts.append(
                {
                    "episode": begun + moment.rows,
                    "observation": outcome.observation,
                    "action": moment.action,
                    "reward": outcome.reward,
                    "terminated": outcome.terminated,
                    "truncated": outcome.truncated,
                    "configuration": environments.physics.state()[moment.rows, positions],
                    "state": actor.state[moment.rows],
                    "prediction": moment.prediction,
                }
            )
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(joined["episode"], kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(joined.pop("episode")))])
    rows_of = {name: one[order] for name, one in joined.items()}
    own = {name: rows_of.pop(name) for name in ("configuration", "state", "prediction")}
    return Rollouts(
        environments.settings, Trajectories(**rows_of, first=first), **own, step_duration=environments.step_duration
    )


def evaluate(environments: Environments, actor: Actor, episodes: int) -> Evaluation:
    """Returns, lengths and, where what acts predicts, the error one step ahead, over that many episodes."""
    returns, lengths = np.zeros(episodes), np.zeros(episodes, np.int64)
    terminated, squares, counted = 0, 0.0, 0
    scale = environments.settings.scale or environments.physics.scale
    for begun, rows in _rounds(environments, episodes):
        for moment in play(environments, actor, rows):
            outcome = moment.outcome
            returns[begun + moment.rows] += outcome.reward
            lengths[begun + moment.rows] += 1
            terminated += int(outcome.terminated.sum())
            if scale:
                error = ((moment.prediction - outcome.position) / np.array(scale)) ** 2
                squares += float(np.nansum(error))
                counted += int(np.isfinite(error).sum())
    return Evaluation(returns, lengths - 1, terminated, squares / counted if counted else None)


def _rounds(environments: Environments, episodes: int) -> Iterator[tuple[int, IntArray]]:
    """Number of the first episode, and the copies that play, of each round."""
    if episodes < 1:
        raise InputError(f"episodes: found {episodes}, expected at least 1")
    for begun in range(0, episodes, environments.copies):
        yield begun, np.arange(min(environments.copies, episodes - begun))
