"""Choose each method's step on the tuning problems, which no comparison sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import groupby

from predplan.artifacts.tables import write_rows
from predplan.parallel import run
from predplan.planning.methods import Method
from predplan.planning.problems import Problem
from predplan.planning.running import Tried, choose_step, run_method, try_step
from predplan.planning.tables import STEPS, TUNING, read_problems
from stages.common import SuiteStage, run_stage
from stages.planning.compared import methods_of_suite


def main(stage: SuiteStage) -> None:
    suite = stage.suite
    chosen: list[Tried] = []
    if suite.steps_of == stage.name:  # a suite with another's steps chooses none
        problems = read_problems(stage.folder(), TUNING)
        methods = [method for method in methods_of_suite(stage) if not method.step_of]
        run_method(methods[0], problems[0], 1)  # compiles once, before there are several processes
        items = [replace(method, inverse_step=step) for method in methods for step in suite.inverse_steps]
        work = partial(attempt, problems=problems, iterations=suite.iterations)
        tried = run(work, items, workers=stage.settings.workers, scheduler=stage.settings.scheduler)
        for _, of_method in groupby(tried, key=lambda each: each.method):
            chosen += choose_step(list(of_method))
    inputs = [stage.path(name) for name in ("problems.parquet", "shapes.parquet", "robot.json")]
    provenance = stage.provenance(*inputs, settings=suite, shrinkage=stage.settings.planning.shrinkage)
    write_rows(stage.path("steps.parquet"), STEPS, [asdict(each) for each in chosen], provenance)


def attempt(method: Method, problems: Sequence[Problem], iterations: int) -> Tried:
    """One step of one method on all tuning problems."""
    return try_step(method, problems, iterations)


if __name__ == "__main__":
    run_stage(SuiteStage, main)
