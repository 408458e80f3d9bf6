"""Runs as rows of the tables `learning` and `runs`, and predictors' errors as rows of `prediction`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from predplan.control.comparing import final_mean, mean_over_training
from predplan.control.environments import EnvironmentSettings
from predplan.control.prediction import PredictionError
from predplan.control.running import Order, Run, steps_to_threshold
from predplan.control.tables import FINISHED
from predplan.control.training import Progress

_KNOWN = ("update", "steps", "episodes", "cpu_s")
_PERHAPS = ("return_mean", "return_std", "length_mean", "prediction_error", "policy_kl", "entropy", "value_error")


def learning_rows(run: Run) -> list[dict[str, Any]]:
    """A row for each update; what is not a number there is missing."""
    rows, before = [], 0
    for one in run.progress:
        perhaps = {name: _number(getattr(one, name)) for name in _PERHAPS}
        known = {name: getattr(one, name) for name in _KNOWN}
        rows.append({**_named(run.order), **known, **perhaps, "skipped": one.skipped - before})
        before = one.skipped
    return rows


def run_row(run: Run) -> dict[str, Any]:
    """The run's row. One that diverged counts for the rest of its steps with its first return, the exploration's."""
    steps, returns = _curve(run.progress)
    budget = run.order.schedule.steps
    mean = final = float("nan")
    if np.isfinite(returns).any():
        mean = mean_over_training(steps, returns, budget)
        if run.reason != FINISHED and steps[-1] < budget:
            first = returns[np.argmax(np.isfinite(returns))]
            steps, returns = np.append(steps, budget), np.append(returns, first)
        final = final_mean(steps, returns)
    return {
        **_named(run.order),
        "steps": run.progress[-1].steps if run.progress else 0,
        "mean_return": mean,
        "final_return": final,
        "steps_to_threshold": steps_to_threshold(run.progress, run.order.task.task),
        "reason": run.reason,
        "cpu_s": run.progress[-1].cpu_s if run.progress else 0.0,
    }


def prediction_rows(task: EnvironmentSettings, seed: int, errors: Sequence[PredictionError]) -> list[dict[str, Any]]:
    """A row for each error."""
    return [
        {
            **_condition(task),
            "seed": seed,
            "predictor": one.predictor,
            "steps": one.steps,
            "error": one.error,
            "rows": one.rows,
        }
        for one in errors
    ]


def _curve(progress: Sequence[Progress]) -> tuple[np.ndarray[Any, np.dtype[np.float64]], ...]:
    steps = np.array([one.steps for one in progress], np.float64)
    return steps, np.array([one.return_mean for one in progress], np.float64)


def _named(order: Order) -> dict[str, Any]:
    return {**_condition(order.task), "method": order.method, "seed": order.seed}


def _condition(task: EnvironmentSettings) -> dict[str, Any]:
    return {"task": task.task, "noise": task.noise, "drop": task.drop}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
