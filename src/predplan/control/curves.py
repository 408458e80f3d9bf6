"""Learning curves: means and standard errors over runs, on one grid of steps."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from predplan.control.tables import CONDITION, Row
from predplan.control.tasks import FloatArray

POINTS = 101
EARLY = 0.9
"""A run that ends before this share of the longest's steps ended early: it diverged, or is not done yet."""

Condition = tuple[str, float, float]


@dataclass(frozen=True)
class Curve:
    """Over runs, at grid points."""

    steps: FloatArray  # [n] environment steps
    mean: FloatArray  # [n]
    error: FloatArray  # [n] standard error; 0 for one run
    seeds: int


def condition_of(row: Row) -> Condition:
    """Task, noise and drop."""
    task, noise, drop = (row[name] for name in CONDITION)
    return str(task), float(noise), float(drop)


def learning_curves(rows: Sequence[Row], column: str = "return_mean") -> dict[Condition, dict[str, Curve]]:
    """Condition -> method -> curve of a column of the table `learning`; methods without numbers there are left out.

    Between batches curves are linear. For the rest of its steps a run that ended early counts with its first number,
    which is the exploration's, where the column is a return, and not at all elsewhere.
    """
    runs: defaultdict[tuple[Condition, str], defaultdict[int, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        if row[column] is not None and np.isfinite(row[column]):
            runs[condition_of(row), row["method"]][row["seed"]].append(row)
    found: dict[Condition, dict[str, Curve]] = {}
    for (condition, method), by_seed in runs.items():
        found.setdefault(condition, {})[method] = _curve(list(by_seed.values()), column)
    return found


def _curve(runs: Sequence[Sequence[Row]], column: str) -> Curve:
    ordered = [sorted(run, key=lambda row: int(row["steps"])) for run in runs]
    steps = [np.array([row["steps"] for row in run], np.float64) for run in ordered]
    values = [np.array([row[column] for row in run], np.float64) for run in ordered]
    longest = max(one[-1] for one in steps)
    early = [one[-1] < EARLY * longest for one in steps]
    end = min(one[-1] for one, ended in zip(steps, early, strict=True) if not ended)
    grid = np.linspace(max(one[0] for one in steps) if len(steps[0]) > 1 else 0.0, end, POINTS)
    table = []
    for at, value, ended in zip(steps, values, early, strict=True):
        after = (value[0] if column == "return_mean" else np.nan) if ended else value[-1]
        table.append(np.where(grid > at[-1], after, np.interp(grid, at, value)))
    known = np.array(table)
    counts = np.isfinite(known).sum(axis=0)
    mean = np.nanmean(known, axis=0)
    spread = np.sqrt(np.nansum((known - mean) ** 2, axis=0) / np.maximum(counts - 1, 1))
    return Curve(grid, mean, spread / np.sqrt(counts), len(runs))
