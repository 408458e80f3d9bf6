"""The methods of a suite, with its settings and, once they are chosen, their steps."""

from __future__ import annotations

from dataclasses import replace

from predplan.errors import InputError
from predplan.planning.methods import Method, methods_of
from predplan.planning.tables import STEPS, read_rows
from stages.common import SuiteStage


def methods_of_suite(stage: SuiteStage) -> list[Method]:
    """The methods before tuning."""
    shared = {"epsilon": stage.suite.epsilon, "shrinkage": stage.settings.planning.shrinkage}
    return [replace(method, **shared) for method in methods_of(stage.suite.kind)]


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
