"""Solids as triangles with a normal at each corner, so that what is round looks round and edges stay sharp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from predplan.artifacts.recordings import Mesh, Primitive, Solid

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CREASE = np.cos(np.radians(35.0))
"""Faces that meet at a sharper angle keep an edge between them."""
AROUND = 48
"""Corners of a circle."""


class Surface(NamedTuple):
    """Triangles over vertices that have normals."""

    vertices: Floats  # [V, 3] m
    normals: Floats  # [V, 3], of length 1
    triangles: Integers  # [T, 3]


def surface_of(solids: Sequence[Solid]) -> Surface:
    """The surface of solids of one frame, in that frame."""
    parts = [_mesh(solid) if isinstance(solid, Mesh) else _primitive(solid) for solid in solids]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Surface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=False)]),
    )


def _mesh(mesh: Mesh) -> Surface:
    """A corner's normal is the mean, by area, of those of the faces at its vertex that are nearly in its plane."""
    welded, vertex = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    triangles = vertex.reshape(-1)[mesh.triangles]
    a, b, c = (welded[triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    size = np.linalg.norm(areas, axis=1)
    kept = size > 0.0
    triangles, areas = triangles[kept], areas[kept]
    faces = areas / size[kept, None]
    corner, other = _neighbours(triangles, len(welded))
    alike = np.einsum("ij,ij->i", faces[corner // 3], faces[other // 3]) > CREASE
    corner, other = corner[alike], other[alike]
    sums = [np.bincount(corner, areas[other // 3, k], triangles.size).astype(np.float64) for k in range(3)]
    normals = np.stack(sums, axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Corners that share vertex and normal (to 1/100) become one again.
    rounded = np.round(normals * 100.0).astype(np.int64) + 100
    key = ((triangles.ravel() * 201 + rounded[:, 0]) * 201 + rounded[:, 1]) * 201 + rounded[:, 2]
    _, first, again = np.unique(key, return_index=True, return_inverse=True)
    return Surface(welded[triangles.ravel()[first]], normals[first], again.reshape(-1, 3))


def _neighbours(triangles: Integers, vertices: int) -> tuple[Integers, Integers]:
    """All pairs of corners (3 f + k of face f) that lie at one vertex, each corner with itself too."""
    at = triangles.ravel()
    order = np.argsort(at, kind="stable")
    count = np.bincount(at, minlength=vertices)
    first = np.cumsum(count) - count
    degree = count[at[order]]
    corner = np.repeat(order, degree)
    within = np.arange(len(corner)) - np.repeat(np.cumsum(degree) - degree, degree)
    return corner, order[np.repeat(first[at[order]], degree) + within]


def _primitive(solid: Primitive) -> Surface:
    shape = {"cube": _cube, "sphere": _sphere, "cylinder": _cylinder}[solid.kind]()
    w, axis = solid.quaternion[3], solid.quaternion[:3]

    def turned(points: Floats) -> Floats:
        twist = 2.0 * np.cross(axis, points)
        result: Floats = points + w * twist + np.cross(axis, twist)
        return result

    normals = shape.normals / solid.size
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(turned(shape.vertices * solid.size) + solid.centre, turned(normals), shape.triangles)


def _cube() -> Surface:
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    vertices, normals = [], []
    for axis in range(3):
        for side in (-0.5, 0.5):
            face = np.insert(corners if side > 0 else corners[::-1], 0, side, axis=1)
            vertices.append(np.roll(face, axis, axis=1))
            normals.append(np.repeat(np.eye(3)[axis : axis + 1] * np.sign(side), 4, axis=0))
    triangles = (np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(6)[:, None, None]).reshape(-1, 3)
    return Surface(np.concatenate(vertices), np.concatenate(normals), triangles)


def _sphere() -> Surface:
    height = np.linspace(0.0, np.pi, AROUND // 2 + 1)
    around = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    ring, turn = np.meshgrid(height, around, indexing="ij")
    points = np.stack([np.sin(ring) * np.cos(turn), np.sin(ring) * np.sin(turn), np.cos(ring)], axis=-1).reshape(-1, 3)
    return Surface(points / 2.0, points, _grid(AROUND // 2, AROUND))


def _cylinder() -> Surface:
    around = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    circle = np.stack([np.cos(around), np.sin(around), np.zeros(AROUND + 1)], axis=1)
    top, bottom = circle / 2.0 + [0.0, 0.0, 0.5], circle / 2.0 - [0.0, 0.0, 0.5]
    up = np.broadcast_to([0.0, 0.0, 1.0], circle.shape)
    fan = np.stack([np.zeros(AROUND - 2), np.arange(1, AROUND - 1), np.arange(2, AROUND)], axis=1).astype(np.int64)
    ends = 2 * (AROUND + 1)
    return Surface(
        np.concatenate([top, bottom, top, bottom]),
        np.concatenate([circle, circle, up, -up]),
        np.concatenate([_grid(1, AROUND), fan + ends, fan[:, ::-1] + ends + AROUND + 1]),
    )


def _grid(rows: int, columns: int) -> Integers:
    """Two triangles for each cell of a grid of (rows + 1) x (columns + 1) vertices."""
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    below = corner + columns + 1
    return np.concatenate([np.hstack([corner, below, below + 1]), np.hstack([corner, below + 1, corner + 1])])
