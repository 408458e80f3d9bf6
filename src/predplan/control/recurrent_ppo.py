"""A peer: sb3-contrib's recurrent PPO with its defaults, on the same observations (extra `sb3`)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.tasks import FloatArray


@dataclass(frozen=True)
class PeerRun:
    """Episodes in the order in which they ended."""

    steps: FloatArray  # [m] of the environment when each ended
    returns: FloatArray  # [m]
    cpu_s: float


class PositionsOnly(gymnasium.Env[FloatArray, FloatArray]):
    """One copy of our environments as Gymnasium has them; what was lost reads as it was last seen, then as 0."""

    def __init__(self, settings: EnvironmentSettings, generator: np.random.Generator) -> None:
        self._environments = Environments(settings, 1, generator)
        o, actions = self._environments.observation_size, self._environments.action_size
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (o,), np.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float64)
        self._last = np.zeros(o)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Starts are drawn by the environments' own generator; a seed changes nothing."""
        self._last = np.zeros_like(self._last)
        return self._seen(self._environments.reset().observation[0]), {}

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Of the one copy."""
        outcome = self._environments.step(np.asarray(action, np.float64)[None])
        seen = self._seen(outcome.observation[0])
        return seen, float(outcome.reward[0]), bool(outcome.terminated[0]), bool(outcome.truncated[0]), {}

    def _seen(self, observation: FloatArray) -> FloatArray:
        self._last = np.where(np.isfinite(observation), observation, self._last)
        return self._last.copy()


def train_peer(settings: EnvironmentSettings, steps: int, seed: int) -> PeerRun:
    """Learn for that many steps. Raises ModuleNotFoundError without sb3-contrib."""
    from sb3_contrib import RecurrentPPO
    from stable_baselines3.common.monitor import Monitor

    environment = Monitor(PositionsOnly(settings, np.random.default_rng(seed)))
    began = time.process_time()
    RecurrentPPO("MlpLstmPolicy", environment, seed=seed, device="cpu").learn(steps)
    spent = time.process_time() - began
    lengths = np.array(environment.get_episode_lengths(), np.float64)
    return PeerRun(np.cumsum(lengths), np.array(environment.get_episode_rewards()), spent)
