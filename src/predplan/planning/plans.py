"""What a planner returns: a certified trajectory and when to be where on it, or what was tried and why it failed."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from predplan.planning.certificates import Certificate
from predplan.planning.paths import Path, acceleration_cost, length, velocity_cost
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Scene
from predplan.planning.timing import Timing, parametrise, trajectory


@dataclass(frozen=True)
class Attempt:
    """One start of the cascade and what became of it."""

    start: str  # line, prior or sampled
    outcome: str  # "certified", or why not
    iterations: int
    time_s: float  # since planning began


@dataclass(frozen=True)
class Plan:
    """What a planner returns: a certified trajectory, or the reason why there is none."""

    robot: Robot
    scene: Scene
    success: bool
    reason: str  # empty on success
    method: str
    time_s: float  # until the certified path was there, made faster
    attempts: tuple[Attempt, ...]  # the last one became the path
    certificate: Certificate | None
    path: Path | None

    @property
    def certified(self) -> bool:
        """Whether the whole path was proved free of collision and within joint limits."""
        return self.certificate is not None and self.certificate.free

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the trajectory's columns."""
        return self.robot.joints

    @cached_property
    def timing(self) -> Timing:
        """When to be where, within the velocity and acceleration limits; computed when first asked for."""
        return parametrise(self._path, self.robot.velocity_limit, self.robot.acceleration_limit)

    @property
    def duration_s(self) -> float:
        """Seconds from start to goal."""
        return self.timing.duration

    def trajectory(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Configurations (order 1, 2: velocities, accelerations) at times t [n] s -> [n, joints] rad (/s, /s²)."""
        return trajectory(self._path, self.timing, np.atleast_1d(np.asarray(t, dtype=np.float64)), order)

    @cached_property
    def costs(self) -> Mapping[str, float]:
        """Length (rad), ½ mean ‖q̇‖² and ½ mean ‖q̈‖² over the path's own parameter in [0, 1]."""
        return {
            "length_rad": length(self._path),
            "velocity_cost": velocity_cost(self._path),
            "acceleration_cost": acceleration_cost(self._path),
        }

    @cached_property
    def limits(self) -> Mapping[str, float]:
        """Largest share of each kind of limit that the timed trajectory uses."""
        t = np.linspace(0.0, self.duration_s, 1001)
        q, chain = self.trajectory(t), self.robot.chain
        middle, half = (chain.upper + chain.lower) / 2, (chain.upper - chain.lower) / 2
        return {
            "position": float(np.max(np.abs(q - middle) / half)),
            "velocity": float(np.max(np.abs(self.trajectory(t, 1)) / self.robot.velocity_limit)),
            "acceleration": float(np.max(np.abs(self.trajectory(t, 2)) / self.robot.acceleration_limit)),
        }

    @property
    def _path(self) -> Path:
        if self.path is None:
            raise ValueError(f"there is no trajectory: {self.reason}")
        return self.path


def told(attempts: list[Attempt]) -> str:
    """How often each kind of start ended how."""
    outcomes: dict[str, int] = {}
    for attempt in attempts:
        key = f"{attempt.start}: {attempt.outcome}"
        outcomes[key] = outcomes.get(key, 0) + 1
    return "; ".join(f"{count} x {outcome}" for outcome, count in outcomes.items()) or "no time to try anything"
