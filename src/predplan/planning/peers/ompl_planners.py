"""OMPL (Şucan, Moll and Kavraki 2012) with our compiled collision checker called back from C++ through Python.

As one uses it: default range, default resolution (1% of the space's extent), SimpleSetup's simplification, which ends
with B-spline smoothing. A callback a configuration costs about 10 µs where the check itself takes 2 (the checker's many
arrays are unpacked each time), so one variant checks whole motions in one callback; it is the faster way to OMPL from
Python. Another variant simplifies by shortcuts alone, which leaves few corners.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from ompl import base, geometric, util

from predplan.planning.benchmarks import Found, Prepare, Solve, points_path
from predplan.planning.collisions import valid
from predplan.planning.peers import PeerSettings
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.sampling import motion_is_valid

RESOLUTION = 0.08
"""rad: largest step of a joint between configurations looked at, where whole motions are checked; as in our own."""
OPTIMISING = {"ompl-bitstar": geometric.BITstar}
"""Planners that use all of their time. AORRTC is left out: its paths did not always reach the goal, nor did it stop."""


def make(name: str, robot: Robot, settings: PeerSettings) -> Prepare:
    """RRT-Connect with one of three simplifications or checks, or an optimising planner. OMPL's seed is set once."""
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(1)
    optimising = OPTIMISING.get(name)

    def prepare(problem: Problem) -> Solve:
        def solve(seed: int) -> Found:
            setup = _setup(problem, motions=name.endswith("-motions"))
            information = setup.getSpaceInformation()
            setup.setPlanner((optimising or geometric.RRTConnect)(information))
            if optimising is not None:
                setup.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
            setup.solve(settings.optimising_s if optimising else settings.ompl_s)
            if not setup.haveExactSolutionPath():
                return Found(None, "no path in time")
            if name.endswith("-shortcuts"):
                _take_shortcuts(setup)
            elif optimising is None:
                setup.simplifySolution()
            joints = range(len(problem.start))
            points = np.array([[state[j] for j in joints] for state in setup.getSolutionPath().getStates()])
            return Found(points_path(points, problem.start, problem.goal), f"{len(points)} points")

        return solve

    return prepare


def _setup(problem: Problem, motions: bool) -> Any:
    chain, obstacles, joints = problem.robot.chain, problem.scene.obstacles, len(problem.start)
    space, bounds = base.RealVectorStateSpace(joints), base.RealVectorBounds(joints)
    for j in range(joints):
        bounds.setLow(j, float(chain.lower[j]))
        bounds.setHigh(j, float(chain.upper[j]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    q, other = np.empty(joints), np.empty(joints)

    def fill(values: FloatArray, state: Any) -> None:
        for j in range(joints):
            values[j] = state[j]

    def configuration_is_valid(state: Any) -> bool:
        fill(q, state)
        return bool(valid(chain, obstacles, q, 0.0))

    setup.setStateValidityChecker(configuration_is_valid)
    if motions:

        class Motions(base.MotionValidator):  # type: ignore[misc]
            def checkMotion(self, first: Any, second: Any) -> bool:
                fill(q, first)
                fill(other, second)
                return bool(
                    valid(chain, obstacles, other, 0.0) and motion_is_valid(chain, obstacles, q, other, RESOLUTION, 0.0)
                )

        setup.getSpaceInformation().setMotionValidator(Motions(setup.getSpaceInformation()))
    start, goal = space.allocState(), space.allocState()
    for j in range(joints):
        start[j], goal[j] = float(problem.start[j]), float(problem.goal[j])
    setup.setStartAndGoalStates(start, goal)
    return setup


def _take_shortcuts(setup: Any) -> None:
    path, simplifier = setup.getSolutionPath(), setup.getPathSimplifier()
    for _ in range(5):  # as often as OMPL's own simplification does
        if not simplifier.partialShortcutPath(path):
            break
    simplifier.reduceVertices(path)
    simplifier.collapseCloseVertices(path)
