"""Run every method on every problem: costs by iteration, trajectories, certificates, and the time of an iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from predplan.artifacts.tables import write_rows
from predplan.parallel import run
from predplan.planning.measures import GRID
from predplan.planning.methods import Method
from predplan.planning.plan_files import write_motion
from predplan.planning.problems import Problem
from predplan.planning.running import Run, iteration_times, run_method, supports_of
from predplan.planning.tables import COSTS, MEASURES, OUTCOMES, SUPPORTS, TEST, TIMES, TRAJECTORIES, read_problems
from stages.common import SuiteStage, run_stage
from stages.planning.compared import played, tuned_methods

TIMED_ITERATIONS = 10
"""Of each descent whose time is measured."""

Rows = list[dict[str, Any]]


def main(stage: SuiteStage) -> None:
    suite, planning = stage.suite, stage.settings.planning
    problems, methods = read_problems(stage.folder(), TEST), tuned_methods(stage)
    run_method(methods[0], problems[0], 1)  # compiles once, before there are several processes
    work = partial(run_all, problems=problems, iterations=suite.iterations)
    found = run(work, methods, workers=stage.settings.workers, scheduler=stage.settings.scheduler)
    steps = stage.folder(suite.steps_of) / "steps.parquet"
    inputs = [*(stage.path(name) for name in ("problems.parquet", "shapes.parquet", "robot.json")), steps]
    provenance = stage.provenance(*inputs, settings=suite, shrinkage=planning.shrinkage)
    costs: Rows = []
    outcomes: Rows = []
    trajectories: Rows = []
    for method, runs in zip(methods, found, strict=True):
        for problem, each in zip(problems, runs, strict=True):
            key = {"method": method.name, "problem": problem.name}
            costs += cost_rows(key, each)
            certificate = each.certificate
            outcome = {"inverse_step": method.inverse_step, "free": certificate.free, "reason": certificate.reason}
            outcomes.append(key | outcome)
            shown = range(suite.iterations + 1) if problem is problems[0] else (suite.iterations,)
            trajectories += [row for i in shown for row in trajectory_rows(key, i, each)]
        write_example(stage, method, problems[0], runs[0], provenance)
    supports: Rows = [
        {"method": method.name, "problem": problems[0].name, "iteration": i, "times": times.tolist()}
        for method in methods
        for i, times in enumerate(supports_of(method, problems[0], suite.iterations))
    ]
    write_rows(stage.path("costs.parquet"), COSTS, costs, provenance)
    write_rows(stage.path("outcomes.parquet"), OUTCOMES, outcomes, provenance)
    write_rows(stage.path("trajectories.parquet"), TRAJECTORIES, trajectories, provenance)
    write_rows(stage.path("supports.parquet"), SUPPORTS, supports, provenance)
    write_rows(stage.path("times.parquet"), TIMES, time_rows(stage, methods, problems[0]), provenance)


def run_all(method: Method, problems: Sequence[Problem], iterations: int) -> list[Run]:
    """One method on all problems; of all but the first only the last trajectory is kept, which is much less to send."""
    runs = [run_method(method, problem, iterations) for problem in problems]
    return runs[:1] + [replace(each, trajectories=each.trajectories[-1:]) for each in runs[1:]]


def cost_rows(key: dict[str, str], run: Run) -> Rows:
    """A row an iteration."""
    columns = run.measures._asdict()
    return [
        key | {"iteration": i} | {name: float(columns[name][i]) for name in MEASURES}
        for i in range(len(run.measures.maximum))
    ]


def trajectory_rows(key: dict[str, str], iteration: int, run: Run) -> Rows:
    """A row a time; runs that kept their last trajectory alone have it at -1."""
    q = run.trajectories[iteration if len(run.trajectories) > 1 else -1]
    return [key | {"iteration": iteration, "s": s, "q": at} for s, at in zip(GRID.tolist(), q.tolist(), strict=True)]


def write_example(stage: SuiteStage, method: Method, problem: Problem, run: Run, provenance: Any) -> None:
    """The first problem's last trajectory as a recording."""
    certificate = run.certificate
    facts = {
        "method": method.name,
        "problem": problem.name,
        "certificate": {
            "free": certificate.free,
            "margin": certificate.margin,
            "configurations": certificate.configurations,
            "reason": certificate.reason,
            "s": certificate.s if np.isfinite(certificate.s) else None,
        },
    }
    states = played(problem, run.trajectories[-1])
    path = stage.path("trajectories") / f"{method.name}.mcap"
    write_motion(path, problem.robot, problem.scene, states, provenance, facts, meshes=False)


def time_rows(stage: SuiteStage, methods: Sequence[Method], problem: Problem) -> Rows:
    """Times of an iteration, measured in this process while nothing else of ours runs."""
    timed = list(methods)
    for samples in stage.suite.timings:
        timed += [replace(method, samples=samples) for method in methods if method.samples != samples]
    taken = iteration_times(timed, problem, TIMED_ITERATIONS, stage.settings.planning.repeats)
    return [
        {"method": method.name, "samples": method.samples, "repeat": repeat, "time_ms": float(value)}
        for method, row in zip(timed, taken, strict=True)
        for repeat, value in enumerate(row)
    ]


if __name__ == "__main__":
    run_stage(SuiteStage, main)
