"""Scenes and requests from the formats of the field: MoveIt's YAML, and MJCF for scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np

from predplan.errors import InputError
from predplan.planning.moveit import CylinderKind, Primitives, goal_values, load_yaml, scene_shapes, start_values
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Cylinder, Scene, make_scene


@dataclass(frozen=True)
class Request:
    """A start and a goal by joint name (rad or m), as the file has them: the start may name joints not planned."""

    group: str
    start: Mapping[str, float]
    goal: Mapping[str, float]
    source: str

    def configurations(self, robot: Robot) -> tuple[FloatArray, FloatArray]:
        """Start and goal [D] in the robot's order.

        Raises InputError where a planned joint is missing from either, or the goal names one that is not planned.
        """
        for name, values in (("start", self.start), ("goal", self.goal)):
            missing = [joint for joint in robot.joints if joint not in values]
            if missing:
                raise InputError(f"{self.source}: the {name} has no {', '.join(missing)}; it has {', '.join(values)}")
        unknown = [joint for joint in self.goal if joint not in robot.joints and joint not in robot.fixed]
        if unknown:
            raise InputError(
                f"{self.source}: the goal names {', '.join(unknown)}; {robot.name} plans {', '.join(robot.joints)}"
            )
        start, goal = (np.array([values[joint] for joint in robot.joints]) for values in (self.start, self.goal))
        return start, goal


def read_scene(
    path: Path | str,
    *,
    cylinders_as: CylinderKind = "cylinder",
    primitives: Primitives = "all",
    exclude_bodies: Sequence[str] | None = None,
) -> Scene:
    """A scene from MoveIt YAML (.yaml, .yml) or from the bodies of an MJCF (.xml).

    Software differs in what it takes a MoveIt cylinder for. Cylinders as they are therefore come with two larger
    scenes, in which they are held by their capsules and boxes, and by their boxes; a planner takes the largest that
    leaves start and goal free, so that its plan holds for every reader of the file.

    cylinders_as: cylinders as they are, as capsules with the same length between the centres of their ends, or as the
    boxes that hold them. primitives: all of each MoveIt object, or its first (as the published motion-bench does).
    exclude_bodies: MJCF bodies left out, with all they carry; by default the trees that actuators drive, which are
    robots. MoveIt poses are taken in the world's frame. Bodies stand where MJCF's own coordinates put them.
    Raises InputError with file, object and field for what is missing, not finite, of a wrong size or not supported.
    """
    for key, value, allowed in (
        ("cylinders_as", cylinders_as, get_args(CylinderKind)),
        ("primitives", primitives, get_args(Primitives)),
    ):
        if value not in allowed:
            raise InputError(f"{key}: unknown {value!r}; expected one of {', '.join(allowed)}")
    if Path(path).suffix.lower() in (".xml", ".mjcf"):
        from predplan.planning.mjcf import read_mjcf_shapes  # MuJoCo is needed for its own format only

        name, shapes = read_mjcf_shapes(path, exclude_bodies)
        return make_scene(shapes, name, str(path))
    content = load_yaml(path, "a planning scene with world.collision_objects")
    if "world" not in content:
        raise InputError(f"{path}: no field world; expected a planning scene with world.collision_objects")
    variants = {kind: list(scene_shapes(content, path, kind, primitives)) for kind in get_args(CylinderKind)}
    name, source = str(content.get("name") or Path(path).stem), str(path)
    scene = make_scene(variants[cylinders_as], name, source)
    if cylinders_as != "cylinder" or not len(scene.obstacles.cylinder_radius):
        return scene
    pairs = zip(variants["capsule"], variants["cylinder"], strict=True)
    caps = [cap for cap, solid in pairs if isinstance(solid, Cylinder)]
    held = (make_scene([*variants["box"], *caps], name, source), make_scene(variants["box"], name, source))
    return replace(scene, larger=held)


def read_request(path: Path | str) -> Request:
    """A start and a joint goal from a MoveIt motion-plan request; of several goals the first.

    Raises InputError where either is missing, is not finite, or is not in joint space.
    """
    content = load_yaml(path, "a motion-plan request with start_state and goal_constraints")
    return Request(
        str(content.get("group_name") or ""),
        start_values(content, str(path)),
        goal_values(content, str(path)),
        str(path),
    )
