"""Robots made in code, and the bounds on how far joints move their spheres."""

from pathlib import Path

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning.kinematics import forward, frames, tool_trace
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import Robot, enclosing_sphere, planar_arm, point_robot
from tests.planning.models import TREE, bench_file, write


def largest_motion(robot: Robot, draws: int, seed: int) -> np.ndarray:
    """Over random configurations, the farthest that each sphere's centre was from each joint's axis [S, D]."""
    chain, generator = robot.chain, np.random.default_rng(seed)
    joints, spheres = len(chain.lower), len(chain.sphere_radius)
    rotations, positions, centres = np.empty((joints + 1, 3, 3)), np.empty((joints + 1, 3)), np.empty((spheres, 3))
    most = np.zeros((spheres, joints))
    ends = np.stack([chain.lower, chain.upper])
    for i in range(draws):
        q = generator.uniform(chain.lower, chain.upper)
        if i % 2:  # bounds are often reached where joints are at their limits
            q = np.where(generator.random(joints) < 0.5, ends[generator.integers(0, 2, joints), np.arange(joints)], q)
        forward(chain, q, rotations, positions, centres)
        for j in range(joints):
            axis = rotations[j + 1] @ chain.axis[j]
            arms = centres - positions[j + 1]
            away = np.linalg.norm(np.cross(axis, arms), axis=1) if not chain.prismatic[j] else np.ones(spheres)
            most[:, j] = np.maximum(most[:, j], away * chain.moves[chain.sphere_frame, j])
    return most


def test_levers_bound_every_configuration_and_not_by_far(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, "tree.xml", TREE), joints=list("abcdefg"))
    most = largest_motion(robot, 3000, 0)
    assert np.all(most <= robot.chain.lever + 1e-9)
    assert np.all((most > 0) == (robot.chain.lever > 0))
    arm = planar_arm([0.4, 0.3, 0.2])
    np.testing.assert_allclose(arm.chain.lever[-1], [0.9, 0.5, 0.2])


def test_levers_of_the_panda() -> None:
    robot = read_robot(bench_file("panda_spherized.urdf"))
    most = largest_motion(robot, 5000, 1)
    assert np.all(most <= robot.chain.lever + 1e-9)
    assert np.max(robot.chain.lever / np.maximum(most, 0.05)) < 2.0


def test_a_planar_arm_reaches_what_its_links_add_up_to() -> None:
    arm = planar_arm([0.5, 0.25], base=(1.0, 2.0))
    tips = tool_trace(arm.chain, np.array([[0.0, 0.0], [np.pi / 2, 0.0], [0.0, np.pi / 2]]))
    np.testing.assert_allclose(tips, [[1.75, 2.0, 0.0], [1.0, 2.75, 0.0], [1.5, 2.25, 0.0]], atol=1e-12)
    assert len(arm.chain.link_pairs) == 0
    assert planar_arm([1.0, 1.0, 1.0, 1.0]).chain.link_pairs.tolist() == [[0, 2], [0, 3], [1, 3]]
    with pytest.raises(InputError, match=r"lengths \[1.0, -1.0\]"):
        planar_arm([1.0, -1.0])


def test_a_point_robot_is_where_its_joints_say() -> None:
    point = point_robot(0.1, [-1.0, -2.0], [1.0, 2.0])
    rotations, positions = np.empty((3, 3, 3)), np.empty((3, 3))
    frames(point.chain, np.array([0.3, -1.5]), rotations, positions)
    np.testing.assert_allclose(positions[2], [0.3, -1.5, 0.0])
    assert point.joints == ("x", "y")
    assert point.chain.upper.tolist() == [1.0, 2.0]
    with pytest.raises(InputError, match="limits that rise"):
        point_robot(0.1, 1.0, 1.0)


def test_an_enclosing_sphere_holds_its_spheres_and_is_nearly_smallest() -> None:
    generator = np.random.default_rng(2)
    for _ in range(20):
        centres, radii = generator.standard_normal((12, 3)), generator.uniform(0.0, 0.5, 12)
        centre, radius = enclosing_sphere(centres, radii)
        assert np.all(np.linalg.norm(centres - centre, axis=1) + radii <= radius + 1e-12)
        apart = np.linalg.norm(centres[:, None] - centres[None], axis=2) + radii[:, None] + radii[None]
        assert radius >= apart.max() / 2 - 1e-12
        assert radius <= np.sqrt(3 / 8) * apart.max() * 1.05  # Jung: the diameter bounds it; 5% for the iteration
