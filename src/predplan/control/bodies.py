"""What a task's bodies look like and where they are: MuJoCo's geoms as solids, and their poses over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import mujoco
import numpy as np

from predplan.artifacts.geoms import colour_of, geom_solids, is_shown
from predplan.artifacts.recordings import WORLD, Colour, Solid, Transforms
from predplan.control.tasks import FloatArray, find_task


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
        if model.geom_bodyid[g] and is_shown(model, g)
        for frame in [names[int(model.geom_bodyid[g]) - 1]]
        for solid in _solids(model, g, frame, frame, colour, swell)
    )


def standing_solids(model: Any, colour: Callable[[Colour], Colour] | None = None) -> tuple[Solid, ...]:
    """The geoms fixed to the world that MuJoCo's viewer shows, likewise. A ground is no solid: see `ground_height`."""
    return tuple(
        solid
        for g in range(model.ngeom)
        if not model.geom_bodyid[g] and is_shown(model, g)
        for solid in _solids(model, g, model.geom(g).name or f"geom{g}", WORLD, colour, 1.0)
    )


def ground_height(model: Any) -> float | None:
    """z (m) of the ground; None where there is none."""
    for g in range(model.ngeom):
        if model.geom_bodyid[g] == 0 and model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE:
            return float(model.geom_pos[g][2])
    return None


def _solids(
    model: Any, geom: int, name: str, frame: str, colour: Callable[[Colour], Colour] | None, swell: float
) -> Iterator[Solid]:
    own, rotation = colour_of(model, geom), np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    shown = colour(own) if colour else own
    return geom_solids(model, geom, name, frame, rotation.reshape(3, 3), model.geom_pos[geom].copy(), shown, swell)


def _xyzw(quaternion: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.roll(quaternion, -1, axis=-1))
