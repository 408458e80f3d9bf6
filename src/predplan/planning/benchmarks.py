"""MotionBenchMaker's problems (Chamzas et al. 2022) as published with VAMP, and what a planner makes of one.

Every planner's path, ours or a peer's, polyline or spline, is judged in one way: lengths and costs as `paths` has
them, the smallest clearance, the duration within velocity and acceleration limits, and our own continuous-time
certificate.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import comb
from pathlib import Path as FilePath

import numpy as np
from numba import njit

from predplan.errors import InputError, PredplanError
from predplan.planning.certificates import certify
from predplan.planning.collisions import clearances, valid
from predplan.planning.paths import Path, acceleration_cost, length, polyline, velocity_cost
from predplan.planning.problems import Problem
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import Chain, FloatArray, Robot
from predplan.planning.scene_files import read_request, read_scene
from predplan.planning.scenes import Obstacles
from predplan.planning.timing import parametrise

ROBOT, FOLDER, SUFFIX = "panda_spherized.urdf", "panda", "_panda"
"""Where the robot and the sets lie in the benchmark's folder, and how the name of a set's folder ends."""
BOXED = "box"
"""The set whose cylinders are boxes: its grasps reach down onto one. In the others they are capsules."""
CLEARANCE_STEPS, FARTHEST = 500, 0.5
"""Steps of the path whose clearance is measured; clearances (m) beyond the latter are not told apart."""
END_ERROR = 1e-4
"""rad: how far a path's ends may be from start and goal; planners in single precision are 1e-7 away."""
MERGED = 1e-6
"""rad: points of a polyline nearer to the last one are left out; some planners return doubled ones."""


@dataclass(frozen=True)
class SetProblem(Problem):
    """A problem of a published set."""

    family: str  # the set
    number: int  # in the set
    conversion_s: float  # reading and converting the scene and the request


@dataclass(frozen=True)
class Found:
    """A planner's answer."""

    path: Path | None  # None if it has found none
    note: str = ""  # where the path came from, or why there is none


Solve = Callable[[int], Found]
"""Plans once, with random numbers of a seed; this is what is timed."""
Prepare = Callable[[Problem], Solve]
"""Brings a problem into a planner's own form; its time is told apart, as that of reading the scene is."""


@dataclass(frozen=True)
class Measured:
    """One planner on one problem with one seed; what is measured of a path is nan where there is none."""

    planner: str
    family: str
    number: int
    seed: int
    solved: bool  # the planner says so
    certified: bool  # we prove it
    note: str
    time_s: float
    cpu_s: float
    preparation_s: float
    conversion_s: float
    pieces: int = 0
    length_rad: float = np.nan
    velocity_cost: float = np.nan
    acceleration_cost: float = np.nan
    clearance_m: float = np.nan
    duration_s: float = np.nan
    line_s: float = np.nan  # of the straight line from start to goal, through whatever is in the way


def read_problems(folder: FilePath | str, robot: Robot | None = None) -> list[SetProblem]:
    """All problems of a benchmark folder, by set and number: panda/SET_panda/sceneNNNN.yaml with requestNNNN.yaml.

    The robot is the folder's panda_spherized.urdf if not given. Conventions of the published set: of a collision
    object only the first primitive counts, and cylinders are capsules, in the set `box` boxes.
    Raises InputError for what is missing.
    """
    folder = FilePath(folder)
    robot = robot or read_robot(folder / ROBOT)
    requests = sorted(folder.glob(f"{FOLDER}/*{SUFFIX}/request*.yaml"))
    if not requests:
        raise InputError(f"{folder}: no {FOLDER}/SET{SUFFIX}/requestNNNN.yaml; expected MotionBenchMaker's problems")
    return [_read_problem(request, robot) for request in requests]


def _read_problem(request: FilePath, robot: Robot) -> SetProblem:
    family = request.parent.name.removesuffix(SUFFIX)
    digits = re.search(r"\d+", request.name)
    if digits is None:
        raise InputError(f"{request}: no number in the name; expected requestNNNN.yaml")
    began = time.perf_counter()
    scene = read_scene(
        request.with_name(f"scene{digits[0]}.yaml"),
        cylinders_as="box" if family == BOXED else "capsule",
        primitives="first",
    )
    start, goal = read_request(request).configurations(robot)
    took = time.perf_counter() - began
    return SetProblem(f"{family} {digits[0]}", robot, scene, start, goal, family, int(digits[0]), took)


