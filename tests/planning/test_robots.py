"""Robots made in code, and what holds their spheres."""

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning.kinematics import frames, tool_trace
from predplan.planning.robots import enclosing_sphere, planar_arm, point_robot


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
