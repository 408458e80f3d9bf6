"""Spheres that cover convex shapes and reach outside them by no more than a stated distance.

Spheres that are free therefore prove that the geometry is. Shapes are cut into pieces, each the convex hull of a few
balls (a corner is a ball of radius 0). A sphere is convex, so it covers a piece if and only if it holds the piece's
balls: the cover is proved, not sampled. Of many spheres that stay within the tolerance few are chosen greedily.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from predplan.errors import InputError
from predplan.planning.poses import along
from predplan.planning.robots import BoolArray, FloatArray
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, convex_hull

CORNERS = 6
"""Of a prism."""
SIDES = 24
"""Of the prism around a cylinder."""
MOST_CANDIDATES = 2500
COARSEST = 1.0
"""Largest edge of a piece, in radii of a sphere about its middle: smaller pieces cost time, larger ones spheres."""
ROUNDING = 1e-9
"""m, added to radii."""


class Spheres(NamedTuple):
    """centres [n, 3] m, radii [n] m; they cover the shapes and reach at most `overshoot` m outside."""

    centres: FloatArray
    radii: FloatArray
    overshoot: float


class Pieces(NamedTuple):
    """Prisms with balls at their corners, three of one end and then three of the other: [n, 6, 3] m and radii [n] m."""

    corners: FloatArray
    radii: FloatArray


def fit_spheres(shapes: Sequence[Shape], tolerance: float, name: str) -> Spheres:
    """Spheres that cover the shapes and reach at most `tolerance` (m) outside their union; spheres stay as they are.

    Raises InputError for a tolerance that is not positive and for a mesh without volume.
    """
    if not tolerance > 0:
        raise InputError(f"{name}: sphere tolerance {tolerance}; expected more than zero m")
    if all(isinstance(shape, Sphere) for shape in shapes):
        balls = [shape for shape in shapes if isinstance(shape, Sphere)]
        centres = np.array([ball.centre for ball in balls], dtype=np.float64).reshape(-1, 3)
        return Spheres(centres, np.array([ball.radius for ball in balls], dtype=np.float64), 0.0)
    pieces, candidates = _refine(shapes, _joined([_pieces(shape, name) for shape in shapes]), tolerance)
    limits = _depth(shapes, candidates) + tolerance
    centres, radii = _choose(candidates, limits, pieces)
    return Spheres(centres, radii, max(float(np.max(radii - _depth(shapes, centres))), 0.0))


def _refine(shapes: Sequence[Shape], pieces: Pieces, tolerance: float) -> tuple[Pieces, FloatArray]:
    """Halve pieces until each is covered by a candidate sphere, centred on a grid or at the piece's own middle."""
    candidates = [_grid(shapes, pieces, tolerance)]
    done: list[Pieces] = []
    while len(pieces.radii):
        middles = pieces.corners.mean(axis=1)
        depth = np.maximum(_depth(shapes, middles), 0.0)
        large = _edges(pieces).max(axis=1) > COARSEST * (tolerance + depth)
        covered = ~large
        covered[~large] = _covers(candidates[0], _depth(shapes, candidates[0]) + tolerance, _of(pieces, ~large)).any(
            axis=0
        )
        own = np.linalg.norm(pieces.corners - middles[:, None], axis=2).max(axis=1) + pieces.radii
        alone = ~large & ~covered & (own <= depth + tolerance)
        candidates.append(middles[alone])
        done.append(_of(pieces, covered | alone))
        pieces = _halved(_of(pieces, ~(covered | alone)))
    return _joined(done), np.concatenate(candidates)


