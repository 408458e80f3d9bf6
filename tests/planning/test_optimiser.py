"""The descent against second implementations: CHOMP's update, finite differences, and a quadratic programme."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import qpsolvers

from predplan.planning.collisions import body_cost, worst_cost
from predplan.planning.kernels import (
    BSpline,
    Gaussian,
    Kernel,
    Laplacian,
    Waypoints,
    condition,
    joint_interaction,
    normalise,
)
from predplan.planning.optimiser import (
    INTEGRAL,
    MAXIMUM_BODY,
    MAXIMUM_POINT,
    PATH_INTEGRAL,
    Descended,
    Descent,
    Space,
    descend,
    line_values,
    meet_limits,
    space_of,
)
from predplan.planning.problems import Problem, planar_problems
from predplan.planning.robots import FloatArray
from predplan.planning.scenes import make_scene

EPSILON, SELF_EPSILON = 0.15, 0.05
KERNELS: dict[str, Kernel] = {
    "gaussian": normalise(condition(Gaussian(0.9))),
    "narrow": normalise(condition(Gaussian(0.15))),
    "laplacian": normalise(condition(Laplacian(0.3))),
    "b-spline": normalise(condition(BSpline(0.3))),
    "waypoints, velocity": normalise(Waypoints(20, "velocity")),
    "waypoints, acceleration": normalise(Waypoints(20, "acceleration")),
}


@pytest.fixture(scope="module")
def problem() -> Problem:
    return planar_problems(1, np.random.default_rng(3))[0]


def descent(reduce: int = INTEGRAL, **changed: Any) -> Descent:
    plain = Descent(reduce, 4, 1.0, 0.0, EPSILON, SELF_EPSILON, np.inf, 1, -1.0)
    return plain._replace(**changed)


def run(problem: Problem, space: Space, how: Descent, start: FloatArray | None = None) -> tuple[Descended, FloatArray]:
    """The descent without limits, and its history."""
    line = line_values(space, problem.start, problem.goal)
    bounds = np.full_like(line, np.inf)
    history = np.empty((how.iterations + 1, *line.shape))
    coefficients = np.zeros_like(line) if start is None else start
    chain, obstacles = problem.robot.chain, problem.scene.obstacles
    return descend(chain, obstacles, space, how, line, coefficients, -bounds, bounds, history), history


def costs_at(problem: Problem, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Body cost and its gradient at configurations [n, D]."""
    gradients = np.empty_like(values)
    costs = [
        body_cost(problem.robot.chain, problem.scene.obstacles, q, EPSILON, SELF_EPSILON, gradient)[0]
        for q, gradient in zip(values, gradients, strict=True)
    ]
    return np.array(costs), gradients


@pytest.mark.parametrize("metric", ["velocity", "acceleration"])
def test_waypoints_reproduce_chomps_update(problem: Problem, metric: str) -> None:
    """CHOMP (Zucker et al. 2013): q ← q - A⁻¹ ∇U / λ, ∇U the Euclidean gradient by waypoints, A of differences."""
    count, inverse_step = 20, 50.0
    first = np.diff(np.eye(count + 2), axis=0)
    inner = (first if metric == "velocity" else np.diff(first, axis=0))[:, 1:-1]
    A = inner.T @ inner
    space = space_of(Waypoints(count, "velocity" if metric == "velocity" else "acceleration"), np.eye(3), count)
    _, history = run(problem, space, descent(inverse_step=inverse_step, iterations=4))
    q = line_values(space, problem.start, problem.goal)
    for values in history:
        np.testing.assert_allclose(values, q, atol=1e-9)
        euclidean = costs_at(problem, q)[1] / count
        q = q - np.linalg.solve(A, euclidean) / inverse_step


