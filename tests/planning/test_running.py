"""Runs of methods: what is measured of them, how steps are chosen, and what the certificate is of."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from predplan.planning.collisions import point_costs
from predplan.planning.kernels import diagonal
from predplan.planning.kinds import KINDS, SuiteKind
from predplan.planning.kinematics import forward
from predplan.planning.measures import GRID, cost_field, measured
from predplan.planning.methods import Method, build_kernel, methods_of
from predplan.planning.optimiser import line_values
from predplan.planning.paths import Path, acceleration_cost, polyline, velocity_cost
from predplan.planning.problems import Problem, maze_problems, planar_problems
from predplan.planning.running import (
    Tried,
    choose_step,
    iteration_times,
    joint_matrix,
    path_of,
    prepare,
    run_method,
    supports_of,
    tool_jacobian,
    try_step,
)

METHODS = {f"{kind} {method.name}": method for kind in ("maze", "planar") for method in methods_of(kind)}


@pytest.fixture(scope="module")
def problem() -> Problem:
    return planar_problems(1, np.random.default_rng(3))[0]


@pytest.mark.parametrize("kind", KINDS)
def test_methods_of_a_suite(kind: SuiteKind) -> None:
    methods = methods_of(kind)
    names = [method.name for method in methods]
    assert len(set(names)) == len(names)
    assert all(method.step_of in ("", *names) for method in methods)
    own = {method.name for method in methods if not method.step_of}
    assert all(method.step_of in own for method in methods if method.step_of)


@pytest.mark.parametrize("name", METHODS)
def test_kernels_are_normalised_and_vanish_at_the_ends(name: str) -> None:
    kernel = build_kernel(METHODS[name].kernel_key)
    assert diagonal(kernel, np.linspace(0, 1, 513)).max() == pytest.approx(1.0)
    assert np.abs(kernel.gram(np.array([0.0, 1.0]), np.linspace(0, 1, 20))).max() < 1e-9


@pytest.mark.parametrize("name", METHODS)
def test_what_is_kept_is_what_is_certified(name: str) -> None:
    """The path that is tried meets the values on the grid, which are the measured ones."""
    method = replace(METHODS[name], inverse_step=5.0)
    make = maze_problems if name.startswith("maze") else planar_problems
    problem = make(1, np.random.default_rng(3))[0]
    run = run_method(method, problem, 3)
    np.testing.assert_allclose(run.trajectories[:, 0], np.tile(problem.start, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(run.trajectories[:, -1], np.tile(problem.goal, (4, 1)), atol=1e-9)
    line = problem.start + GRID[:, None] * (problem.goal - problem.start)
    np.testing.assert_allclose(run.trajectories[0], line, atol=1e-12)
    assert np.abs(run.trajectories[-1] - line).max() > 1e-4
    assert all(values.shape == (4,) for values in run.measures)
    assert isinstance(run.certificate.free, bool)


@pytest.mark.parametrize("kernel", ["gaussian", "b-spline", "laplacian", "waypoints-velocity"])
def test_paths_meet_the_trajectory(problem: Problem, kernel: str) -> None:
    method = Method("m", "m", kernel, 0.3, samples=24)  # type: ignore[arg-type]
    prepared = prepare(method, problem, 1)
    rng = np.random.default_rng(0)
    coefficients = 0.05 * rng.standard_normal((len(prepared.space.times), 3))
    path = path_of(prepared, problem, coefficients)
    values = line_values(prepared.space, problem.start, problem.goal) + prepared.space.gram @ coefficients
    if path.degree == 1:  # at its own speed: compare places, not times
        points = path(np.linspace(0, 1, 4001))
        gaps = np.linalg.norm(values[-101:, None] - points[None], axis=2).min(axis=1)
        assert gaps.max() < 0.01
    else:
        np.testing.assert_allclose(path(GRID), values[-101:], atol=1e-5)


def test_smoothness_is_that_of_paths() -> None:
    q = np.cumsum(np.random.default_rng(0).standard_normal((101, 3)), axis=0)
    problem = planar_problems(1, np.random.default_rng(3))[0]
    found = measured(problem.robot.chain, problem.scene.obstacles, q[None], 0.1)
    path = Path(GRID, polyline(q).coefficients)
    assert found.velocity[0] == pytest.approx(velocity_cost(path))
    assert found.acceleration[0] == pytest.approx(acceleration_cost(path))


def test_obstacle_costs_by_hand(problem: Problem) -> None:
    chain, obstacles, epsilon = problem.robot.chain, problem.scene.obstacles, 0.1
    q = problem.start + GRID[:, None] * (problem.goal - problem.start)
    spheres = len(chain.sphere_radius)
    costs, centres = np.empty((101, spheres)), np.empty((101, spheres, 3))
    for i, configuration in enumerate(q):
        point_costs(chain, obstacles, configuration, epsilon, costs[i])
        forward(chain, configuration, np.empty((4, 3, 3)), np.empty((4, 3)), centres[i])
    ways = np.linalg.norm(np.diff(centres, axis=0), axis=2)
    found = measured(chain, obstacles, q[None], epsilon)
    assert found.maximum[0] == pytest.approx(costs.max())
    assert found.integral[0] == pytest.approx(np.sum((costs[1:] + costs[:-1]) / 2 * ways))
    assert costs.max() > 0


def test_arc_length_does_not_depend_on_speed(problem: Problem) -> None:
    """The integral of a way is the same however fast it is run through."""
    line = problem.goal - problem.start
    chain, obstacles = problem.robot.chain, problem.scene.obstacles
    even, uneven = (
        measured(chain, obstacles, (problem.start + s[:, None] * line)[None], 0.1) for s in (GRID, GRID**1.3)
    )
    assert even.integral[0] == pytest.approx(uneven.integral[0], rel=0.02)


def test_joints_interact_through_the_tool(problem: Problem) -> None:
    method = Method("m", "m", "gaussian", interaction=True)
    matrix = joint_matrix(method, problem)
    assert np.trace(matrix) == pytest.approx(3.0)
    assert np.linalg.eigvalsh(matrix).min() > 0
    np.testing.assert_array_equal(joint_matrix(replace(method, interaction=False), problem), np.eye(3))
    from predplan.planning.kinematics import tool_trace

    step = 1e-6 * np.eye(3)
    differences = tool_trace(problem.robot.chain, problem.start + step) - tool_trace(
        problem.robot.chain, problem.start - step
    )
    np.testing.assert_allclose(tool_jacobian(problem.robot, problem.start), differences.T / 2e-6, atol=1e-8)


def test_supports_grow_by_a_point_a_section(problem: Problem) -> None:
    method = Method("m", "m", "gaussian", 0.3, sections=4, epsilon=0.1, inverse_step=2.0)
    supports = supports_of(method, problem, 4)
    assert len(supports[0]) == 0
    for before, after in itertools.pairwise(supports):
        assert set(before) <= set(after)
        assert len(after) <= len(before) + 4
    assert len(supports[-1]) > 0


def test_the_step_that_leaves_most_free() -> None:
    tried = [
        Tried("m", 1.0, 0.5, 0.0, 0.1, 0.0, 0.0),
        Tried("m", 2.0, 0.8, 0.0, 0.3, 0.0, 0.0),
        Tried("m", 5.0, 0.8, 0.0, 0.2, 0.0, 0.0),
        Tried("m", 9.0, 0.8, 0.0, 0.2, 0.0, 0.0),
    ]
    assert [each.inverse_step for each in choose_step(tried) if each.chosen] == [9.0]


def test_steps_are_tried_at_the_iteration_they_are_tuned_by(problem: Problem) -> None:
    method = Method("m", "m", "gaussian", 0.3, sections=4, epsilon=0.1, inverse_step=1.0, tuned_at=2)
    tried, run = try_step(method, [problem], 10), run_method(method, problem, 2)
    assert tried.integral == pytest.approx(run.measures.integral[-1])
    assert tried.acceleration == pytest.approx(run.measures.acceleration[-1])
    assert tried.free == float(run.certificate.free)


def test_the_same_run_twice(problem: Problem) -> None:
    method = Method("m", "m", "gaussian", 0.15, sections=4, epsilon=0.1)
    once, again = (run_method(method, problem, 5) for _ in range(2))
    np.testing.assert_array_equal(once.trajectories, again.trajectories)


def test_times_of_iterations(problem: Problem) -> None:
    taken = iteration_times([Method("a", "a", "gaussian"), Method("b", "b", "laplacian")], problem, 3, 4)
    assert taken.shape == (2, 4)
    assert np.all(taken > 0)


def test_the_cost_field_is_highest_in_obstacles() -> None:
    scene = maze_problems(1, np.random.default_rng(0))[0].scene
    field = cost_field(scene, np.zeros(2), np.ones(2), 21, 0.1)
    assert field.shape == (21, 21)
    assert field[0, 4] == pytest.approx(0.05 + 0.1)  # x .2, y 0: in the middle of the lower left wall
    assert field[10, 7] < field[4, 4]