def _choose(candidates: FloatArray, limits: FloatArray, pieces: Pieces) -> tuple[FloatArray, FloatArray]:
    """Greedy set cover: again and again the candidate that covers most of what is left; at last shrunk to fit."""
    covers = _covers(candidates, limits, pieces)
    left = np.ones(len(pieces.radii), np.bool_)
    gains = covers.sum(axis=1)
    chosen: list[int] = []
    while left.any():
        best = int(np.argmax(gains))
        taken = covers[best] & left
        chosen.append(best)
        left &= ~taken
        gains = gains - covers[:, taken].sum(axis=1)
    # Those chosen early may have become redundant.
    for index in list(chosen):
        others = [other for other in chosen if other != index]
        if others and covers[others].any(axis=0).all():
            chosen = others
    needed = _needed_radius(candidates[chosen], pieces)
    owner = np.argmin(np.where(covers[chosen], needed - limits[chosen, None], np.inf), axis=0)
    used = [i for i in range(len(chosen)) if (owner == i).any()]
    radii = np.array([needed[i, owner == i].max() for i in used]) + ROUNDING
    return candidates[[chosen[i] for i in used]], radii


def _covers(candidates: FloatArray, limits: FloatArray, pieces: Pieces) -> BoolArray:
    """Which pieces [n] spheres at the candidates [c] with radii `limits` hold: [c, n]."""
    covers = np.ones((len(candidates), len(pieces.radii)), np.bool_)
    for rows in np.array_split(np.arange(len(candidates)), max(len(candidates) // 500, 1)):
        covers[rows] = _needed_radius(candidates[rows], pieces) <= limits[rows, None]
    return covers


def _needed_radius(centres: FloatArray, pieces: Pieces) -> FloatArray:
    """The radius [c, n] (m) that a sphere at each centre needs to cover each piece."""
    from scipy.spatial.distance import cdist  # half a second that a body of spheres need not wait

    needed = np.zeros((len(centres), len(pieces.radii)))
    for corner in range(CORNERS):
        np.maximum(needed, cdist(centres, pieces.corners[:, corner]), out=needed)
    return np.asarray(needed + pieces.radii)


def _grid(shapes: Sequence[Shape], pieces: Pieces, tolerance: float) -> FloatArray:
    """Points [c, 3] inside the shapes, along the axes of the first and symmetric about the middle of all."""
    rotation = _axes(shapes[0])
    corners = pieces.corners @ rotation
    low = (corners - pieces.radii[:, None, None]).min(axis=(0, 1))
    high = (corners + pieces.radii[:, None, None]).max(axis=(0, 1))
    step = max(tolerance / 2, float(np.prod(high - low) / MOST_CANDIDATES) ** (1 / 3))
    halves = np.ceil((high - low) / step / 2).astype(int)
    axes = [np.linspace(a, b, 2 * n + 1) for a, b, n in zip(low, high, halves, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) @ rotation.T
    return np.asarray(grid[_depth(shapes, grid) > 0])


def _axes(shape: Shape) -> FloatArray:
    """Columns [3, 3] along which the shape is symmetric, or a mesh extends most and least."""
    if isinstance(shape, Box | Cylinder):
        return np.asarray(shape.rotation, dtype=np.float64)
    if isinstance(shape, Mesh):
        corners = np.asarray(shape.vertices, dtype=np.float64)
        return np.asarray(np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2].T)
    line = np.zeros(3) if isinstance(shape, Sphere) else np.subtract(shape.b, shape.a)
    return along(line) if np.any(line) else np.eye(3)


def _depth(shapes: Sequence[Shape], points: FloatArray) -> FloatArray:
    """How deep points are in the shapes (m) [n]: a ball of that radius lies within one of them. Negative outside."""
    return np.asarray(np.max([_depth_in(shape, points) for shape in shapes], axis=0))


def _depth_in(shape: Shape, points: FloatArray) -> FloatArray:
    if isinstance(shape, Mesh):
        planes = convex_hull(shape.vertices, shape.name).planes
        return np.asarray(-np.max(points @ planes[:, :3].T + planes[:, 3], axis=1))
    if isinstance(shape, Sphere):
        return np.asarray(shape.radius - np.linalg.norm(points - np.asarray(shape.centre), axis=1))
    if isinstance(shape, Capsule):
        a, b = np.asarray(shape.a, dtype=np.float64), np.asarray(shape.b, dtype=np.float64)
        share = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-300), 0.0, 1.0)
        return np.asarray(shape.radius - np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    seen = np.abs((points - np.asarray(shape.centre)) @ np.asarray(shape.rotation))
    if isinstance(shape, Box):
        return np.asarray(np.min(np.asarray(shape.half) - seen, axis=1))
    return np.asarray(np.minimum(shape.radius - np.hypot(seen[:, 0], seen[:, 1]), shape.half - seen[:, 2]))


def _pieces(shape: Shape, name: str) -> Pieces:
    """Prisms that make up a shape, or for a cylinder the 24-sided one around it.

    A capsule is a cylinder and two balls; a mesh is cut into the prisms between its triangles and their images, half
    as large, and those within.
    """
    if isinstance(shape, Sphere):
        return Pieces(np.array([[shape.centre] * CORNERS], dtype=np.float64), np.array([float(shape.radius)]))
    if isinstance(shape, Capsule):
        a, b = np.asarray(shape.a, dtype=np.float64), np.asarray(shape.b, dtype=np.float64)
        parts = [_pieces(Sphere(end, shape.radius), name) for end in (a, b)]
        if np.any(a != b):
            half = float(np.linalg.norm(b - a)) / 2
            parts.append(_pieces(Cylinder((a + b) / 2, half, shape.radius, along(b - a)), name))
        return _joined(parts)
    if isinstance(shape, Mesh):
        triangles = convex_hull(shape.vertices, name).triangles
        middle = triangles.reshape(-1, 3).mean(axis=0)
        arms = triangles - middle
        shells = [np.concatenate([outer * arms, inner * arms], axis=1) for outer, inner in ((1.0, 0.5), (0.5, 0.0))]
        corners = middle + np.concatenate(shells)
    elif isinstance(shape, Box):
        x, y, half = np.asarray(shape.half, dtype=np.float64)
        flat = np.array([[[-x, -y], [x, -y], [x, y]], [[-x, -y], [x, y], [-x, y]]])
        corners = _upright(flat, float(half), shape)
    else:
        angles = np.arange(SIDES + 1) * 2 * np.pi / SIDES
        ring = shape.radius / np.cos(np.pi / SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        flat = np.stack([np.zeros((SIDES, 2)), ring[:-1], ring[1:]], axis=1)
        corners = _upright(flat, shape.half, shape)
    return Pieces(corners, np.zeros(len(corners)))


def _upright(flat: FloatArray, half: float, shape: Box | Cylinder) -> FloatArray:
    """Prisms [n, 6, 3] over triangles [n, 3, 2] in the shape's x and y, from -half to half of its z."""
    local = np.concatenate([np.insert(flat, 2, end, axis=2) for end in (-half, half)], axis=1)
    return np.asarray(local @ np.asarray(shape.rotation).T + np.asarray(shape.centre))


def _edges(pieces: Pieces) -> FloatArray:
    """Lengths [n, 4] (m) of the prisms' three sides, the longer of both ends, and of their height."""
    ends = pieces.corners.reshape(-1, 2, 3, 3)
    sides = np.linalg.norm(ends - np.roll(ends, -1, axis=2), axis=3).max(axis=1)
    heights = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=2).max(axis=1)
    return np.concatenate([sides, heights[:, None]], axis=1)


def _halved(pieces: Pieces) -> Pieces:
    """Each prism cut in two across its longest edge."""
    ends = pieces.corners.reshape(-1, 2, 3, 3)
    longest = np.argmax(_edges(pieces), axis=1)
    first, second = ends.copy(), ends.copy()
    for side in range(3):
        rows, following = longest == side, (side + 1) % 3
        middle = (ends[rows, :, side] + ends[rows, :, following]) / 2
        first[rows, :, following] = middle
        second[rows, :, side] = middle
    rows = longest == 3
    first[rows, 1] = second[rows, 0] = (ends[rows, 0] + ends[rows, 1]) / 2
    corners = np.concatenate([first, second]).reshape(-1, CORNERS, 3)
    return Pieces(corners, np.concatenate([pieces.radii, pieces.radii]))


def _joined(parts: Sequence[Pieces]) -> Pieces:
    return Pieces(np.concatenate([part.corners for part in parts]), np.concatenate([part.radii for part in parts]))


def _of(pieces: Pieces, rows: BoolArray) -> Pieces:
    return Pieces(pieces.corners[rows], pieces.radii[rows])