@pytest.mark.parametrize("interaction", [False, True])
@pytest.mark.parametrize("reduce", [INTEGRAL, PATH_INTEGRAL])
@pytest.mark.parametrize("quadrature", [False, True])
def test_functional_gradient_by_finite_differences(
    problem: Problem, reduce: int, quadrature: bool, interaction: bool
) -> None:
    """∂U/∂a, the derivative along each K(., tᵢ) e_d, is the Gram matrix times the gradient's coefficients."""
    rng = np.random.default_rng(0)
    joint = joint_interaction([rng.standard_normal((3, 3))], 0.1) if interaction else np.eye(3)
    space = space_of(KERNELS["narrow"], joint, 8, quadrature, velocities=reduce == PATH_INTEGRAL)
    coefficients = 0.05 * rng.standard_normal((len(space.times), 3))
    ended, _ = run(problem, space, descent(reduce), coefficients)
    slope = coefficients - ended.coefficients  # one step with λ = 1 and β = 0
    line = line_values(space, problem.start, problem.goal)
    samples = len(space.weights)

    def cost(a: FloatArray) -> float:
        values = line + space.gram @ a @ joint
        speed = np.linalg.norm(values[samples:], axis=1) if reduce == PATH_INTEGRAL else 1.0
        return float(np.sum(space.weights * costs_at(problem, values[:samples])[0] * speed))

    step = 1e-6
    numeric = np.empty_like(coefficients)
    for index in np.ndindex(coefficients.shape):
        moved = np.zeros_like(coefficients)
        moved[index] = step
        numeric[index] = (cost(coefficients + moved) - cost(coefficients - moved)) / (2 * step)
    assert np.abs(numeric).max() > 1e-3
    np.testing.assert_allclose(space.gram @ slope @ joint, numeric, atol=1e-6)


@pytest.mark.parametrize("reduce", [MAXIMUM_POINT, MAXIMUM_BODY])
def test_maxima_one_a_section(problem: Problem, reduce: int) -> None:
    space = space_of(KERNELS["narrow"], np.eye(3), 20)
    ended, history = run(problem, space, descent(reduce))
    gradients = np.empty_like(history[0])
    if reduce == MAXIMUM_BODY:
        costs, gradients = costs_at(problem, history[0])
    else:
        chain, obstacles = problem.robot.chain, problem.scene.obstacles
        costs = np.array(
            [worst_cost(chain, obstacles, q, EPSILON, g)[0] for q, g in zip(history[0], gradients, strict=True)]
        )
    expected = np.zeros_like(gradients)
    for section in range(4):
        worst = 5 * section + int(np.argmax(costs[5 * section : 5 * section + 5]))
        expected[worst] = -gradients[worst] if costs[worst] > 0 else 0.0
    np.testing.assert_allclose(ended.coefficients, expected, atol=1e-12)


@pytest.mark.parametrize("name", KERNELS)
def test_ends_hold_after_any_number_of_steps(problem: Problem, name: str) -> None:
    kernel = KERNELS[name]
    space = space_of(kernel, np.eye(3), 20)
    line = line_values(space, problem.start, problem.goal)
    chain = problem.robot.chain
    lower, upper = (np.broadcast_to(bound, line.shape).copy() for bound in (chain.lower / 2, chain.upper / 2))
    how = descent(MAXIMUM_POINT, inverse_step=0.5, beta=0.01, iterations=40)
    none = np.empty((0, *line.shape))
    ended = descend(chain, problem.scene.obstacles, space, how, line, np.zeros_like(line), lower, upper, none)
    assert np.abs(ended.values - line).max() > 0.05
    at_ends = kernel.gram(np.array([0.0, 1.0]), space.times) @ ended.coefficients
    assert np.abs(at_ends).max() < 1e-10
    np.testing.assert_allclose(ended.values, line + space.gram @ ended.coefficients, atol=1e-8)


@pytest.mark.parametrize("cap", [0.01, 0.1])
def test_steps_are_capped(problem: Problem, cap: float) -> None:
    space = space_of(KERNELS["gaussian"], np.eye(3), 20)
    how = descent(inverse_step=0.01, step_cap=cap, iterations=5)
    _, history = run(problem, space, how)
    steps = np.abs(np.diff(history, axis=0)).max(axis=(1, 2))
    np.testing.assert_allclose(steps, cap, rtol=1e-9)


