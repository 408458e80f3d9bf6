"""Paths drawn tight: the kernel, contacts and least norms against second implementations; what refining keeps."""

from functools import partial

import numpy as np
import pytest
import qpsolvers

from predplan.planning import Planner, PlannerSettings, certify, make_scene
from predplan.planning.certificates import MOST, Verdict, prove
from predplan.planning.collisions import clearances
from predplan.planning.contacts import Contacts, contacts
from predplan.planning.paths import Path
from predplan.planning.refining import Refined, Refiner, RefinerSettings, haste
from predplan.planning.robots import FloatArray, Robot, planar_arm, point_robot
from predplan.planning.scenes import Box, Scene, Sphere
from predplan.planning.tension import Tension
from predplan.planning.tightening import joint_weights, least_norm, loop_of
from predplan.planning.timing import parametrise

ARM = planar_arm([0.5, 0.4, 0.3], radius=0.03)
POST = make_scene([Sphere([0.9, 0.35, 0.0], 0.1, "post")], "post")
START, GOAL = np.array([-0.1, 0.2, 0.0]), np.array([1.3, 0.2, 0.1])


@pytest.mark.parametrize("width", [0.05, 0.12, 0.5])
def test_the_tension_kernel_reproduces_values_in_the_energys_inner_product(width: float) -> None:
    """⟨k(., a), k(., b)⟩ = ∫ ḟ ġ + width² f̈ g̈ dt = k(a, b), by quadrature; representers vanish at both ends."""
    kernel = Tension(width)
    points, steps = np.array([0.13, 0.4, 0.81]), 20_000
    t = (np.arange(steps) + 0.5) / steps
    first, second = kernel.gram(t, points, 1), kernel.gram(t, points, 2)
    np.testing.assert_allclose(
        (first.T @ first + width**2 * second.T @ second) / steps, kernel.gram(points, points), atol=1e-6
    )
    np.testing.assert_allclose(kernel.gram(np.array([0.0, 1.0]), points), 0.0, atol=1e-12)
    np.testing.assert_allclose(kernel.gram(np.array([0.0, 1.0]), points, 2), 0.0, atol=1e-9)


def signed(robot: Robot, scene: Scene, q: FloatArray) -> FloatArray:
    """All clearances at q [S + P], however far."""
    spheres, pairs = np.empty(len(robot.chain.sphere_radius)), np.empty(len(robot.chain.link_pairs))
    clearances(robot.chain, scene.obstacles, q, 9.0, spheres, pairs)
    return np.concatenate([spheres, pairs])


def test_contacts_are_all_that_is_near_with_the_gradient_of_its_clearance() -> None:
    scene = make_scene([Sphere([0.9, 0.35, 0.0], 0.1), Box([0.4, -0.4, 0.0], [0.2, 0.1, 0.1])])
    generator, seen, pairs = np.random.default_rng(0), 0, 0
    for _ in range(200):
        q = generator.uniform(-2.8, 2.8, (1, 3))
        near = contacts(ARM.chain, scene.obstacles, q, 0.05, 0.04, 99)
        values = signed(ARM, scene, q[0])
        spheres = len(ARM.chain.sphere_radius)
        ceiling = np.where(np.arange(len(values)) < spheres, 0.05, 0.04)
        expected = values[values < ceiling]
        np.testing.assert_allclose(np.sort(near.clearance), np.sort(expected), atol=1e-12)
        h = 1e-6
        moves = [(signed(ARM, scene, q[0] + h * e) - signed(ARM, scene, q[0] - h * e)) / (2 * h) for e in np.eye(3)]
        slopes = np.stack(moves, axis=1)
        for clearance, gradient in zip(near.clearance, near.gradient, strict=True):
            row = int(np.argmin(np.abs(values - clearance)))
            if np.ptp(np.sort(np.abs(values - clearance))[:2]) > 1e-3:  # no second one that it could be mistaken for
                np.testing.assert_allclose(gradient, slopes[row], atol=1e-5)
                seen += 1
                pairs += row >= spheres
    assert seen > 100
    assert pairs > 10


def test_there_is_room_for_so_many_contacts_and_no_more() -> None:
    q = np.repeat([[0.3, 0.2, 0.1]], 5, axis=0)
    scene = make_scene([Sphere([0.5, 0.2, 0.0], 0.1)])
    every = contacts(ARM.chain, scene.obstacles, q, 1.0, 0.0, 999)
    few = contacts(ARM.chain, scene.obstacles, q, 1.0, 0.0, 4)
    assert len(every.at) > 4
    np.testing.assert_array_equal(few.gradient, every.gradient[:4])


