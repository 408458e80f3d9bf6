"""What a task's bodies look like and where they are: MuJoCo's geoms as solids, and their poses over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import mujoco
import numpy as np

from predplan.artifacts.recordings import WORLD, Colour, Mesh, Primitive, Solid, Transforms
from predplan.control.tasks import FloatArray, IntArray, find_task

SHOWN_GROUPS = 3
"""Groups of geoms below this one are shown, those from it on are not: MuJoCo's viewer does the same."""

_AROUND, _RINGS = 24, 6
"""Corners around a capsule, and rings of each of its caps."""
_UNSET = [0.5, 0.5, 0.5, 1.0]
"""A geom of MuJoCo's default colour takes that of its material."""


def task_model(task: str) -> Any:
    """The task's MuJoCo model. Raises InputError for an unknown task."""
    found = find_task(task)
    with gymnasium.make(found.identity if found else task) as made:
        environment: Any = made.unwrapped
        return environment.model


def coordinates(model: Any) -> tuple[tuple[str, str], ...]:
    """Name and unit of each of the model's positions; a joint of several numbers counts them."""
    names: list[tuple[str, str]] = []
    for j in range(model.njnt):
        kind, name = mujoco.mjtJoint(int(model.jnt_type[j])), model.joint(j).name or f"joint{j}"
        if kind == mujoco.mjtJoint.mjJNT_HINGE:
            names.append((name, "rad"))
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
            names.append((name, "m"))
        else:
            places = 3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0
            names += [(f"{name}.{k}", "m" if k < places else "1") for k in range(places + 4)]
    return tuple(names)


def body_names(model: Any, prefix: str = "") -> tuple[str, ...]:
    """Of all bodies but the world, which is not moved."""
    return tuple(f"{prefix}{model.body(b).name or f'body{b}'}" for b in range(1, model.nbody))


def body_poses(model: Any, times: FloatArray, configurations: FloatArray, prefix: str = "") -> Transforms:
    """Poses of all bodies in the world at times [n] s and positions [n, nq]; `prefix` begins their frames' names."""
    data = mujoco.MjData(model)
    names = body_names(model, prefix)
    translation, quaternion = np.empty((len(times), len(names), 3)), np.empty((len(times), len(names), 4))
    for i, q in enumerate(configurations):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        translation[i], quaternion[i] = data.xpos[1:], data.xquat[1:]
    return Transforms(times, (WORLD,) * len(names), names, translation, _xyzw(quaternion))


def body_solids(
    model: Any, prefix: str = "", colour: Callable[[Colour], Colour] | None = None, swell: float = 1.0
) -> tuple[Solid, ...]:
    """The geoms of moving bodies that MuJoCo's viewer shows, in the frames of their bodies, whose names they share.

    colour: of a geom's own; swell: times as thick as it is, so that of two in one place one encloses the other.
    """
    names = body_names(model, prefix)
    return tuple(
        solid
        for g in range(model.ngeom)
        if model.geom_bodyid[g] and _shown(model, g)
        for frame in [names[int(model.geom_bodyid[g]) - 1]]
        for solid in _geom(
            model, g, frame, frame, colour(_colour_of(model, g)) if colour else _colour_of(model, g), swell
        )
    )


def standing_solids(model: Any, colour: Callable[[Colour], Colour] | None = None) -> tuple[Solid, ...]:
    """The geoms fixed to the world that MuJoCo's viewer shows, likewise. A ground is no solid: see `ground_height`."""
    return tuple(
        solid
        for g in range(model.ngeom)
        if not model.geom_bodyid[g] and _shown(model, g)
        for own in [_colour_of(model, g)]
        for solid in _geom(model, g, model.geom(g).name or f"geom{g}", WORLD, colour(own) if colour else own, 1.0)
    )


def ground_height(model: Any) -> float | None:
    """z (m) of the ground; None where there is none."""
    for g in range(model.ngeom):
        if model.geom_bodyid[g] == 0 and model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE:
            return float(model.geom_pos[g][2])
    return None


def _shown(model: Any, geom: int) -> bool:
    return bool(model.geom_group[geom] < SHOWN_GROUPS and _colour_of(model, geom)[3] > 0.0)


def _geom(model: Any, geom: int, name: str, frame: str, colour: Colour, swell: float) -> Iterator[Solid]:
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), 2.0 * swell * model.geom_size[geom]
    centre, turn = model.geom_pos[geom].copy(), _xyzw(model.geom_quat[geom])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        vertices, triangles = _capsule(size[0] / 2.0, float(model.geom_size[geom][1]))
        yield Mesh(name, vertices @ _rotation(model.geom_quat[geom]).T + centre, triangles, colour, frame)
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = (
            swell * model.mesh_vert[first : first + count].astype(np.float64) @ _rotation(model.geom_quat[geom]).T
        )
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


def _colour_of(model: Any, geom: int) -> Colour:
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    r, g, b, a = (model.mat_rgba[material] if material >= 0 and np.allclose(own, _UNSET) else own).tolist()
    return r, g, b, a


def _rotation(quaternion: FloatArray) -> FloatArray:
    """Matrix of MuJoCo's quaternion, w first."""
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)


def _xyzw(quaternion: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.roll(quaternion, -1, axis=-1))