def test_shrinkage_shrinks_the_bend_and_not_the_line(problem: Problem) -> None:
    space = space_of(KERNELS["gaussian"], np.eye(3), 10)
    coefficients = np.random.default_rng(0).standard_normal((10, 3))
    empty = replace(problem, scene=make_scene([]))
    ended, history = run(empty, space, descent(inverse_step=4.0, beta=1.0), 0.001 * coefficients)
    np.testing.assert_allclose(ended.coefficients, 0.75 * 0.001 * coefficients, atol=1e-15)
    line = line_values(space, problem.start, problem.goal)
    np.testing.assert_allclose(history[1] - line, 0.75 * (history[0] - line), atol=1e-12)


@pytest.mark.parametrize("interaction", [False, True])
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("seed", range(4))
def test_limits_hold_after_projection(name: str, seed: int, interaction: bool) -> None:
    rng = np.random.default_rng(seed)
    joint = joint_interaction([rng.standard_normal((3, 3))], 0.1) if interaction else np.eye(3)
    space = space_of(KERNELS[name], joint, 20)
    line = np.tile(np.linspace(-0.5, 0.5, 20)[:, None], (1, 3))
    coefficients = rng.standard_normal((20, 3))
    deviations = space.gram @ coefficients @ joint
    coefficients *= 2.0 / np.abs(deviations).max()
    deviations *= 2.0 / np.abs(deviations).max()
    bounds = np.full_like(line, 0.8)
    meet_limits(space, line, -bounds, bounds, coefficients, deviations)
    assert np.abs(line + deviations).max() <= 0.8 + 1e-6
    np.testing.assert_allclose(deviations, space.gram @ coefficients @ joint, atol=1e-7)
    ends = KERNELS[name].gram(np.array([0.0, 1.0]), space.times) @ coefficients @ joint
    assert np.abs(ends).max() < 1e-9


@pytest.mark.parametrize("name", ["narrow", "waypoints, velocity", "waypoints, acceleration", "laplacian"])
@pytest.mark.parametrize("seed", range(3))
def test_projection_is_the_nearest_within_limits(name: str, seed: int) -> None:
    """Against a quadratic programme: least ‖f - f₀‖² subject to the bounds, one joint."""
    rng = np.random.default_rng(seed)
    space = space_of(KERNELS[name], np.eye(1), 12)
    line = np.linspace(-0.4, 0.4, 12)[:, None]
    free = rng.standard_normal((12, 1))
    free *= 1.5 / np.abs(space.gram @ free).max()
    coefficients, deviations, bounds = free.copy(), space.gram @ free, np.full_like(line, 0.6)
    meet_limits(space, line, -bounds, bounds, coefficients, deviations)
    rows = np.concatenate([space.gram, -space.gram])
    sides = np.concatenate([bounds - line, bounds + line])[:, 0]
    ridge = 1e-10 * np.eye(12)
    best = qpsolvers.solve_qp(space.gram + ridge, -(space.gram + ridge) @ free[:, 0], rows, sides, solver="piqp")
    assert best is not None

    def distance(a: FloatArray) -> float:
        return float((a - free[:, 0]) @ space.gram @ (a - free[:, 0]))

    assert distance(coefficients[:, 0]) == pytest.approx(distance(best), rel=1e-4, abs=1e-7)


def test_velocity_limits_hold(problem: Problem) -> None:
    space = space_of(KERNELS["narrow"], np.eye(3), 16, velocities=True)
    line = line_values(space, problem.start, problem.goal)
    velocity = (space.orders == 1)[:, None]
    bound = 1.3 * np.abs(problem.goal - problem.start)
    upper = np.where(velocity, bound, np.inf)
    how = descent(PATH_INTEGRAL, inverse_step=0.5, iterations=10)
    none = np.empty((0, *line.shape))
    chain, obstacles = problem.robot.chain, problem.scene.obstacles
    ended = descend(chain, obstacles, space, how, line, np.zeros_like(line), -upper, upper, none)
    assert np.all(np.abs(ended.values) <= upper + 1e-6)
    assert np.abs(ended.values - line).max() > 1e-3


def test_stops_once_clear(problem: Problem) -> None:
    space = space_of(KERNELS["narrow"], np.eye(3), 30)
    ended, _ = run(problem, space, descent(MAXIMUM_BODY, inverse_step=1.0, iterations=200, margin=0.01, step_cap=0.2))
    assert ended.iterations < 200
    assert ended.clearance >= 0.01
