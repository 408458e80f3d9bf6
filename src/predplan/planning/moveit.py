"""MoveIt's planning-scene and motion-plan-request messages, written as YAML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from predplan.errors import InputError
from predplan.planning.poses import Pose, along, from_quaternion, identity
from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, moved

CylinderKind = Literal["cylinder", "capsule", "box"]
Primitives = Literal["all", "first"]

KINDS = {"box": 3, "sphere": 1, "cylinder": 2}
NUMBERED = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
PLANE_EXTENT = 20.0
"""m: half the side of the square that stands for a plane, and its depth below the plane."""


def load_yaml(path: Path | str, what: str) -> Mapping[str, Any]:
    """The mapping that a YAML file holds; raises InputError with file and line where the text is not YAML."""
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; expected {what}")
    try:
        with open(path, encoding="utf-8") as file:
            content = yaml.load(file, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark is not None else "?"
        raise InputError(f"{path}:{line}: not YAML ({getattr(error, 'problem', None) or error})") from error
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: found {_kind(content)}; expected {what}")
    return content


def scene_shapes(
    content: Mapping[str, Any], path: Path | str, cylinders_as: CylinderKind, primitives: Primitives
) -> Iterator[Shape]:
    """The shapes of a planning scene's collision objects, in the world.

    cylinders_as: capsules keep the cylinder's length between the centres of their ends, boxes hold the cylinder.
    """
    world = _mapping(content.get("world"), f"{path}: world")
    octomap = _mapping(world.get("octomap"), f"{path}: world.octomap")
    if _mapping(octomap.get("octomap"), f"{path}: world.octomap.octomap").get("data"):
        raise InputError(f"{path}: world.octomap holds data; octomaps are not read, expected collision objects")
    attached = _mapping(content.get("robot_state"), f"{path}: robot_state").get("attached_collision_objects")
    if attached:
        raise InputError(f"{path}: robot_state.attached_collision_objects: objects in the hand are not read")
    for number, item in enumerate(_list(world.get("collision_objects"), f"{path}: world.collision_objects")):
        entry = _mapping(item, f"{path}: collision object {number}")
        name = str(entry.get("id") or f"object{number}")
        where = f"{path}: {name}"
        outer = _pose(entry["pose"], f"{where}: pose") if entry.get("pose") else identity()
        parts = list(_parts(entry, name, where, cylinders_as, primitives))
        for k, (shape, pose) in enumerate(parts):
            label = name if len(parts) == 1 else f"{name}[{k}]"
            yield _renamed(moved(shape, *outer.then(pose)), label)


def joint_values(names: object, positions: object, where: str) -> dict[str, float]:
    """A joint state; raises InputError for lists of different length, and positions that are not finite numbers."""
    joints, values = _list(names, f"{where}.name"), _list(positions, f"{where}.position")
    if len(joints) != len(values):
        raise InputError(f"{where}: {len(joints)} names and {len(values)} positions; expected as many of both")
    return {str(joint): _number(value, f"{where}: {joint}") for joint, value in zip(joints, values, strict=True)}


def goal_values(content: Mapping[str, Any], where: str) -> dict[str, float]:
    """The joint constraints of a request's first goal; raises InputError if it has another kind of constraint."""
    goals = _list(content.get("goal_constraints"), f"{where}: goal_constraints")
    if not goals:
        raise InputError(f"{where}: no goal_constraints; expected joint_constraints")
    goal = _mapping(goals[0], f"{where}: goal_constraints[0]")
    for other in ("position_constraints", "orientation_constraints", "visibility_constraints"):
        if goal.get(other):
            raise InputError(f"{where}: goal_constraints[0] has {other}; expected joint_constraints alone")
    values: dict[str, float] = {}
    for number, item in enumerate(_list(goal.get("joint_constraints"), f"{where}: joint_constraints")):
        constraint = _mapping(item, f"{where}: joint_constraints[{number}]")
        if "joint_name" not in constraint or "position" not in constraint:
            raise InputError(f"{where}: joint_constraints[{number}] has no joint_name or no position")
        joint = str(constraint["joint_name"])
        values[joint] = _number(constraint["position"], f"{where}: goal position of {joint}")
    if not values:
        raise InputError(f"{where}: goal_constraints[0] has no joint_constraints")
    return values


def start_values(content: Mapping[str, Any], where: str) -> dict[str, float]:
    """The joint state of a request's start."""
    state = _mapping(content.get("start_state"), f"{where}: start_state").get("joint_state")
    if not state:
        raise InputError(f"{where}: no start_state.joint_state; expected names and positions")
    state = _mapping(state, f"{where}: start_state.joint_state")
    return joint_values(state.get("name"), state.get("position"), f"{where}: start_state.joint_state")