def test_the_least_norm_is_that_of_a_quadratic_programme() -> None:
    """In coefficients a: ½ aᵀ (K ⊗ B) a, with contacts and limits as rows."""
    generator, loop = np.random.default_rng(1), loop_of(12, 8, 0.12)
    times, joints = 12, 3
    for _ in range(5):
        weights = generator.uniform(0.1, 1.0, joints)
        at = np.sort(generator.choice(times, 4, replace=False))
        near = Contacts(at, np.zeros(4), generator.normal(size=(4, joints)))
        bound = generator.uniform(-0.1, 0.3, 4)
        lower, upper = np.full((times, joints), -0.12), np.full((times, joints), 0.12)
        found = least_norm(loop.gram, weights, near, bound, lower, upper)
        big = np.kron(loop.gram, np.diag(weights))  # values = big @ a, a by time, then joint
        rows = np.zeros((4, times * joints))
        for c in range(4):
            rows[c, at[c] * joints : (at[c] + 1) * joints] = near.gradient[c]
        matrix = np.concatenate([-rows @ big, big, -big])
        sides = np.concatenate([-bound, upper.ravel(), -lower.ravel()])
        cost = big + 1e-10 * np.eye(len(big))
        solution = qpsolvers.solve_qp(cost, np.zeros(len(big)), matrix, sides, solver="piqp")
        if solution is None:
            continue
        dual = (found.coefficients / weights).ravel()
        assert dual @ big @ dual <= 1.01 * solution @ big @ solution
        assert np.all(rows @ found.values.ravel() >= bound - 0.01)  # as far as a few sweeps bring it
        assert np.abs(found.values).max() <= 0.12 + 0.01
        np.testing.assert_allclose(found.values.ravel(), big @ solution, atol=0.01)
        np.testing.assert_allclose(loop.gram @ found.coefficients, found.values, atol=1e-9)


def test_the_slowest_joint_moves_least() -> None:
    velocity = np.tile([2.0, 0.5, 0.0], (9, 1))
    weights = joint_weights(velocity, np.ones(3))
    assert weights[0] < weights[1] < weights[2] == 1.0
    quick = joint_weights(velocity, np.array([4.0, 1.0, 1.0]))
    assert quick[0] == pytest.approx(16 * quick[1])


def prover(robot: Robot, scene: Scene, path: Path) -> Verdict:
    verdict: Verdict = prove(robot.chain, scene.obstacles, path.breaks, path.coefficients, 0.0, MOST)
    return verdict


def certified(scene: Scene) -> tuple[Path, Verdict]:
    """A path around the post as descent alone leaves it."""
    plain = PlannerSettings(others=0, refining=RefinerSettings(near=np.inf))
    plan = Planner(ARM, plain).plan(scene, START, GOAL, budget=10.0, method="sampled", seed=3)
    assert plan.path is not None
    return plan.path, prover(ARM, scene, plan.path)


def refined_of(path: Path, verdict: Verdict, in_time: bool) -> Refined:
    refiner = Refiner(ARM, 24, RefinerSettings(near=1.0))
    return refiner.refine(POST, path, verdict, partial(prover, ARM, POST), lambda: in_time)


def test_a_refined_path_is_certified_and_faster() -> None:
    path, verdict = certified(POST)
    refined = refined_of(path, verdict, True)
    assert certify(ARM, POST, refined.path).free
    before, after = (parametrise(p, ARM.velocity_limit, ARM.acceleration_limit).duration for p in (path, refined.path))
    assert after < before
    np.testing.assert_array_equal(refined.path.coefficients[[0, -1], [0, -1]], [START, GOAL])


def test_without_time_a_path_is_left_as_it_is() -> None:
    path, verdict = certified(POST)
    refined = refined_of(path, verdict, False)
    assert refined.path is path


def test_haste_bounds_the_duration_of_lines() -> None:
    """A line at full speed: exactly; the timed motion takes longer, since it starts and stops."""
    line = Path(np.array([0.0, 1.0]), (START + np.linspace(0, 1, 6)[:, None] * (GOAL - START))[None])
    expected = np.max(np.abs(GOAL - START) / ARM.velocity_limit)
    assert haste(ARM, line) == pytest.approx(expected)
    assert parametrise(line, ARM.velocity_limit, ARM.acceleration_limit).duration > expected


def test_joints_with_time_to_spare_make_the_detour() -> None:
    """A point that goes far in x and around a wall's edge in y is as fast as without the wall."""
    robot = point_robot(0.02)
    wall = make_scene([Box([0.5, 0.45, 0.0], [0.02, 0.1, 1.0])])
    start, goal = np.array([0.1, 0.5]), np.array([0.9, 0.5])
    plan = Planner(robot).plan(wall, start, goal, budget=10.0)
    free = Planner(robot).plan(make_scene([]), start, goal)
    assert plan.certified
    assert plan.duration_s < 1.1 * free.duration_s
