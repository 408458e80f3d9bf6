"""MuJoCo's geoms as solids, as its viewer shows them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from predplan.artifacts.recordings import Colour, FloatArray, IntArray, Mesh, Primitive, Solid

SHOWN_GROUPS = 3
"""Groups of geoms below this one are shown, those from it on are not: MuJoCo's viewer does the same."""

_AROUND, _RINGS = 24, 6
"""Corners around a capsule, and rings of each of its caps."""
_UNSET = [0.5, 0.5, 0.5, 1.0]
"""A geom of MuJoCo's default colour takes that of its material."""


def is_shown(model: Any, geom: int) -> bool:
    """Whether the viewer shows it."""
    return bool(model.geom_group[geom] < SHOWN_GROUPS and colour_of(model, geom)[3] > 0.0)


def colour_of(model: Any, geom: int) -> Colour:
    """Its own, else its material's."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    r, g, b, a = (model.mat_rgba[material] if material >= 0 and np.allclose(own, _UNSET) else own).tolist()
    return r, g, b, a


def geom_solids(
    model: Any,
    geom: int,
    name: str,
    frame: str,
    rotation: FloatArray,
    centre: FloatArray,
    colour: Colour,
    swell: float = 1.0,
) -> Iterator[Solid]:
    """The geom at rotation [3, 3] and centre [3] m of the frame, `swell` times as thick as it is.

    A capsule is a mesh. A plane, and whatever else has no end, is no solid.
    """
    import mujoco

    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), 2.0 * swell * model.geom_size[geom]
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, np.ascontiguousarray(rotation, np.float64).ravel())
    turn = np.roll(turn, -1)  # MuJoCo's have w first, recordings last
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        vertices, triangles = _capsule(size[0] / 2.0, float(model.geom_size[geom][1]))
        yield Mesh(name, vertices @ rotation.T + centre, triangles, colour, frame)
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = swell * model.mesh_vert[first : first + count].astype(np.float64) @ rotation.T
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = model.mesh_face[first : first + count].astype(np.int64)
        yield Mesh(name, vertices + centre, faces, colour, frame)
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        yield Primitive(name, "cube", centre, turn, size, colour, frame)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        yield Primitive(name, "cylinder", centre, turn, size[[0, 0, 1]], colour, frame)
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        yield Primitive(name, "sphere", centre, turn, size[[0, 0, 0]], colour, frame)
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        yield Primitive(name, "sphere", centre, turn, size, colour, frame)


def _capsule(radius: float, half: float) -> tuple[FloatArray, IntArray]:
    """Vertices and triangles about z: one closed surface, so that a translucent capsule shows no ends within."""
    bend = np.linspace(0.0, np.pi / 2.0, _RINGS + 1)
    bend = np.concatenate([bend, np.pi / 2.0 + bend])
    turn = np.arange(_AROUND) * 2.0 * np.pi / _AROUND
    along = radius * np.cos(bend) + np.repeat([half, -half], _RINGS + 1)
    across = radius * np.sin(bend)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    plane, height = across[:, None, None] * ring, np.repeat(along[:, None, None], _AROUND, axis=1)
    vertices = np.concatenate([plane, height], axis=2).reshape(-1, 3)
    a = (np.arange(len(bend) - 1)[:, None] * _AROUND + np.arange(_AROUND)).ravel()
    b = a + np.where(a % _AROUND == _AROUND - 1, 1 - _AROUND, 1)
    triangles = np.concatenate([np.stack(one, axis=1) for one in ((a, a + _AROUND, b), (b, a + _AROUND, b + _AROUND))])
    sides = vertices[triangles[:, 1:]] - vertices[triangles[:, :1]]
    at_a_pole = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) < 1e-12
    return vertices, triangles[~at_a_pole]
