"""Starts and goals as a user gives them: refused with what is wrong, by name."""

import numpy as np

from predplan.errors import InputError
from predplan.planning.collisions import nearest_names, valid
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Scene


def configuration(robot: Robot, scene: Scene, name: str, q: FloatArray) -> FloatArray:
    """q as an array [D], valid in the scene; raises InputError, with its `name` and what it is not."""
    chain = robot.chain
    q = np.ascontiguousarray(q, dtype=np.float64)
    if q.shape != (len(robot.joints),):
        raise InputError(f"{name} has shape {q.shape}; expected one value for each of {', '.join(robot.joints)}")
    if not np.all(np.isfinite(q)):
        at = [joint for joint, value in zip(robot.joints, q, strict=True) if not np.isfinite(value)]
        raise InputError(f"{name} is not finite at {', '.join(at)}")
    outside = [
        f"{joint} is {value:.4f}, allowed {low:.4f} to {high:.4f}"
        for joint, value, low, high in zip(robot.joints, q, chain.lower, chain.upper, strict=True)
        if not low - 1e-9 <= value <= high + 1e-9
    ]
    if outside:
        raise InputError(f"{name} is outside the joint limits: {'; '.join(outside)}")
    if not valid(chain, scene.obstacles, q, 0.0):
        met = "; ".join(f"{a} and {b}, {depth:.4f} m deep" for a, b, depth in nearest_names(robot, scene, q))
        raise InputError(f"{name} is in collision: {met}")
    return q
