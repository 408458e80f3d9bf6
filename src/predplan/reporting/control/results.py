"""What the report on control is drawn from: the tables' rows, and the few questions asked of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from predplan.control.comparing import is_baseline, summarise
from predplan.control.curves import Condition, Curve, condition_of, learning_curves
from predplan.control.tables import Row
from predplan.reporting.control.labels import LABELS, TITLES


@dataclass(frozen=True)
class ControlResults:
    """Rows of the tables that the stages wrote, by the columns of predplan.control.tables."""

    learning: Sequence[Row] = ()
    runs: Sequence[Row] = ()
    comparisons: Sequence[Row] = ()
    prediction: Sequence[Row] = ()

    @cached_property
    def conditions(self) -> list[Condition]:
        """Of all runs: tasks in their order, exact before noisy before lossy."""
        found = {condition_of(run) for run in self.runs}
        return sorted(found, key=_place_of)

    @cached_property
    def methods(self) -> list[str]:
        """Of all runs, in the order of the labels; others after them, by name."""
        order = list(LABELS)
        found = {str(run["method"]) for run in self.runs}
        return sorted(found, key=lambda name: (order.index(name) if name in order else len(order), name))

    @cached_property
    def _summary(self) -> dict[tuple[Condition, str], Row]:
        return {(condition_of(row), row["method"]): row for row in summarise(self.runs)}

    def summary(self, condition: Condition, method: str) -> Row | None:
        """The method's row of the table `control summary`; None where it did not run."""
        return self._summary.get((condition, method))

    def returns(self, condition: Condition, method: str) -> NDArray[np.float64]:
        """Mean returns over training [n] of the method's runs."""
        own = [run for run in self.runs if condition_of(run) == condition and run["method"] == method]
        return np.array([run["mean_return"] for run in own], np.float64)

    def compared(self, condition: Condition, method: str, other: str) -> Row | None:
        """The tests of mean return over training, whichever way round they were written; None if not made."""
        return self._comparisons.get((condition, method, other))

    @cached_property
    def _comparisons(self) -> dict[tuple[Condition, str, str], Row]:
        found: dict[tuple[Condition, str, str], Row] = {}
        turned = {"better": "worse", "worse": "better"}
        for row in self.comparisons:
            if row["measure"] == "mean_return":
                condition, method, other = condition_of(row), row["method"], row["other"]
                found[condition, method, other] = row
                signs = {"difference": -row["difference"], "t": None if row["t"] is None else -row["t"]}
                seeds = {"seeds": row["other_seeds"], "other_seeds": row["seeds"]}
                verdict = turned.get(row["verdict"], row["verdict"])
                back = {**row, **signs, **seeds, "method": other, "other": method, "verdict": verdict}
                found.setdefault((condition, other, method), back)
        return found

    def best_baseline(self, condition: Condition) -> str | None:
        """The baseline with the highest mean return over training."""
        ran = [name for name in self.methods if is_baseline(name) and self.summary(condition, name)]
        return max(ran, key=lambda name: self._summary[condition, name]["mean_return"], default=None)

    @cached_property
    def curves(self) -> dict[Condition, dict[str, Curve]]:
        """Returns by steps."""
        return learning_curves(self.learning)

    def seeds(self) -> tuple[int, int]:
        """The least and the largest number of runs of a method in a condition."""
        counts = [row["seeds"] for row in self._summary.values()]
        return min(counts, default=0), max(counts, default=0)

    @cached_property
    def errors(self) -> dict[Condition, dict[str, dict[int, tuple[float, float, int]]]]:
        """Condition -> predictor -> steps ahead -> mean error over seeds, its standard error and the seeds."""
        grouped: dict[Condition, dict[str, dict[int, list[float]]]] = {}
        for row in self.prediction:
            own = grouped.setdefault(condition_of(row), {}).setdefault(row["predictor"], {})
            own.setdefault(row["steps"], []).append(row["error"])
        return {
            condition: {name: {k: _mean(values) for k, values in ahead.items()} for name, ahead in own.items()}
            for condition, own in sorted(grouped.items(), key=lambda item: _place_of(item[0]))
        }


def _mean(values: Sequence[float]) -> tuple[float, float, int]:
    array = np.array(values)
    error = float(array.std(ddof=1) / np.sqrt(len(array))) if len(array) > 1 else 0.0
    return float(array.mean()), error, len(array)


def _place_of(condition: Condition) -> tuple[int, str, float, float]:
    task, noise, drop = condition
    order = list(TITLES)
    return (order.index(task) if task in order else len(order)), task, drop, noise
