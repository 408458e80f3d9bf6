"""A learned policy at work: `reset`, then an action for each observation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from predplan.control.learned import Learned
from predplan.control.memories import Predictive
from predplan.control.policy_files import load_policy
from predplan.control.tasks import FloatArray, IntArray
from predplan.errors import InputError


class PolicyActor:
    """Copies side by side; means of actions, without noise."""

    def __init__(self, learned: Learned, copies: int) -> None:
        self._learned, self._memory = learned, learned.memory(copies)
        self._core = learned.network.initial(copies)
        self._mean = np.zeros((copies, learned.actions))

    def reset(self, rows: IntArray, observation: FloatArray) -> None:
        """Those copies begin an episode with observation [len(rows), O], NaN where it was lost."""
        self._memory.begin(rows, observation)
        self._core[torch.from_numpy(rows)] = 0.0
        self._think(rows)

    def act(self, rows: IntArray) -> FloatArray:
        """Mean actions [len(rows), A], clipped to [-1, 1]."""
        return np.clip(self._mean[rows], -1.0, 1.0)

    def observe(self, rows: IntArray, action: FloatArray, observation: FloatArray) -> None:
        """Copies that are not in rows see nothing; they are to be reset before they act."""
        copies = len(self._mean)
        done, seen = np.zeros((copies, action.shape[1])), np.full((copies, observation.shape[1]), np.nan)
        done[rows], seen[rows] = action, observation
        self._memory.observe(done, seen)
        self._think(rows)

    @property
    def state(self) -> FloatArray:
        """[copies, p] of the filter, or of the core; p may be 0."""
        if isinstance(self._memory, Predictive):
            return self._memory.state.mean
        return self._core.double().numpy()

    def predict(self, rows: IntArray, action: FloatArray) -> FloatArray:
        """[len(rows), O] expected of actions [len(rows), A]; NaN without a predictive state."""
        done = np.zeros((len(self._mean), action.shape[1]))
        done[rows] = action
        return self._memory.predict(done)[rows]

    @torch.no_grad()
    def _think(self, rows: IntArray) -> None:
        network = self._learned.network
        features = self._learned.whitening(self._memory.features()).astype(np.float32)
        known, following = network.step(torch.from_numpy(features), self._core)
        chosen = torch.from_numpy(rows)
        self._core[chosen] = following[chosen]
        self._mean[rows] = network.actor(known).double().numpy()[rows]


class Policy:
    """One copy: `policy.reset()`, then `policy.act(observation)` for each observation of an episode."""

    def __init__(self, learned: Learned) -> None:
        self.learned = learned
        self._actor, self._row = PolicyActor(learned, 1), np.zeros(1, np.int64)
        self._action: FloatArray | None = None

    @classmethod
    def load(cls, folder: str | Path) -> Policy:
        """The policy in a folder of `predplan control train`. Raises InputError where it is not whole."""
        return cls(load_policy(Path(folder)))

    def reset(self) -> None:
        """The next observation is the first of an episode."""
        self._action = None

    def act(self, observation: FloatArray) -> FloatArray:
        """The action [A], in [-1, 1], upon observation [O] in m and rad; NaN where it was lost.

        Raises InputError where the observation has another size.
        """
        seen = np.asarray(observation, np.float64)
        if seen.shape != (self.learned.observations,):
            raise InputError(f"observation: found shape {seen.shape}, expected ({self.learned.observations},)")
        if self._action is None:
            self._actor.reset(self._row, seen[None])
        else:
            self._actor.observe(self._row, self._action, seen[None])
        self._action = self._actor.act(self._row)
        action: FloatArray = self._action[0].copy()
        return action
