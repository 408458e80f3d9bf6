"""Our own planners, and those of others that are special cases of our code: CHOMP, the thesis's recipe, RRT-Connect."""

from __future__ import annotations

import time

import numpy as np

from predplan.planning.benchmarks import Found, Prepare, Solve, piecewise, points_path
from predplan.planning.kernels import Gaussian, Kernel, Waypoints, condition, normalise
from predplan.planning.optimiser import INTEGRAL, MAXIMUM_POINT, Descent, Space, descend, line_values, space_of
from predplan.planning.paths import Path, quintic
from predplan.planning.peers import PeerSettings
from predplan.planning.planner import Method, Planner
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.sampling import connect, shortcut

THESIS_WIDTH, THESIS_SAMPLES, THESIS_ITERATIONS = 0.9, 48, 100
CHOMP_WAYPOINTS, CHOMP_ITERATIONS = 48, 100
INVERSE_STEPS = {"thesis": 2.0, "chomp": 4.0}
"""λ of Eq. 4.11, kernels normalised: of the powers of two, the one that had most of 40 other scenes (eight random boxes
around the arm) certified: 58% and 53%.
"""
EPSILON, SELF_EPSILON = 0.05, 0.02
"""m: clearances at which obstacles and other links begin to cost, as in our planner's own settings."""
KNOTS = 48
"""Pieces of the path of a smooth kernel."""
REACH, RESOLUTION, SEARCH_ITERATIONS, SHORTCUTS = 1.5, 0.08, 20_000, 40
"""Of RRT-Connect: longest motion (rad, 2-norm), largest step of a joint (rad) between configurations looked at."""


def make(name: str, robot: Robot, settings: PeerSettings) -> Prepare:
    """One of cascade, kernel, thesis, chomp, rrt-connect."""
    if name == "thesis":
        descent = descent_settings(MAXIMUM_POINT, INVERSE_STEPS[name], THESIS_ITERATIONS)
        return descending(robot, normalise(condition(Gaussian(THESIS_WIDTH))), descent, THESIS_SAMPLES)
    if name == "chomp":
        descent = descent_settings(INTEGRAL, INVERSE_STEPS[name], CHOMP_ITERATIONS)
        return descending(robot, normalise(Waypoints(CHOMP_WAYPOINTS, "acceleration")), descent, CHOMP_WAYPOINTS)
    if name == "rrt-connect":
        return lambda problem: _sampling(problem, settings.own_s)
    if name == "kernel":
        return _planning(Planner(robot), "kernel", settings.kernel_s)
    return _planning(Planner(robot), "cascade", settings.own_s)


def descent_settings(reduce: int, inverse_step: float, iterations: int) -> Descent:
    """From the straight line, one maximum or all times, until every time is clear; no cap on steps, no restarts."""
    return Descent(
        reduce=reduce,
        sections=1,
        inverse_step=inverse_step,
        beta=0.0,
        epsilon=EPSILON,
        self_epsilon=SELF_EPSILON,
        step_cap=np.inf,
        iterations=iterations,
        margin=0.001,
    )


def descending(robot: Robot, kernel: Kernel, descent: Descent, samples: int) -> Prepare:
    """Algorithm 7 once, from the straight line; success is what the method itself sees: clear at all its times.

    A smooth kernel's path is its own; waypoints are joined by a natural cubic spline, as one would execute them.
    """
    joints = len(robot.joints)
    space = space_of(kernel, np.eye(joints), samples)
    knots = np.linspace(0.0, 1.0, KNOTS + 1)
    smooth = kernel.smoothness >= 2
    tables = [kernel.gram(knots, space.times, order) for order in range(3)] if smooth else []

    def prepare(problem: Problem) -> Solve:
        line = line_values(space, problem.start, problem.goal)
        lower = np.broadcast_to(robot.chain.lower, line.shape).copy()
        upper = np.broadcast_to(robot.chain.upper, line.shape).copy()
        none = np.empty((0, *line.shape))

        def solve(seed: int) -> Found:
            obstacles = problem.scene.obstacles
            zero = np.zeros_like(line)
            ended = descend(robot.chain, obstacles, space, descent, line, zero, lower, upper, none)
            if ended.clearance < 0.0:
                return Found(None, f"still in collision after {ended.iterations} iterations")
            if smooth:
                path = _smooth_path(knots, tables, problem, ended.coefficients)
            else:
                path = _through(space, problem, ended.values)
            return Found(path, f"{ended.iterations} iterations")

        return solve

    return prepare


def _smooth_path(knots: FloatArray, tables: list[FloatArray], problem: Problem, coefficients: FloatArray) -> Path:
    position, velocity, acceleration = (table @ coefficients for table in tables)
    span = problem.goal - problem.start
    position += problem.start + np.multiply.outer(knots, span)
    position[0], position[-1] = problem.start, problem.goal
    return quintic(knots, position, velocity + span, acceleration)


def _through(space: Space, problem: Problem, waypoints: FloatArray) -> Path:
    from scipy.interpolate import CubicSpline  # half a second that the other planners need not wait

    times = np.concatenate([[0.0], space.times, [1.0]])
    points = np.concatenate([problem.start[None], waypoints, problem.goal[None]])
    return piecewise(CubicSpline(times, points, bc_type="natural"), times, 3)


def _sampling(problem: Problem, budget_s: float) -> Solve:
    chain, obstacles = problem.robot.chain, problem.scene.obstacles

    def solve(seed: int) -> Found:
        began, generator = time.perf_counter(), np.random.default_rng(seed)
        tries = 0
        while time.perf_counter() - began < budget_s:
            tries += 1
            points = connect(
                chain, obstacles, problem.start, problem.goal, generator, REACH, RESOLUTION, 0.0, SEARCH_ITERATIONS
            )
            if len(points):
                points = shortcut(chain, obstacles, points, generator, SHORTCUTS, RESOLUTION, 0.0)
                return Found(points_path(points, problem.start, problem.goal), f"search {tries}")
        return Found(None, f"no path in {tries} searches")

    return solve


def _planning(planner: Planner, method: Method, budget_s: float) -> Prepare:
    def prepare(problem: Problem) -> Solve:
        def solve(seed: int) -> Found:
            plan = planner.plan(problem.scene, problem.start, problem.goal, budget_s, method, seed)
            if plan.path is None:
                return Found(None, plan.reason)
            last = plan.attempts[-1]
            return Found(plan.path, f"{last.start} start, attempt {len(plan.attempts)}")

        return solve

    return prepare
