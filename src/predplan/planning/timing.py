"""When to be where on a path: time parametrisation within velocity and acceleration limits, by TOPPRA.

The timed trajectory is the path itself, q(t) = path(s(t)) with s̈ constant between grid points, so what a certificate
proved of the path holds for the trajectory.
"""

import sys
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np

from predplan.errors import PredplanError
from predplan.planning.paths import Path
from predplan.planning.robots import FloatArray

GRID = 100
"""Intervals of s. TOPPRA holds the limits at the grid's points; `_slowed` sees to what lies between."""
BETWEEN = 8
"""Points looked at in each interval."""


@dataclass(frozen=True)
class Timing:
    """s over time: at `times` [G + 1] (s) the path is at `s` [G + 1] with speed `speed` [G + 1] (1/s)."""

    times: FloatArray
    s: FloatArray
    speed: FloatArray

    @property
    def duration(self) -> float:
        """Seconds from start to goal."""
        return float(self.times[-1])

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """s, ds/dt and d²s/dt² at t [n] s; outside [0, duration] the nearest end."""
        t = np.clip(t, 0.0, self.times[-1])
        if len(self.times) == 1:
            return np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
        left = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        step = self.times[left + 1] - self.times[left]
        acceleration = np.where(step > 0, (self.speed[left + 1] - self.speed[left]) / np.maximum(step, 1e-300), 0.0)
        since = t - self.times[left]
        s = self.s[left] + self.speed[left] * since + 0.5 * acceleration * since**2
        return np.clip(s, 0.0, 1.0), self.speed[left] + acceleration * since, acceleration


def trajectory(path: Path, timing: Timing, t: FloatArray, order: int = 0) -> FloatArray:
    """Configurations, velocities or accelerations by time (order 0, 1, 2) at t [n] s -> [n, D]."""
    s, speed, acceleration = timing.at(np.asarray(t, dtype=np.float64))
    if order == 0:
        return path(s)
    if order == 1:
        return path(s, 1) * speed[:, None]
    return path(s, 2) * speed[:, None] ** 2 + path(s, 1) * acceleration[:, None]


def parametrise(path: Path, velocity_limit: FloatArray, acceleration_limit: FloatArray) -> Timing:
    """The fastest timing from rest to rest within the limits [D] (rad/s, rad/s²; TOPPRA, Pham and Pham 2018).

    A path with corners (of degree 1) stops at each of them. Raises PredplanError if there is none.
    """
    moving = np.ptp(path.coefficients, axis=(0, 1)).max() > 1e-12
    if not moving:
        return Timing(np.zeros(1), np.zeros(1), np.zeros(1))
    corners = path.breaks if path.degree == 1 else path.breaks[[0, -1]]
    timings = [
        _between_stops(path, first, last, velocity_limit, acceleration_limit) for first, last in pairwise(corners)
    ]
    starts = np.cumsum([0.0, *(timing.duration for timing in timings[:-1])])
    return Timing(
        np.concatenate(
            [timings[0].times[:1], *(timing.times[1:] + at for timing, at in zip(timings, starts, strict=True))]
        ),
        np.concatenate([timings[0].s[:1], *(timing.s[1:] for timing in timings)]),
        np.concatenate([timings[0].speed[:1], *(timing.speed[1:] for timing in timings)]),
    )


def _between_stops(
    path: Path, first: float, last: float, velocity_limit: FloatArray, acceleration_limit: FloatArray
) -> Timing:
    algorithm, constraint, _ = _toppra()
    grid = np.linspace(first, last, GRID + 1)
    limits = [
        constraint.JointVelocityConstraint(np.stack([-velocity_limit, velocity_limit], axis=1)),
        constraint.JointAccelerationConstraint(
            np.stack([-acceleration_limit, acceleration_limit], axis=1),
            discretization_scheme=constraint.DiscretizationType.Interpolation,
        ),
    ]
    problem = algorithm.TOPPRA(limits, _for_toppra(path), gridpoints=grid, solver_wrapper="seidel")
    _, speed, _ = problem.compute_parameterization(0.0, 0.0)
    if speed is None or not np.all(np.isfinite(speed)):
        raise PredplanError("no timing of the path keeps the velocity and acceleration limits")
    mean = 0.5 * (speed[1:] + speed[:-1])
    if np.any(mean <= 0.0):
        raise PredplanError(
            "no timing of the path keeps the velocity and acceleration limits: it would have to stand still"
        )
    times = np.concatenate([[0.0], np.cumsum(np.diff(grid) / mean)])
    return _slowed(path, Timing(times, grid, speed), velocity_limit, acceleration_limit)


class _LatePyplot(ModuleType):
    """Stands for pyplot, and imports it when something of it is wanted."""

    def __getattr__(self, name: str) -> Any:
        if sys.modules.get(self.__name__) is self:  # still being imported, which asks for what may be there
            raise AttributeError(name)
        return getattr(import_module(self.__name__), name)


@cache
def _toppra() -> tuple[ModuleType, ModuleType, ModuleType]:
    """TOPPRA's algorithms, constraints and interpolators, imported when first used.

    It imports pyplot for drawings that are not made here, which takes longer than all the rest.
    """
    late = [name for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules]
    sys.modules.update({name: _LatePyplot(name) for name in late})
    try:
        from toppra import algorithm, constraint, interpolator
    finally:
        for name in late:
            del sys.modules[name]
    return algorithm, constraint, interpolator


def _for_toppra(path: Path) -> Any:
    interpolator = _toppra()[2]

    class Geometric(interpolator.AbstractGeometricPath):  # type: ignore[misc, name-defined]
        path_interval = np.array([0.0, 1.0])
        dof = path.coefficients.shape[2]

        def __call__(self, s: FloatArray, order: int = 0) -> FloatArray:
            return path(np.asarray(s), order)

    return Geometric()


def _slowed(path: Path, timing: Timing, velocity_limit: FloatArray, acceleration_limit: FloatArray) -> Timing:
    """The timing stretched as a whole by as much as the limits are exceeded between the grid's points."""
    inside = (np.arange(BETWEEN) + 0.5) / BETWEEN
    t = (timing.times[:-1, None] + np.diff(timing.times)[:, None] * inside).ravel()
    t = np.concatenate([t, timing.times])
    velocity = np.max(np.abs(trajectory(path, timing, t, 1)) / velocity_limit)
    acceleration = np.max(np.abs(trajectory(path, timing, t, 2)) / acceleration_limit)
    stretch = max(1.0, 1.001 * velocity, np.sqrt(1.002 * acceleration)) if max(velocity, acceleration) > 1.0 else 1.0
    return Timing(timing.times * stretch, timing.s, timing.speed / stretch)
