"""Validity, clearances and the workspace cost: against each other, finite differences and the published problems."""

from pathlib import Path

import numpy as np
import pytest

from predplan.planning.collisions import (
    body_cost,
    clearances,
    nearest_names,
    point_costs,
    valid,
    workspace_cost,
    worst_cost,
)
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import FloatArray, Robot, planar_arm, point_robot
from predplan.planning.scene_files import read_request, read_scene
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Scene, Sphere, make_scene
from tests.planning.models import BENCH, TREE, bench_file, write

SCENE = make_scene(
    [
        Box([0.3, 0.2, 0.5], [0.1, 0.2, 0.05], name="plank"),
        Capsule([-0.3, 0, 0], [-0.3, 0, 0.8], 0.05, name="pole"),
        Cylinder([0.0, -0.4, 0.3], 0.3, 0.1, name="can"),
        Mesh(np.random.default_rng(0).normal([0, 0.5, 0.3], 0.1, (12, 3)), name="rock"),
        Sphere([0.4, -0.3, 0.7], 0.1, name="ball"),
    ]
)


@pytest.fixture
def tree(tmp_path: Path) -> Robot:
    return read_robot(write(tmp_path, "tree.xml", TREE), joints=list("abcdefg"))


def measured(robot: Robot, scene: Scene, q: FloatArray, ceiling: float = 9.0) -> tuple[FloatArray, FloatArray]:
    spheres, pairs = np.empty(len(robot.chain.sphere_radius)), np.empty(len(robot.chain.link_pairs))
    clearances(robot.chain, scene.obstacles, q, ceiling, spheres, pairs)
    return spheres, pairs


def draws(robot: Robot, count: int, seed: int = 1) -> FloatArray:
    chain = robot.chain
    return np.random.default_rng(seed).uniform(chain.lower, chain.upper, (count, len(chain.lower)))


def test_valid_means_within_limits_and_clear_by_the_margin(tree: Robot) -> None:
    chain, found = tree.chain, set()
    for margin in (0.0, 0.03, -0.03):
        for q in draws(tree, 400):
            spheres, pairs = measured(tree, SCENE, q)
            expected = bool(spheres.min() >= margin and pairs.min() >= margin)
            assert valid(chain, SCENE.obstacles, q, margin) == expected
            found.add((margin, expected))
    assert len(found) == 6
    free = next(q for q in draws(tree, 400) if valid(chain, SCENE.obstacles, q, 0.0))
    for j in range(len(free)):
        for value in (chain.upper[j] + 1e-6, chain.lower[j] - 1e-6, np.nan, np.inf):
            outside = free.copy()
            outside[j] = value
            assert not valid(chain, SCENE.obstacles, outside, 0.0)


def test_clearances_stop_at_the_ceiling(tree: Robot) -> None:
    for q in draws(tree, 50):
        for full, cut in zip(measured(tree, SCENE, q), measured(tree, SCENE, q, 0.05), strict=True):
            np.testing.assert_allclose(cut, np.minimum(full, 0.05))


def test_what_stands_in_an_mjcf_scene_is_tried_against_links_only(tree: Robot) -> None:
    assert tree.links[0] == "base"
    assert tree.chain.scene_link == 1
    around_base = make_scene([Sphere([0.1, -0.2, 0.3], 0.06)])
    assert measured(tree, around_base, draws(tree, 1)[0])[0][0] == 9.0
    assert any(valid(tree.chain, around_base.obstacles, q, 0.0) for q in draws(tree, 100))


