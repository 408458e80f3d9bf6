"""One method on one problem: the descent, and what each of its iterations is worth."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from predplan.planning.certificates import Certificate, certify
from predplan.planning.kernels import Kernel, joint_interaction
from predplan.planning.kinematics import point_jacobian, poses, tool_trace
from predplan.planning.measures import GRID, Measures, measured
from predplan.planning.methods import REDUCES, KernelKey, Method, build_kernel
from predplan.planning.optimiser import Descended, Descent, Space, descend, line_values, space_of
from predplan.planning.paths import Path, polyline, quintic
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.trajectories import functional_gram

KNOTS = 64
"""Pieces of the path that is certified."""
INTERACTION_EPSILON = 0.1
"""ε of JᵀJ + εI, whose first term is scaled to the trace D."""


@dataclass(frozen=True)
class Run:
    """What became of a problem, iteration by iteration; row 0 is the straight line."""

    trajectories: FloatArray  # [iterations + 1, 101, D] on GRID
    measures: Measures  # each [iterations + 1]
    certificate: Certificate  # of the last iteration


class Tables(NamedTuple):
    """What does not depend on the problem: the kernel, its Gram matrices, and what leads to the knots of a path."""

    kernel: Kernel
    space: Space
    on_grid: Space
    knots: FloatArray  # [K]
    to_knots: tuple[FloatArray, ...]  # [K, F] each: values, and where the kernel is smooth two derivatives


class Prepared(NamedTuple):
    """A method made ready for a problem."""

    tables: Tables
    space: Space  # positions at the method's times (and velocities), then at GRID
    descent: Descent


def prepare(method: Method, problem: Problem, iterations: int, on_grid: bool = True) -> Prepared:
    """The method's space and descent; on_grid: whether values on GRID are kept beside those at the method's times."""
    tables = _tables(method.kernel_key, method.samples, method.quadrature, method.reduce == "path-integral")
    space = (tables.on_grid if on_grid else tables.space)._replace(joint=joint_matrix(method, problem))
    descent = Descent(
        reduce=REDUCES[method.reduce],
        sections=method.sections,
        inverse_step=method.inverse_step,
        beta=method.beta,
        epsilon=method.epsilon,
        self_epsilon=method.self_epsilon,
        step_cap=method.step_cap,
        iterations=iterations,
        margin=-1.0,
    )
    return Prepared(tables, space, descent)


@lru_cache(maxsize=64)
def _tables(key: KernelKey, samples: int, quadrature: bool, velocities: bool) -> Tables:
    kernel = build_kernel(key)
    space = space_of(kernel, np.eye(1), samples, quadrature, velocities)
    times = np.concatenate([space.times, GRID])
    orders = np.concatenate([space.orders, np.zeros(len(GRID), np.int64)])
    on_grid = space._replace(times=times, orders=orders, gram=functional_gram(kernel, times, orders, times, orders))
    smooth = kernel.smoothness >= 2
    pieces = KNOTS if smooth else samples + 1 if key.waypoints else 4 * (samples + 1)
    knots = np.linspace(0.0, 1.0, pieces + 1)
    to_knots = tuple(
        functional_gram(kernel, knots, np.full(len(knots), order), times, orders)
        for order in (range(3) if smooth else range(1))
    )
    return Tables(kernel, space, on_grid, knots, to_knots)


def run_method(method: Method, problem: Problem, iterations: int) -> Run:
    """Descend from the straight line, measure every iteration, and certify the last."""
    prepared = prepare(method, problem, iterations)
    history = np.empty((iterations + 1, len(prepared.space.times), len(problem.start)))
    ended = _descend(prepared, problem, history)
    trajectories = np.ascontiguousarray(history[:, -len(GRID) :])
    chain, obstacles = problem.robot.chain, problem.scene.obstacles
    measures = measured(chain, obstacles, trajectories, method.epsilon)
    path = path_of(prepared, problem, ended.coefficients)
    return Run(trajectories, measures, certify(problem.robot, problem.scene, path))


def supports_of(method: Method, problem: Problem, iterations: int) -> list[FloatArray]:
    """The support's times in [0, 1] after 0, 1, ... iterations: where coefficients are not zero."""
    prepared = prepare(method, problem, 1, on_grid=False)
    times = prepared.space.times
    coefficients = np.zeros((len(times), len(problem.start)))
    none = np.empty((0, *coefficients.shape))
    supports = [times[:0]]
    for _ in range(iterations):
        coefficients = _descend(prepared, problem, none, coefficients).coefficients
        supports.append(times[np.any(coefficients != 0.0, axis=1)])
    return supports


