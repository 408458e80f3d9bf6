"""Steps of many copies under a policy: what an update learns from.

A batch is T steps of n copies. Episodes go on from one batch to the next, and a copy whose episode ended begins
another at once, so that every batch has T n steps, however long episodes are. Where nothing but the horizon ends
episodes, copies are set off at different ages: in step, each batch would show one part of an episode alone, and the
policy would forget the others. The first episodes, cut short by it, give no return.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from predplan.control.environments import Environments
from predplan.control.memories import Arrays, Memory, under
from predplan.control.networks import ActorCritic, SingleArray
from predplan.control.tasks import BoolArray, FloatArray
from predplan.control.whitening import Whitening


@dataclass(frozen=True)
class Batch:
    """Row t is a step: features before it, the action, what came of it."""

    features: FloatArray  # [T + 1, n, F] of the memory; row T is after the last step
    core: torch.Tensor  # [n, H] the core's state before row 0
    begins: BoolArray  # [T + 1, n] an episode begins here
    observation: FloatArray  # [T + 1, n, O] that the features end with; NaN where it was lost
    after: FloatArray  # [T, n, O] that the step led to; another than the next one above where an episode ended
    drawn: SingleArray  # [T, n, A] actions before they were clipped
    mean: SingleArray  # [T, n, A] of the policy
    reward: FloatArray  # [T, n]
    terminated: BoolArray  # [T, n]
    truncated: BoolArray  # [T, n]
    cut_features: FloatArray  # [m, F] after the last step of each truncated episode, in the order of `truncated`
    cut_core: torch.Tensor  # [m, H] the core's state before those features
    error: FloatArray  # [T, n, O] squared, of what the memory expected of each step; NaN: nothing expected or seen

    @property
    def action(self) -> FloatArray:
        """[T, n, A] as the environment took them."""
        return np.clip(self.drawn, -1.0, 1.0).astype(np.float64)

    @property
    def steps(self) -> int:
        """T n."""
        return int(self.reward.size)


@dataclass(frozen=True)
class Episodes:
    """Those that ended within a batch."""

    returns: FloatArray  # [m]
    lengths: FloatArray  # [m] steps


class Sampler:
    """Copies of an environment with the memories of a policy, in the middle of their episodes."""

    def __init__(self, environments: Environments, memory: Memory, recurrent: int) -> None:
        self.environments, self.memory = environments, memory
        n = environments.copies
        self.core = torch.zeros(n, recurrent)
        self._return, self._length = np.zeros(n), np.zeros(n)
        self._begins = np.ones(n, np.bool_)
        self._observation = environments.reset().observation
        if environments.in_step:
            environments.stagger()
        memory.begin(np.arange(n), self._observation)

    def begin_anew(self) -> None:
        """Where an episode has just begun, let the memory begin it again."""
        rows = np.flatnonzero(self._begins)
        if len(rows):
            self.memory.begin(rows, self._observation[rows])

    def arrays(self) -> Arrays:
        """All that is needed to go on from here, without environments."""
        own: Arrays = {
            "core": self.core.numpy(),
            "return": self._return,
            "length": self._length,
            "begins": self._begins,
            "observation": self._observation,
        }
        return own | {f"memory.{name}": one for name, one in self.memory.arrays().items()}

    def restore(self, arrays: Arrays) -> None:
        """Go on from there."""
        self.core = torch.from_numpy(np.array(arrays["core"]))
        self._return, self._length, self._observation = (
            np.array(arrays[name], np.float64) for name in ("return", "length", "observation")
        )
        self._begins = np.array(arrays["begins"], np.bool_)
        self.memory.restore(under(arrays, "memory"))

    @torch.no_grad()
    def collect(
        self, network: ActorCritic, whitening: Whitening, length: int, generator: np.random.Generator
    ) -> tuple[Batch, Episodes]:
        """T = length steps of every copy."""
        environments, memory = self.environments, self.memory
        kept: defaultdict[str, list[NDArray[Any]]] = defaultdict(list)
        cut_features, cut_core, returns, lengths = [], [], [], []
        start, deviation, act = self.core, torch.exp(network.log_deviation).numpy(), network.acting()
        for _ in range(length):
            seen = memory.features()
            known, following = network.step(torch.from_numpy(whitening(seen).astype(np.float32)), self.core)
            mean = act(known.numpy())
            action = mean + deviation * generator.standard_normal(mean.shape, np.float32)
            done = np.clip(action, -1.0, 1.0).astype(np.float64)
            expected = memory.predict(done)
            outcome = environments.step(done)
            memory.observe(done, outcome.observation)
            for name, one in (
                ("features", seen),
                ("observation", self._observation),
                ("after", outcome.observation),
                ("begins", self._begins),
                ("drawn", action),
                ("mean", mean),
                ("reward", outcome.reward),
                ("terminated", outcome.terminated),
                ("truncated", outcome.truncated),
                ("error", (outcome.observation - expected) ** 2),
            ):
                kept[name].append(one)
            self.core, self._observation = following, outcome.observation
            self._return += outcome.reward
            self._length += 1.0
            self._begins = outcome.terminated | outcome.truncated
            if not self._begins.any():
                continue
            rows = np.flatnonzero(self._begins)
            whole = rows[outcome.terminated[rows] | (self._length[rows] >= environments.horizon)]
            returns.append(self._return[whole])
            lengths.append(self._length[whole])
            if outcome.truncated.any():
                cut_features.append(memory.features()[outcome.truncated])
                cut_core.append(following[torch.from_numpy(outcome.truncated)])
            self._return[rows] = self._length[rows] = 0.0
            first = environments.reset(rows).observation
            self._observation = outcome.observation.copy()
            self._observation[rows] = first
            memory.begin(rows, first)
            self.core = following.clone()
            self.core[torch.from_numpy(rows)] = 0.0
        kept["features"].append(memory.features())
        kept["observation"].append(self._observation)
        kept["begins"].append(self._begins)
        batch = Batch(
            **{name: np.array(rows) for name, rows in kept.items()},
            core=start,
            cut_features=np.concatenate(cut_features) if cut_features else np.zeros((0, memory.size)),
            cut_core=torch.cat(cut_core) if cut_core else torch.zeros(0, self.core.shape[1]),
        )
        if not returns:
            return batch, Episodes(np.zeros(0), np.zeros(0))
        return batch, Episodes(np.concatenate(returns), np.concatenate(lengths))


def replay(memory: Memory, batch: Batch) -> Batch:
    """The batch as it would have been with another memory, the actions being what they were.

    The memory is left where the batch ends. Its episodes must have begun within the batch.
    """
    features, cut_features, errors, action = [], [], [], batch.action
    for t in range(len(batch.begins)):
        if t > 0:
            errors.append((batch.after[t - 1] - memory.predict(action[t - 1])) ** 2)
            memory.observe(action[t - 1], batch.after[t - 1])
            cut_features.append(memory.features()[batch.truncated[t - 1]])
        rows = np.flatnonzero(batch.begins[t])
        if len(rows):
            memory.begin(rows, batch.observation[t, rows])
        features.append(memory.features())
    return replace(
        batch, features=np.array(features), cut_features=np.concatenate(cut_features), error=np.array(errors)
    )
