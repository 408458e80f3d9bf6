"""VAMP (Thomason, Kingston and Kavraki 2024): RRT-Connect and simplification, vectorised for the Panda, as published.

Its robot is the same 59 spheres; its settings are those of its own evaluation of these problems.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from predplan.errors import PredplanError
from predplan.planning.benchmarks import Found, Prepare, Solve, points_path
from predplan.planning.peers import PeerSettings
from predplan.planning.poses import along
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Box, Capsule, Shape, Sphere

JOINTS = tuple(f"panda_joint{j}" for j in range(1, 8))
SKIPPED = 1000
"""Halton numbers by which seeds are apart."""


def make(name: str, robot: Robot, settings: PeerSettings) -> Prepare:
    """RRT-Connect for the Panda; raises PredplanError for another robot."""
    if robot.joints != JOINTS:
        raise PredplanError(f"{name}: VAMP is compiled for {', '.join(JOINTS)}; found {', '.join(robot.joints)}")
    vamp = import_module("vamp")
    panda, plan, planning, simplifying = vamp.configure_robot_and_planner_with_kwargs("panda", "rrtc")
    planning.max_iterations = planning.max_samples = settings.vamp_iterations

    def prepare(problem: Problem) -> Solve:
        environment = vamp.Environment()
        for shape in problem.scene.shapes:
            _add(vamp, environment, shape)
        start, goal = problem.start.tolist(), problem.goal.tolist()

        def solve(seed: int) -> Found:
            sampler = panda.halton()
            sampler.skip(SKIPPED * seed)
            result = plan(start, [goal], environment, planning, sampler)
            if not result.solved:
                return Found(None, f"no path in {result.iterations} iterations")
            simple = panda.simplify(result.path, environment, simplifying, sampler).path
            points = np.array([np.asarray(simple[i], dtype=np.float64) for i in range(len(simple))])
            return Found(points_path(points, problem.start, problem.goal), f"{len(points)} points")

        return solve

    return prepare


def _add(vamp: Any, environment: Any, shape: Shape) -> None:
    match shape:
        case Box():
            centre = np.asarray(shape.centre, dtype=np.float64).tolist()
            half = np.asarray(shape.half, dtype=np.float64).tolist()
            environment.add_cuboid(vamp.Cuboid(centre, fixed_angles(np.asarray(shape.rotation)), half))
        case Sphere():
            environment.add_sphere(vamp.Sphere(np.asarray(shape.centre, dtype=np.float64).tolist(), shape.radius))
        case Capsule():
            a, b = np.asarray(shape.a, dtype=np.float64), np.asarray(shape.b, dtype=np.float64)
            middle, length = ((a + b) / 2).tolist(), float(np.linalg.norm(b - a))
            environment.add_capsule(vamp.Cylinder(middle, fixed_angles(along(b - a)), shape.radius, length))
        case _:
            raise PredplanError(f"{shape.name}: VAMP knows boxes, spheres and capsules only")


def fixed_angles(rotation: FloatArray) -> list[float]:
    """Angles (rad) about the fixed axes x, y, z of a rotation Rz Ry Rx [3, 3]."""
    pitch = np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0))
    if abs(rotation[2, 0]) > 1.0 - 1e-9:  # x and z turn about one axis: all of it is given to x
        return [float(np.arctan2(-rotation[1, 2], rotation[1, 1])), float(pitch), 0.0]
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return [float(roll), float(pitch), float(np.arctan2(rotation[1, 0], rotation[0, 0]))]