def path_of(prepared: Prepared, problem: Problem, coefficients: FloatArray) -> Path:
    """The trajectory as a path: a quintic spline where the kernel is smooth, the polyline of waypoints where it is not.

    Kernels with corners (Laplacian) or no accelerations (cubic B-spline) become polylines of four times as many points.
    coefficients [F, D] of the space on GRID: limits that were met there have theirs.
    """
    tables, span = prepared.tables, problem.goal - problem.start
    own = coefficients @ prepared.space.joint
    position, *derivatives = (table @ own for table in tables.to_knots)
    position += problem.start + np.multiply.outer(tables.knots, span)
    position[0], position[-1] = problem.start, problem.goal
    if not derivatives:
        return polyline(position)
    return quintic(tables.knots, position, derivatives[0] + span, derivatives[1])


def joint_matrix(method: Method, problem: Problem) -> FloatArray:
    """How joints interact: not at all, or by the end effector's Jacobian at the start (Eq. 4.7)."""
    joints = len(problem.start)
    if not method.interaction:
        return np.eye(joints)
    return joint_interaction([tool_jacobian(problem.robot, problem.start)], INTERACTION_EPSILON)


def tool_jacobian(robot: Robot, q: FloatArray) -> FloatArray:
    """How the end effector moves with each joint at q [D]: [3, D] m/rad."""
    rotations, positions = poses(robot.chain, q[None])
    jacobian = np.empty((3, len(q)))
    point = tool_trace(robot.chain, q[None])[0]
    point_jacobian(robot.chain, rotations[0], positions[0], robot.chain.tool_frame, point, jacobian)
    return jacobian


@dataclass(frozen=True)
class Tried:
    """A step that was tried on the tuning problems: means over them, at the iteration the method is tuned by."""

    method: str
    inverse_step: float
    free: float  # share of the problems certified free of collision
    maximum: float
    integral: float
    velocity: float
    acceleration: float
    chosen: bool = False


def try_step(method: Method, problems: Sequence[Problem], iterations: int) -> Tried:
    """The method with its λ on the tuning problems."""
    count = method.tuned_at or iterations
    free, costs = [], []
    for problem in problems:
        prepared = prepare(method, problem, count)
        ended = _descend(prepared, problem, np.empty((0, len(prepared.space.times), len(problem.start))))
        last = np.ascontiguousarray(ended.values[None, -len(GRID) :])
        chain, obstacles = problem.robot.chain, problem.scene.obstacles
        costs.append([values[0] for values in measured(chain, obstacles, last, method.epsilon)])
        free.append(certify(problem.robot, problem.scene, path_of(prepared, problem, ended.coefficients)).free)
    return Tried(method.name, method.inverse_step, float(np.mean(free)), *np.mean(costs, axis=0).tolist())


def choose_step(tried: Sequence[Tried]) -> list[Tried]:
    """All that was tried, with the best marked.

    Best is the λ that leaves most tuning problems free of collision; of equals the one with the least obstacle cost
    (arc-length integral over the body); of equals the largest, whose steps are smallest.
    """
    best = min(tried, key=lambda each: (-each.free, each.integral, -each.inverse_step))
    return [replace(each, chosen=each is best) for each in tried]


def iteration_times(methods: Sequence[Method], problem: Problem, iterations: int, repeats: int) -> FloatArray:
    """Milliseconds an iteration [methods, repeats], the methods taking turns so that all meet the same machine."""
    ready = [prepare(method, problem, iterations, on_grid=False) for method in methods]
    taken = np.empty((len(methods), repeats))
    for repeat in range(-1, repeats):  # one round to warm up
        for row, prepared in enumerate(ready):
            none = np.empty((0, len(prepared.space.times), len(problem.start)))
            began = time.perf_counter()
            _descend(prepared, problem, none)
            if repeat >= 0:
                taken[row, repeat] = 1e3 * (time.perf_counter() - began) / iterations
    return taken


def _descend(
    prepared: Prepared, problem: Problem, history: FloatArray, coefficients: FloatArray | None = None
) -> Descended:
    chain, space = problem.robot.chain, prepared.space
    line = line_values(space, problem.start, problem.goal)
    position = (space.orders == 0)[:, None]
    lower = np.where(position, chain.lower, -np.inf)
    upper = np.where(position, chain.upper, np.inf)
    start = np.zeros_like(line) if coefficients is None else coefficients
    return descend(chain, problem.scene.obstacles, space, prepared.descent, line, start, lower, upper, history)
