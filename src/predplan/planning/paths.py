"""Paths as piecewise polynomials in Bernstein form: the one form that is certified, timed, written and executed.

A smooth trajectory becomes a quintic spline that meets its values, velocities and accelerations at the knots (within
1e-6 rad of it at the planner's knots); a polyline is a path of degree 1. Bernstein coefficients bound what lies between
their knots: a path stays in the convex hull of each piece's coefficients, which is what makes a certificate exact.
"""

from dataclasses import dataclass

import numpy as np

from predplan.planning.robots import FloatArray


@dataclass(frozen=True)
class Path:
    """Configurations over s in [0, 1]."""

    breaks: FloatArray  # [P + 1], from 0 to 1
    coefficients: FloatArray  # [P, degree + 1, D], rad or m

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return int(self.coefficients.shape[1]) - 1

    def __call__(self, s: FloatArray, order: int = 0) -> FloatArray:
        """Configurations, or derivatives by s of an order, at s [n] -> [n, D]; outside [0, 1] the end's polynomial."""
        coefficients, step = self.coefficients, np.diff(self.breaks)
        for _ in range(order):
            factor = (coefficients.shape[1] - 1) / step
            coefficients = np.diff(coefficients, axis=1) * factor[:, None, None]
        if coefficients.shape[1] == 0:
            return np.zeros((len(s), coefficients.shape[2]))
        piece = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(step) - 1)
        u = ((s - self.breaks[piece]) / step[piece])[:, None, None]
        points = coefficients[piece]
        while points.shape[1] > 1:  # de Casteljau
            points = (1.0 - u) * points[:, :-1] + u * points[:, 1:]
        return points[:, 0]

    def cut(self, parts: int) -> "Path":
        """The same path with each piece cut into `parts` of equal length, by de Casteljau's construction."""
        rest, pieces = self.coefficients, []
        for part in range(parts, 1, -1):
            u, points = 1.0 / part, rest
            first, second = [points[:, 0]], [points[:, -1]]
            while points.shape[1] > 1:
                points = (1.0 - u) * points[:, :-1] + u * points[:, 1:]
                first.append(points[:, 0])
                second.append(points[:, -1])
            pieces.append(np.stack(first, axis=1))
            rest = np.stack(second[::-1], axis=1)
        pieces.append(rest)
        inside = self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * (np.arange(parts) / parts)
        coefficients = np.stack(pieces, axis=1).reshape(-1, *self.coefficients.shape[1:])
        return Path(np.append(inside.ravel(), self.breaks[-1]), coefficients)


def quintic(breaks: FloatArray, position: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> Path:
    """The C² path with given values and derivatives by s at the knots. breaks [P + 1], others [P + 1, D]."""
    step = np.diff(breaks)[:, None]
    left, right = position[:-1], position[1:]
    coefficients = np.stack(
        [
            left,
            left + step / 5 * velocity[:-1],
            left + 2 * step / 5 * velocity[:-1] + step**2 / 20 * acceleration[:-1],
            right - 2 * step / 5 * velocity[1:] + step**2 / 20 * acceleration[1:],
            right - step / 5 * velocity[1:],
            right,
        ],
        axis=1,
    )
    return Path(breaks, coefficients)


def polyline(points: FloatArray) -> Path:
    """Straight segments between points [n, D], n >= 2, at one speed (2-norm of configuration space)."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = np.concatenate([[True], lengths > 0.0])
    points = points[kept]
    if len(points) == 1:
        points = np.repeat(points, 2, axis=0)
        return Path(np.array([0.0, 1.0]), points[None])
    breaks = np.concatenate([[0.0], np.cumsum(lengths[lengths > 0.0])])
    return Path(breaks / breaks[-1], np.stack([points[:-1], points[1:]], axis=1))


def length(path: Path, samples: int = 1001) -> float:
    """Length in configuration space, rad (m for prismatic joints)."""
    return float(np.linalg.norm(np.diff(path(np.linspace(0.0, 1.0, samples)), axis=0), axis=1).sum())


def velocity_cost(path: Path, samples: int = 101) -> float:
    """½ mean ‖q̇‖² over equal steps of s, by differences, so that every kind of path is measured alike."""
    q = path(np.linspace(0.0, 1.0, samples))
    return float(0.5 * np.mean(np.sum((np.diff(q, axis=0) * (samples - 1)) ** 2, axis=1)))


def acceleration_cost(path: Path, samples: int = 101) -> float:
    """½ mean ‖q̈‖² over equal steps of s, by second differences."""
    q = path(np.linspace(0.0, 1.0, samples))
    return float(0.5 * np.mean(np.sum((np.diff(q, n=2, axis=0) * (samples - 1) ** 2) ** 2, axis=1)))
