"""RRT-Connect and shortcuts on robots of which every answer is known."""

from itertools import pairwise

import numpy as np
import pytest

from predplan.planning.collisions import valid
from predplan.planning.robots import FloatArray, planar_arm, point_robot
from predplan.planning.sampling import connect, motion_is_valid, resampled, shortcut
from predplan.planning.scenes import Box, Scene, make_scene

POINT = point_robot(0.02)
WALL = make_scene([Box([0.5, 0.4, 0.0], [0.02, 0.4, 1.0], name="wall")])  # open above y = 0.8
CLOSED = make_scene([Box([0.5, 0.5, 0.0], [0.02, 1.0, 1.0])])
START, GOAL = np.array([0.1, 0.1]), np.array([0.9, 0.1])


def search(scene: Scene, seed: int = 0, iterations: int = 2000, reach: float = 0.3) -> FloatArray:
    generator = np.random.default_rng(seed)
    return connect(POINT.chain, scene.obstacles, START, GOAL, generator, reach, 0.01, 0.0, iterations)


def follows(scene: Scene, points: FloatArray) -> bool:
    """Whether every sample of the polyline, ten times finer than the search looked, is valid."""
    rows = [a + (b - a) * u for a, b in pairwise(points) for u in np.linspace(0, 1, 1001)]
    return all(valid(POINT.chain, scene.obstacles, row, 0.0) for row in rows)


@pytest.mark.parametrize("seed", range(5))
def test_a_way_around_is_found_and_shortened(seed: int) -> None:
    points = search(WALL, seed)
    np.testing.assert_array_equal(points[[0, -1]], [START, GOAL])
    assert max(np.linalg.norm(np.diff(points, axis=0), axis=1)) <= 0.3 + 1e-9
    assert follows(WALL, points)
    shorter = shortcut(POINT.chain, WALL.obstacles, points, np.random.default_rng(seed), 100, 0.01, 0.0)
    np.testing.assert_array_equal(shorter[[0, -1]], [START, GOAL])
    assert follows(WALL, shorter)
    lengths = [np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in (points, shorter)]
    least = 2 * np.hypot(0.4 - 0.02, 0.7) + 0.04
    assert least - 0.05 < lengths[1] <= lengths[0] + 1e-12
    assert lengths[1] < 1.1 * least


def test_the_straight_way_is_taken_where_it_is_free() -> None:
    np.testing.assert_array_equal(search(make_scene([])), [START, GOAL])


def test_no_way_is_no_rows() -> None:
    assert search(CLOSED, iterations=300).shape == (0, 2)


def test_the_same_generator_gives_the_same_way() -> None:
    np.testing.assert_array_equal(search(WALL, 3), search(WALL, 3))
    assert search(WALL, 3).shape != search(WALL, 4).shape or np.any(search(WALL, 3) != search(WALL, 4))


def test_motions_are_looked_at_as_finely_as_asked() -> None:
    arm = planar_arm([1.0, 1.0], radius=0.02)
    thin = make_scene([Box([1.0, 1.0, 0.0], [0.05, 0.001, 0.05])])
    a, b = np.array([0.0, 0.0]), np.array([np.pi / 2, 0.0])
    assert motion_is_valid(arm.chain, make_scene([]).obstacles, a, b, 0.1, 0.0)
    assert not motion_is_valid(arm.chain, thin.obstacles, a, b, 0.005, 0.0)
    assert motion_is_valid(arm.chain, thin.obstacles, a, a, 0.005, 0.0)


def test_a_margin_narrows_what_is_valid() -> None:
    gap = make_scene([Box([0.5, 0.0, 0.0], [0.02, 0.46, 1.0]), Box([0.5, 1.0, 0.0], [0.02, 0.46, 1.0])])
    a, b = np.array([0.1, 0.5]), np.array([0.9, 0.5])
    assert motion_is_valid(POINT.chain, gap.obstacles, a, b, 0.01, 0.015)
    assert not motion_is_valid(POINT.chain, gap.obstacles, a, b, 0.01, 0.025)


def test_a_polyline_is_resampled_by_its_length() -> None:
    points = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]])
    expected = [[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [3.0, 0.5], [3.0, 1.0]]
    np.testing.assert_allclose(resampled(points, np.array([0.0, 0.25, 0.75, 0.875, 1.0])), expected)
    np.testing.assert_array_equal(resampled(points[:1].repeat(2, axis=0), np.array([0.0, 0.5, 1.0])), np.zeros((3, 2)))