def _parts(
    entry: Mapping[str, Any], name: str, where: str, cylinders_as: CylinderKind, primitives: Primitives
) -> Iterator[tuple[Shape, Pose]]:
    solids, poses = _placed(entry, "primitives", "primitive_poses", where)
    if primitives == "first":
        solids, poses = solids[:1], poses[:1]
    for k, (solid, pose) in enumerate(zip(solids, poses, strict=True)):
        yield _primitive(_mapping(solid, f"{where}: primitives[{k}]"), f"{where}: primitives[{k}]", cylinders_as), pose
    if primitives == "first" and solids:
        return
    for k, (mesh, pose) in enumerate(zip(*_placed(entry, "meshes", "mesh_poses", where), strict=True)):
        at = f"{where}: meshes[{k}]"
        vertices = [_vector(v, 3, f"{at}: vertices") for v in _list(_mapping(mesh, at).get("vertices"), at)]
        if len(vertices) < 4:
            raise InputError(f"{at}: {len(vertices)} vertices; expected at least 4")
        yield Mesh(np.array(vertices), name), pose
    for k, (plane, pose) in enumerate(zip(*_placed(entry, "planes", "plane_poses", where), strict=True)):
        yield _plane(_mapping(plane, f"{where}: planes[{k}]"), f"{where}: planes[{k}]"), pose


def _placed(entry: Mapping[str, Any], key: str, pose_key: str, where: str) -> tuple[list[Any], list[Pose]]:
    """Things and their poses; poses may be missing altogether, if the object has a pose of its own."""
    things = list(_list(entry.get(key), f"{where}: {key}"))
    poses = [_pose(pose, f"{where}: {pose_key}[{k}]") for k, pose in enumerate(_list(entry.get(pose_key), where))]
    if not poses and entry.get("pose"):
        poses = [identity() for _ in things]
    if len(poses) != len(things):
        raise InputError(f"{where}: {len(things)} {key} and {len(poses)} {pose_key}; expected as many of both")
    return things, poses


def _primitive(solid: Mapping[str, Any], where: str, cylinders_as: CylinderKind) -> Shape:
    given = solid.get("type")
    kind = NUMBERED.get(given, str(given)) if isinstance(given, int) else str(given).lower()
    if kind not in KINDS:
        raise InputError(f"{where}: type {given!r}; expected {', '.join(KINDS)}")
    sizes = _vector(solid.get("dimensions"), KINDS[kind], f"{where} ({kind}): dimensions")
    if np.any(sizes <= 0):
        raise InputError(f"{where} ({kind}): dimensions are {sizes.tolist()}; expected more than zero")
    if kind == "box":
        return Box(np.zeros(3), sizes / 2)
    if kind == "sphere":
        return Sphere(np.zeros(3), float(sizes[0]))
    height, radius = sizes.tolist()
    if cylinders_as == "capsule":
        return Capsule(np.array([0, 0, -height / 2]), np.array([0, 0, height / 2]), radius)
    if cylinders_as == "box":
        return Box(np.zeros(3), np.array([radius, radius, height / 2]))
    return Cylinder(np.zeros(3), height / 2, radius)


def _plane(plane: Mapping[str, Any], where: str) -> Box:
    """ax + by + cz + d = 0 as a large box below it."""
    a, b, c, d = _vector(plane.get("coef"), 4, f"{where}: coef")
    length = float(np.linalg.norm([a, b, c]))
    if length == 0.0:
        raise InputError(f"{where}: coef is {[a, b, c, d]}; expected a normal that is not zero")
    normal = np.array([a, b, c]) / length
    return Box(normal * (-d / length - PLANE_EXTENT / 2), [PLANE_EXTENT, PLANE_EXTENT, PLANE_EXTENT / 2], along(normal))


def _pose(entry: object, where: str) -> Pose:
    pose = _mapping(entry, where)
    position, orientation = pose.get("position"), pose.get("orientation")
    translation = _vector(position, 3, f"{where}: position") if position is not None else np.zeros(3)
    if orientation is None:
        return Pose(np.eye(3), translation)
    x, y, z, w = _vector(orientation, 4, f"{where}: orientation")
    if x == y == z == w == 0.0:
        raise InputError(f"{where}: orientation is 0 0 0 0; expected a quaternion x y z w")
    return Pose(from_quaternion(w, x, y, z), translation)


def _vector(value: object, size: int, where: str) -> FloatArray:
    if isinstance(value, Mapping):
        value = [value.get(key, np.nan) for key in "xyzw"[:size]]
    values = [_number(number, where) for number in _list(value, where)]
    if len(values) != size:
        raise InputError(f"{where}: found {len(values)} numbers; expected {size}")
    return np.array(values)


def _number(value: object, where: str) -> float:
    # YAML 1.1 reads 1e-05 as text, so text is tried as well.
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else np.nan
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{where}: found {value!r}; expected a finite number")
    return number


def _mapping(value: object, where: str) -> Mapping[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: found {_kind(value)}; expected a mapping")
    return value


def _list(value: object, where: str) -> Sequence[Any]:
    if value is None:
        return []
    if not isinstance(value, list | tuple):
        raise InputError(f"{where}: found {_kind(value)}; expected a list")
    return value


def _renamed(shape: Shape, name: str) -> Shape:
    return replace(shape, name=name)


def _kind(value: object) -> str:
    return "nothing" if value is None else f"{type(value).__name__} {str(value)[:40]!r}"