def test_the_cost_falls_to_zero_at_epsilon_without_a_corner() -> None:
    epsilon = 0.1
    found = np.array([workspace_cost(clearance, epsilon) for clearance in (-0.2, 0.0, 0.05, 0.1, 1.0)])
    expected = np.array([[0.25, -1.0], [0.05, -1.0], [0.0125, -0.5], [0.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_costs_are_sums_and_maxima_of_the_spheres_costs(tree: Robot) -> None:
    chain, epsilon, self_epsilon = tree.chain, 0.15, 0.08
    gradient, points = np.empty(7), np.empty(len(chain.sphere_radius))
    for q in draws(tree, 100):
        spheres, pairs = measured(tree, SCENE, q)
        expected = np.array([workspace_cost(clearance, epsilon)[0] for clearance in spheres])
        point_costs(chain, SCENE.obstacles, q, epsilon, points)
        np.testing.assert_allclose(points, expected, atol=1e-12)
        selfish = sum(workspace_cost(gap, self_epsilon)[0] for gap in pairs)
        cost, clearance = body_cost(chain, SCENE.obstacles, q, epsilon, self_epsilon, gradient)
        assert cost == pytest.approx(expected.sum() + selfish)
        near = [*spheres[spheres < epsilon], *pairs[pairs < self_epsilon]]
        assert clearance == pytest.approx(min(near, default=np.inf))
        cost, clearance = worst_cost(chain, SCENE.obstacles, q, epsilon, gradient)
        assert cost == pytest.approx(expected.max())
        assert clearance == pytest.approx(spheres.min() if spheres.min() < epsilon else np.inf)


@pytest.mark.parametrize("kind", ["body", "worst"])
def test_gradients_are_finite_differences(tree: Robot, kind: str) -> None:
    for robot, scene in (
        (tree, SCENE),
        (planar_arm([0.3, 0.3, 0.2, 0.2, 0.2]), SCENE),
        (point_robot(0.1, -0.5, 0.5), SCENE),
    ):
        chain, step = robot.chain, 1e-6
        joints = len(chain.lower)

        def cost(q: FloatArray, gradient: FloatArray, chain=chain, scene=scene) -> float:  # type: ignore[no-untyped-def]
            if kind == "body":
                return float(body_cost(chain, scene.obstacles, q, 0.2, 0.1, gradient)[0])
            return float(worst_cost(chain, scene.obstacles, q, 0.2, gradient)[0])

        touched = 0
        for q in draws(robot, 60, seed=2):
            gradient, unused = np.empty(joints), np.empty(joints)
            cost(q, gradient)
            expected = [(cost(q + step * e, unused) - cost(q - step * e, unused)) / (2 * step) for e in np.eye(joints)]
            np.testing.assert_allclose(gradient, expected, atol=2e-5)
            touched += bool(np.any(gradient))
        assert touched > 10


def test_what_touches_what_is_named_deepest_first() -> None:
    point = point_robot(0.1, -1.0, 1.0)
    scene = make_scene([Sphere([0.15, 0, 0], 0.1, "ball"), Box([-0.09, 0, 0], [0.05, 1, 1], name="wall")])
    ((link, obstacle, depth),) = nearest_names(
        point, scene, np.zeros(2)
    )  # a sphere is named with what it is nearest to
    assert (link, obstacle) == ("point", "wall")
    assert depth == pytest.approx(0.06)
    arm = planar_arm([0.5, 0.5, 0.5], limit=3.1)
    folded = nearest_names(arm, make_scene([]), np.array([0.0, 3.0, -3.0]))
    assert [(a, b) for a, b, _ in folded] == [("link1", "link3")]


def test_the_panda_counts_as_valid_where_the_benchmark_says() -> None:
    robot = read_robot(bench_file("panda_spherized.urdf"), fixed={"panda_finger_joint1": 0.065})
    requests = sorted((BENCH / "panda").glob("*/request*.yaml"))
    assert requests
    invalid = []
    for path in requests:
        scene = read_scene(
            path.with_name(path.name.replace("request", "scene")),
            cylinders_as="box" if path.parent.name.startswith("box") else "capsule",
            primitives="first",
        )
        request = read_request(path)
        for q in request.configurations(robot):
            if not valid(robot.chain, scene.obstacles, q, 0.0):
                invalid.append((path.name, nearest_names(robot, scene, q)))
    assert len(invalid) <= 1, invalid


def test_gradients_of_the_panda_are_finite_differences() -> None:
    robot = read_robot(bench_file("panda_spherized.urdf"))
    path = next(iter(sorted((BENCH / "panda").glob("*tall*/scene*.yaml"))))
    chain, obstacles, gradient = robot.chain, read_scene(path).obstacles, np.empty(7)
    for q in draws(robot, 50):
        body_cost(chain, obstacles, q, 0.1, 0.05, gradient)
        ahead, behind = (
            np.array([body_cost(chain, obstacles, q + sign * 1e-6 * e, 0.1, 0.05, np.empty(7))[0] for e in np.eye(7)])
            for sign in (1, -1)
        )
        np.testing.assert_allclose(gradient, (ahead - behind) / 2e-6, atol=2e-5)
