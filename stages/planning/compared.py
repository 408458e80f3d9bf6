"""The methods of a suite, with its settings and, once they are chosen, their steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from predplan.artifacts.recordings import JointStates
from predplan.artifacts.tables import read_rows
from predplan.errors import InputError
from predplan.planning.kinds import SuiteKind
from predplan.planning.measures import GRID
from predplan.planning.methods import Method, methods_of
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray
from predplan.planning.tables import STEPS
from stages.common import SuiteStage


def methods_of_suite(stage: SuiteStage) -> list[Method]:
    """The methods before tuning."""
    epsilon, shrinkage = stage.suite.epsilon, stage.settings.planning.shrinkage
    return [replace(method, epsilon=epsilon, shrinkage=shrinkage) for method in methods_of(stage.suite.kind)]


def tuned_methods(stage: SuiteStage) -> list[Method]:
    """The methods with the steps chosen on the tuning problems of `steps_of`."""
    path = stage.folder(stage.suite.steps_of) / "steps.parquet"
    steps = {row["method"]: row["inverse_step"] for row in read_rows(path, STEPS) if row["chosen"]}
    tuned = []
    for method in methods_of_suite(stage):
        source = method.step_of or method.name
        if source not in steps:
            raise InputError(f"{path}: no step of {source}; expected the steps of a suite with the same methods")
        tuned.append(replace(method, inverse_step=steps[source] / method.step_factor))
    return tuned


def plane_of(kind: SuiteKind) -> tuple[FloatArray, FloatArray]:
    """The lower left and upper right corner (m) of what is shown of a suite in the plane."""
    return (np.zeros(2), np.ones(2)) if kind == "maze" else (np.full(2, -1.3), np.full(2, 1.4))


def played(problem: Problem, q: FloatArray) -> JointStates:
    """A trajectory [101, D] on GRID as a motion, as fast as the velocity limits let it go at equal steps."""
    speed = np.gradient(q, GRID, axis=0)
    duration = max(float(np.max(np.abs(speed) / problem.robot.velocity_limit)), 1e-3)
    return JointStates(GRID * duration, problem.robot.joints, q, speed / duration)
