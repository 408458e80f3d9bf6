"""When to be where on a path: the fastest timing within velocity and acceleration limits.

Reachability analysis of Pham and Pham (TOPP-RA, 2018) over x = ṡ² with s̈ = u constant between grid points, so that
x(s) = x_i + 2 u (s - s_i). There q̈ = q''(s) x(s) + q'(s) u is a polynomial of s whose Bernstein coefficients are linear
in (x_i, u): holding those within the limits holds them at every time, not only at the grid's points as the published
library does (it takes a second to import, too; tests compare with it).

The timed trajectory is the path itself, q(t) = path(s(t)), so what a certificate proved of the path holds for it.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from predplan.errors import PredplanError
from predplan.planning.paths import Path
from predplan.planning.robots import FloatArray

GRID = 128
"""Least number of intervals of s."""
INSIDE = 1.0 - 1e-9
"""Share of the limits that may be used, so that rounding does not go beyond them."""
FASTEST = 1e12
"""1/s²: bound on ṡ² where the path stands still."""


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
        return np.clip(s, self.s[left], self.s[left + 1]), self.speed[left] + acceleration * since, acceleration


def trajectory(path: Path, timing: Timing, t: FloatArray, order: int = 0) -> FloatArray:
    """Configurations, velocities or accelerations by time (order 0, 1, 2) at t [n] s -> [n, D]."""
    s, speed, acceleration = timing.at(np.asarray(t, dtype=np.float64))
    if order == 0:
        return path(s)
    if order == 1:
        return path(s, 1) * speed[:, None]
    return path(s, 2) * speed[:, None] ** 2 + path(s, 1) * acceleration[:, None]


def parametrise(path: Path, velocity_limit: FloatArray, acceleration_limit: FloatArray) -> Timing:
    """The fastest timing from rest to rest within the limits [D] (rad/s, rad/s²), which are above zero.

    A path with corners (of degree 1) stops at each of them. Raises PredplanError if the path cannot be timed.
    """
    moving = np.ptp(path.coefficients, axis=(0, 1)).max() > 1e-12
    if not moving:
        return Timing(np.zeros(1), np.zeros(1), np.zeros(1))
    parts = max(4, -(-GRID // len(path.coefficients)))
    fine = path.cut(parts)
    step = np.diff(fine.breaks)
    on_speed, on_square, first = _accelerations(fine, step)
    fastest = np.minimum(
        FASTEST, (INSIDE / np.maximum(np.max(np.abs(first) / velocity_limit, axis=(1, 2)), 1e-300)) ** 2
    )
    most = np.minimum(np.append(fastest, FASTEST), np.append(FASTEST, fastest))
    most[:: parts if path.degree == 1 else len(step)] = 0.0
    rows = len(step), -1
    square = _fastest(
        np.ascontiguousarray((on_speed / (INSIDE * acceleration_limit)).reshape(rows)),
        np.ascontiguousarray((on_square / (INSIDE * acceleration_limit)).reshape(rows)),
        step,
        most,
    )
    speed = np.sqrt(square)
    mean = 0.5 * (speed[1:] + speed[:-1])
    if not np.all(mean > 0.0):
        raise PredplanError("no timing of the path keeps the velocity and acceleration limits")
    return Timing(np.concatenate([[0.0], np.cumsum(step / mean)]), fine.breaks, speed)


def _accelerations(path: Path, step: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bernstein coefficients of q̈ in each piece: those of u and of x_i [I, n, D]; and those of q' [I, n, D].

    With t in [0, 1] over a piece of length h: q̈ = q'' x_i + (q' + 2 h t q'') u. For e_k the n - 1 coefficients of q'',
    t q'' has k/(n-1) e_{k-1} in degree n - 1, and q'' itself, raised by a degree, k/(n-1) e_{k-1} + (1 - k/(n-1)) e_k.
    """
    degree, h = path.degree, step[:, None, None]
    first = np.diff(path.coefficients, axis=1) * (degree / h)
    if degree == 1:
        return first, np.zeros_like(first), first
    second = np.diff(first, axis=1) * ((degree - 1) / h)
    share = (np.arange(degree) / (degree - 1))[:, None]
    before = share * np.pad(second, ((0, 0), (1, 0), (0, 0)))
    after = (1.0 - share) * np.pad(second, ((0, 0), (0, 1), (0, 0)))
    return first + 2.0 * h * before, before + after, first


@njit(cache=True, error_model="numpy")
def _fastest(on_speed: FloatArray, on_square: FloatArray, step: FloatArray, most: FloatArray) -> FloatArray:
    """The largest x [I + 1] with |on_speed u + on_square x| <= 1 in every row [I, R], below `most` [I + 1].

    Backwards: from which x the end can still be reached; those are intervals from 0, since u = 0 at x = 0 keeps all
    limits, and their ends are found by bisection. Forwards: as fast as these allow.
    """
    intervals = len(step)
    top = most.copy()
    for i in range(intervals - 1, -1, -1):
        low, high = 0.0, most[i]
        if _range(on_speed[i], on_square[i], step[i], top[i + 1], high)[2]:
            continue
        for _ in range(60):
            middle = 0.5 * (low + high)
            if _range(on_speed[i], on_square[i], step[i], top[i + 1], middle)[2]:
                low = middle
            else:
                high = middle
        top[i] = low
    x = np.zeros(intervals + 1)
    x[0] = top[0]
    for i in range(intervals):
        largest = _range(on_speed[i], on_square[i], step[i], top[i + 1], x[i])[1]
        x[i + 1] = min(max(x[i] + 2.0 * step[i] * largest, 0.0), top[i + 1])
    return x


@njit(cache=True, error_model="numpy")
def _range(on_speed: FloatArray, on_square: FloatArray, step: float, top: float, x: float) -> tuple[float, float, bool]:
    """Least and largest u at x, from which the next x is in [0, top], and whether there is any."""
    low, high = -x / (2.0 * step), (top - x) / (2.0 * step)
    for r in range(len(on_speed)):
        a, b = on_speed[r], on_square[r] * x
        if abs(a) > 1e-200:
            centre, half = -b / a, 1.0 / abs(a)
            low, high = max(low, centre - half), min(high, centre + half)
        elif abs(b) > 1.0:
            return 0.0, 0.0, False
    return low, high, low <= high
