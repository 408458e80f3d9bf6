"""What the report on planning is drawn from: one suite's tables, and the few questions asked of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predplan.planning.kinds import SuiteKind
from predplan.planning.methods import Method, methods_of

Floats = NDArray[np.float64]
Rows = Sequence[Mapping[str, Any]]
"""A table's rows, by the columns of its schema in predplan.planning.tables."""

TITLES: Mapping[SuiteKind, str] = {
    "maze": "A point in a maze",
    "planar": "A three-joint arm in the plane",
    "kitchen-simple": "Kitchen: beside the cabinet",
    "kitchen-cluttered": "Kitchen: eight objects above the table",
    "kitchen-constrained": "Kitchen: into the microwave",
}


@dataclass(frozen=True)
class SuiteResults:
    """One suite: its settings, and the rows of the tables that the stages wrote."""

    name: str
    kind: SuiteKind
    problems: int
    tuning: int
    iterations: int
    epsilon: float  # m
    steps_of: str
    curves: Rows
    comparisons: Rows
    example: Rows
    field: Rows
    outcomes: Rows
    times: Rows
    steps: Rows

    @property
    def title(self) -> str:
        """The suite as the report calls it."""
        return TITLES[self.kind] + (f", steps of {self.steps_of}" if self.borrowed else "")

    @property
    def borrowed(self) -> bool:
        """Whether its steps were chosen on another suite's problems."""
        return self.steps_of != self.name

    @cached_property
    def methods(self) -> dict[str, Method]:
        """The methods that were run, by name, in their order."""
        run = {row["method"] for row in self.outcomes}
        return {method.name: method for method in methods_of(self.kind) if method.name in run}

    @cached_property
    def _curves(self) -> dict[tuple[str, str, int], tuple[float, float]]:
        return {
            (row["method"], row["measure"], row["iteration"]): (row["mean"], row["standard_error"])
            for row in self.curves
        }

    def mean(self, method: str, measure: str, iteration: int | None = None) -> tuple[float, float]:
        """Mean over problems and its standard error, by default after the last iteration."""
        return self._curves[method, measure, self.iterations if iteration is None else iteration]

    def curve(self, method: str, measure: str) -> tuple[Floats, Floats]:
        """Means and standard errors by iteration, each [iterations + 1]."""
        found = np.array([self._curves[method, measure, i] for i in range(self.iterations + 1)])
        return found[:, 0], found[:, 1]

    def free(self, method: str) -> float:
        """Share of the problems whose last trajectory is certified."""
        own = [bool(row["free"]) for row in self.outcomes if row["method"] == method]
        return sum(own) / len(own)

    @cached_property
    def _comparisons(self) -> dict[tuple[str, str, str, int], Mapping[str, Any]]:
        return {(row["method"], row["other"], row["measure"], row["iteration"]): row for row in self.comparisons}

    def compared(self, method: str, other: str, measure: str, iteration: int | None = None) -> Mapping[str, Any] | None:
        """The paired tests of a method against another, whichever way round they were written; None if not made."""
        at = self.iterations if iteration is None else iteration
        if (method, other, measure, at) in self._comparisons:
            return self._comparisons[method, other, measure, at]
        row = self._comparisons.get((other, method, measure, at))
        if row is None:
            return None
        return {**row, **{name: -row[name] for name in ("difference", "effect", "t", "w_z")}}

    def inverse_step(self, method: str) -> float:
        """The λ the method was run with."""
        return next(float(row["inverse_step"]) for row in self.outcomes if row["method"] == method)

    def trajectory(self, method: str, iteration: int, column: str = "tool") -> Floats:
        """The first problem's trajectory after an iteration [101, ...]."""
        rows = [row[column] for row in self.example if row["method"] == method and row["iteration"] == iteration]
        return np.array(rows)

    @cached_property
    def field_grid(self) -> tuple[Floats, Floats, Floats]:
        """Places x [n], y [n] (m) and cost [n, n] (m) of the first problem's scene."""
        xs, ys = (np.unique([row[name] for row in self.field]) for name in ("x", "y"))
        return xs, ys, np.array([row["cost"] for row in self.field]).reshape(len(ys), len(xs))

    def time_ms(self, method: str, samples: int) -> Floats:
        """Milliseconds of an iteration [repeats]; empty where it was not measured."""
        return np.array(
            [row["time_ms"] for row in self.times if row["method"] == method and row["samples"] == samples], np.float64
        )
