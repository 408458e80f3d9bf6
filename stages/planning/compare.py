"""Compare the methods of a suite: curves over iterations, paired tests, and what the report draws."""

from __future__ import annotations

import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from predplan.artifacts.files import write_json, write_whole
from predplan.artifacts.tables import read_rows, write_rows
from predplan.planning.comparing import paired_test, summary
from predplan.planning.kinds import IN_THE_PLANE
from predplan.planning.kinematics import poses, tool_trace
from predplan.planning.measures import cost_field
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray
from predplan.planning.tables import (
    COMPARISONS,
    COSTS,
    CURVES,
    EXAMPLE,
    FIELD,
    MEASURES,
    OUTCOMES,
    STEPS,
    TEST,
    TRAJECTORIES,
    read_problems,
)
from stages.common import SuiteStage, run_stage
from stages.planning.compared import plane_of

EARLY = 5
"""The iteration that is compared besides the last: Figs. 4.6a and 4.9 stop there."""
FIELD_COUNT = 121
"""Points a side of the drawn cost field."""
CHIEF = ("grbf", "waypoints-velocity", "chomp-velocity")
"""Methods of which `dvc metrics show` tells."""
TOLD = ("outcomes.parquet", "times.parquet")

Rows = list[dict[str, Any]]
Costs = Mapping[tuple[str, str, int], FloatArray]


def main(stage: SuiteStage) -> None:
    costs = costs_of(read_rows(stage.path("costs.parquet"), COSTS))
    problem = read_problems(stage.folder(), TEST)[0]
    inputs = [stage.path(name) for name in ("costs.parquet", "outcomes.parquet", "trajectories.parquet")]
    provenance = stage.provenance(*inputs, settings=stage.suite)
    curves = [
        {"method": method, "measure": measure, "iteration": i, **summary(values)._asdict()}
        for (method, measure, i), values in costs.items()
    ]
    write_rows(stage.result("curves.parquet"), CURVES, curves, provenance)
    iterations = sorted({min(EARLY, stage.suite.iterations), stage.suite.iterations})
    write_rows(stage.result("comparisons.parquet"), COMPARISONS, comparison_rows(costs, iterations), provenance)
    trajectories = read_rows(stage.path("trajectories.parquet"), TRAJECTORIES)
    write_rows(stage.result("example.parquet"), EXAMPLE, example_rows(problem, trajectories, stage), provenance)
    write_rows(stage.result("field.parquet"), FIELD, field_rows(problem, stage), provenance)
    outcomes = read_rows(stage.path("outcomes.parquet"), OUTCOMES)
    write_json(stage.result("metrics.json"), {"free": metrics(outcomes)})
    for name in TOLD:
        with write_whole(stage.result(name)) as temporary:
            shutil.copyfile(stage.path(name), temporary)
    steps = stage.folder(stage.suite.steps_of) / "steps.parquet"
    write_rows(stage.result("steps.parquet"), STEPS, read_rows(steps, STEPS), stage.provenance(steps))


def costs_of(rows: Rows) -> Costs:
    """Costs [n] of all problems, in their order, by method, measure and iteration."""
    found: defaultdict[tuple[str, str, int], list[float]] = defaultdict(list)
    for row in rows:
        for measure in MEASURES:
            found[row["method"], measure, row["iteration"]].append(row[measure])
    return {key: np.array(values) for key, values in found.items()}


def comparison_rows(costs: Costs, iterations: Sequence[int]) -> Rows:
    """Every pair of methods, on every measure; none with one problem only."""
    methods = list(dict.fromkeys(method for method, _, _ in costs))
    return [
        {"method": method, "other": other, "iteration": i, "measure": measure, **test._asdict()}
        for i in iterations
        for measure in MEASURES
        for method, other in combinations(methods, 2)
        if len(costs[method, measure, i]) > 1
        for test in [paired_test(costs[method, measure, i], costs[other, measure, i])]
    ]


def example_rows(problem: Problem, rows: Rows, stage: SuiteStage) -> Rows:
    """The first problem's trajectories, with the end effector's place and, in the plane, the body's."""
    plane = stage.suite.kind in IN_THE_PLANE
    own = [row for row in rows if row["problem"] == problem.name]
    q = np.array([row["q"] for row in own])
    tool = tool_trace(problem.robot.chain, q)
    joints = poses(problem.robot.chain, q)[1][:, 1:, :2]
    body = np.concatenate([joints, tool[:, None, :2]], axis=1).reshape(len(q), -1)
    return [
        {
            **{name: row[name] for name in ("method", "iteration", "s", "q")},
            "tool": at.tolist(),
            "body": points.tolist() if plane else [],
        }
        for row, at, points in zip(own, tool, body, strict=True)
    ]


def field_rows(problem: Problem, stage: SuiteStage) -> Rows:
    """The cost field of the first problem's scene, in the plane."""
    if stage.suite.kind not in IN_THE_PLANE:
        return []
    lower, upper = plane_of(stage.suite.kind)
    field = cost_field(problem.scene, lower, upper, FIELD_COUNT, stage.suite.epsilon)
    xs, ys = (np.linspace(low, high, FIELD_COUNT).tolist() for low, high in zip(lower, upper, strict=True))
    return [{"x": x, "y": y, "cost": float(field[j, i])} for j, y in enumerate(ys) for i, x in enumerate(xs)]


def metrics(outcomes: Rows) -> dict[str, float]:
    """Share free of collision of each chief method."""
    free = {method: [row["free"] for row in outcomes if row["method"] == method] for method in CHIEF}
    return {method: round(sum(each) / len(each), 4) for method, each in free.items() if each}


if __name__ == "__main__":
    run_stage(SuiteStage, main)