def solvable(problems: Iterable[SetProblem]) -> tuple[list[SetProblem], list[SetProblem]]:
    """Those whose start and goal are valid, and the others: one of the published 700 has an end in collision."""
    valid_ones: list[SetProblem] = []
    invalid: list[SetProblem] = []
    for problem in problems:
        chain, obstacles = problem.robot.chain, problem.scene.obstacles
        ends_valid = all(valid(chain, obstacles, end, 0.0) for end in (problem.start, problem.goal))
        (valid_ones if ends_valid else invalid).append(problem)
    return valid_ones, invalid


def measure(planner: str, prepare: Prepare, problems: Iterable[SetProblem], seeds: int) -> Iterator[Measured]:
    """Every problem with every seed, problem by problem.

    The first problem is planned once before, untimed: what is compiled or loaded then is not the planner's time.
    """
    warm = False
    for problem in problems:
        began = time.perf_counter()
        solve = prepare(problem)
        preparation_s = time.perf_counter() - began
        for seed in range(seeds):
            if not warm:
                solve(seed)
                warm = True
            began, cpu_began = time.perf_counter(), time.process_time()
            found = solve(seed)
            cpu_s, time_s = time.process_time() - cpu_began, time.perf_counter() - began
            yield judge(planner, problem, seed, found, (time_s, cpu_s, preparation_s))


def judge(planner: str, problem: SetProblem, seed: int, found: Found, times_s: tuple[float, float, float]) -> Measured:
    """Everything that is measured of an answer; times_s: of the wall, of the processor, of preparing."""
    robot, scene, path = problem.robot, problem.scene, found.path
    note = found.note
    if path is not None:
        ends = path(np.array([0.0, 1.0]))
        off = float(np.abs(ends - np.stack([problem.start, problem.goal])).max())
        if not off <= END_ERROR:
            path, note = None, f"its path ends {off:.3g} rad from start or goal"
    head = (planner, problem.family, problem.number, seed)
    if path is None:
        return Measured(*head, False, False, note, *times_s, problem.conversion_s)
    certificate = certify(robot, scene, path)
    q = path(np.linspace(0.0, 1.0, CLEARANCE_STEPS + 1))
    return Measured(
        *head,
        True,
        certificate.free,
        note if certificate.free else certificate.reason,
        *times_s,
        problem.conversion_s,
        len(path.coefficients),
        length(path),
        velocity_cost(path),
        acceleration_cost(path),
        float(smallest_clearance(robot.chain, scene.obstacles, np.ascontiguousarray(q), FARTHEST)),
        duration(path, robot.velocity_limit, robot.acceleration_limit),
        duration(polyline(np.stack([problem.start, problem.goal])), robot.velocity_limit, robot.acceleration_limit),
    )


def points_path(points: FloatArray, start: FloatArray, goal: FloatArray) -> Path:
    """The polyline through points [n, D] from start to goal: its ends are set to them, doubled points left out."""
    points = np.array(points, dtype=np.float64)
    if np.abs(points[[0, -1]] - np.stack([start, goal])).max() <= END_ERROR:
        points[0], points[-1] = start, goal
    kept = [0]
    for i in range(1, len(points)):
        if np.linalg.norm(points[i] - points[kept[-1]]) > MERGED:
            kept.append(i)
    if kept[-1] != len(points) - 1 and len(kept) > 1:
        kept[-1] = len(points) - 1
    return polyline(points[kept])


def piecewise(curve: Callable[[FloatArray], FloatArray], breaks: FloatArray, degree: int) -> Path:
    """A curve that is polynomial of the degree between breaks [P + 1], as a path; curve: s [n] -> [n, D]."""
    nodes = np.linspace(0.0, 1.0, degree + 1)
    powers = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in powers.tolist()])
    basis = binomials * nodes[:, None] ** powers * (1.0 - nodes[:, None]) ** (degree - powers)
    coefficients = [np.linalg.solve(basis, curve(left + nodes * (right - left))) for left, right in pairwise(breaks)]
    return Path(breaks, np.ascontiguousarray(coefficients))


def duration(path: Path, velocity_limit: FloatArray, acceleration_limit: FloatArray) -> float:
    """Seconds from rest to rest within the limits [D]; a polyline stops at its corners. nan if it cannot be timed."""
    try:
        return parametrise(path, velocity_limit, acceleration_limit).duration
    except PredplanError:
        return float("nan")


@njit(cache=True, error_model="numpy")
def smallest_clearance(chain: Chain, obstacles: Obstacles, q: FloatArray, ceiling: float) -> float:
    """Smallest clearance (m) of body spheres from obstacles and of links from each other over q [T, D], <= ceiling."""
    spheres, pairs = np.empty(len(chain.sphere_radius)), np.empty(len(chain.link_pairs))
    least = ceiling
    for i in range(len(q)):
        clearances(chain, obstacles, q[i], least, spheres, pairs)
        least = min(least, spheres.min())
        if len(pairs) > 0:
            least = min(least, pairs.min())
    return least
