"""Which method learns better: means over training, and tests over seeds.

A run's measure is one number, and seeds are the sample. Two methods are compared by Welch's t-test, which allows each
its own variance; where seeds are shared, also by the permutation test of paired differences, which supposes no
distribution but cannot get below 2 / 2^n. Holm's correction is for all that a method is held against in one condition.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from predplan.control.tables import CONDITION, DIVERGED, Row
from predplan.control.tasks import FloatArray

OWN = "rpsp"
"""The method that all others are held against."""
ALIKE = (("rpsp-vrpg", "rpsp-alt"), ("gru-predictive", "gru"))
LEVEL = 0.05
"""Differences with a corrected p-value above it are not counted as differences."""
BETTER, WORSE, EQUAL, TOO_FEW = "better", "worse", "no difference", "too few seeds"
EXACT_PAIRS = 16
"""Up to so many pairs all signs are tried, beyond it so many as 2 to that power."""

Condition = tuple[str, float, float]


class Welch(NamedTuple):
    """The difference of two means, and whether it is one."""

    difference: float
    standard_error: float
    t: float
    p: float  # two-sided


class Ratio(NamedTuple):
    """How many times as large one method's returns are, over several conditions."""

    ratio: float
    low: float  # of the 95 % interval
    high: float
    p: float  # two-sided, that it is 1


def mean_over_training(steps: FloatArray, returns: FloatArray, budget: int) -> float:
    """Area under return against steps, over budget: each batch's return holds for the steps it took.

    steps [n] environment steps after each batch, the exploration first; returns [n], NaN where no episode ended, which
    then takes the last known. What is missing of the budget, where a run diverged, counts as the exploration did.
    Raises ValueError where no batch has a return.
    """
    known = np.isfinite(returns)
    if not known.any():
        raise ValueError("no batch has a return")
    last = np.maximum.accumulate(np.where(known, np.arange(len(returns)), -1))
    filled = np.where(last >= 0, returns[last], returns[np.argmax(known)])
    area = float(np.sum(filled * np.diff(steps, prepend=0.0)))
    missing = max(0.0, budget - float(steps[-1]))
    return (area + missing * float(filled[0])) / (float(steps[-1]) + missing)


def final_mean(steps: FloatArray, returns: FloatArray, share: float = 0.1) -> float:
    """Mean return of the last share of the steps, a batch that began before it counted in part.

    steps [n] and returns [n] as of `mean_over_training`; where no episode ended there, the last return that is known.
    """
    known = np.isfinite(returns)
    begins = np.concatenate([[0.0], steps[:-1]])
    weight = np.where(known, steps - np.maximum(begins, steps[-1] * (1.0 - share)), 0.0).clip(min=0.0)
    if not weight.any():
        return float(returns[known][-1]) if known.any() else float("nan")
    return float(np.sum(weight[known] * returns[known]) / weight.sum())


def compare_runs(
    runs: Sequence[Row], method: str, others: Sequence[str], measure: str = "mean_return"
) -> list[dict[str, Any]]:
    """Rows of the table `comparisons`: the method against each of the others in every condition where both ran."""
    rows = []
    for condition, methods in _by_condition(runs, measure).items():
        tested = [other for other in others if other in methods and other != method]
        if method not in methods or not tested:
            continue
        found = [(other, _compare(methods[method], methods[other])) for other in tested]
        corrected = holm([row["welch_p"] for _, row in found])
        for (other, row), p in zip(found, corrected, strict=True):
            named = dict(zip(CONDITION, condition, strict=True)) | {"method": method, "other": other}
            rows.append({**named, "measure": measure, **row, "holm_p": p, "verdict": _verdict(row["difference"], p)})
    return rows


def compare_all(runs: Sequence[Row], method: str = OWN) -> list[dict[str, Any]]:
    """The comparisons that the report tells of: the method against all baselines, then against all else that ran.

    Variants are held against each other too where they are of one idea (`ALIKE`). Each is a family of its own for
    Holm's correction, as each is a question of its own.
    """
    names = list(dict.fromkeys(str(run["method"]) for run in runs))
    baselines = [name for name in names if is_baseline(name) and name != method]
    others = [name for name in names if name not in baselines and name != method]
    rows = compare_runs(runs, method, baselines) + compare_runs(runs, method, others)
    return rows + [row for one, other in ALIKE for row in compare_runs(runs, one, [other])]


def is_baseline(method: str) -> bool:
    """Whether a method has no predictive state and is updated as ours: a finite memory (fm2) or a GRU (gru, gru-64)."""
    return re.fullmatch(r"fm\d+|gru(-\d+)?", method) is not None


def summarise(runs: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of the table `control summary`: a row for each condition and method, in the order of the runs."""
    groups: defaultdict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for run in runs:
        groups[*(run[name] for name in CONDITION), run["method"]].append(run)
    return [{**dict(zip((*CONDITION, "method"), key, strict=True)), **_summary(own)} for key, own in groups.items()]


def welch(method: FloatArray, other: FloatArray) -> Welch:
    """Welch's t-test of means over runs [n] and [m], two each at least.

    Where neither varies, p is 1 without a difference and 0 with one. Raises ValueError for fewer than two of either.
    """
    if min(len(method), len(other)) < 2:
        raise ValueError(f"found {len(method)} and {len(other)} runs; expected two of each at least")
    difference = float(method.mean() - other.mean())
    a, b = method.var(ddof=1) / len(method), other.var(ddof=1) / len(other)
    error = float(np.sqrt(a + b))
    if error <= 1e-12 * max(1.0, abs(difference)):
        same = abs(difference) <= 1e-12 * max(1.0, abs(float(other.mean())))
        return Welch(difference, 0.0, 0.0 if same else float(np.copysign(np.inf, difference)), float(same))
    freedom = (a + b) ** 2 / (a**2 / (len(method) - 1) + b**2 / (len(other) - 1))
    t = difference / error
    return Welch(difference, error, t, float(2.0 * stats.t.sf(abs(t), freedom)))


def pooled_ratio(conditions: Sequence[tuple[FloatArray, FloatArray]]) -> Ratio:
    """Ratio of a method's runs [n] to another's [m], all above 0: the geometric mean over conditions.

    Welch's test on logarithms, its differences and their variances summed over conditions. Raises ValueError where a
    condition has fewer than two runs of either, or one that is not above 0.
    """
    runs = [one for pair in conditions for one in pair]
    if any(len(one) < 2 or not (one > 0.0).all() for one in runs):
        raise ValueError("expected two runs of each method at least in every condition, all above 0")
    logs = [np.log(one) for one in runs]
    difference = sum(float(a.mean() - b.mean()) for a, b in zip(logs[::2], logs[1::2], strict=True)) / len(conditions)
    variances = np.array([one.var(ddof=1) / len(one) for one in logs])
    error = float(np.sqrt(variances.sum())) / len(conditions)
    if error == 0.0:
        same = float(np.exp(difference))
        return Ratio(same, same, same, float(difference == 0.0))
    freedom = variances.sum() ** 2 / np.sum(variances**2 / [len(one) - 1 for one in logs])
    wide = error * float(stats.t.ppf(0.975, freedom))
    low, ratio, high = (float(np.exp(difference + shift)) for shift in (-wide, 0.0, wide))
    return Ratio(ratio, low, high, float(2.0 * stats.t.sf(abs(difference) / error, freedom)))


def permutation_p(differences: FloatArray) -> float:
    """Two-sided p-value of the mean of paired differences [n] when the sign of each is a coin's.

    Exact up to EXACT_PAIRS pairs; beyond, from as many draws of a generator that is always the same.
    """
    n = len(differences)
    if n <= EXACT_PAIRS:
        signs = 1.0 - 2.0 * (np.arange(2**n)[:, None] >> np.arange(n) & 1)
    else:
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (2**EXACT_PAIRS, n))
        signs[0] = 1.0
    sums = np.abs(signs @ differences)
    return float(np.mean(sums >= abs(differences.sum()) - 1e-9 * np.abs(differences).sum()))


def holm(p: Sequence[float | None]) -> list[float | None]:
    """p-values by Holm's (1979) step-down correction, in their order; None, a test that was not made, takes no part."""
    made = sorted((value, index) for index, value in enumerate(p) if value is not None)
    corrected: list[float | None] = [None] * len(p)
    largest = 0.0
    for done, (value, index) in enumerate(made):
        largest = max(largest, min(1.0, (len(made) - done) * value))
        corrected[index] = largest
    return corrected


def _by_condition(runs: Iterable[Row], measure: str) -> dict[Condition, dict[str, dict[int, float]]]:
    """Condition -> method -> seed -> value."""
    found: dict[Condition, dict[str, dict[int, float]]] = {}
    for run in runs:
        condition: Condition = (run["task"], run["noise"], run["drop"])
        found.setdefault(condition, {}).setdefault(run["method"], {})[run["seed"]] = float(run[measure])
    return found


def _compare(method: dict[int, float], other: dict[int, float]) -> dict[str, Any]:
    own, others = np.array(list(method.values())), np.array(list(other.values()))
    shared = sorted(method.keys() & other.keys())
    paired = np.array([method[seed] - other[seed] for seed in shared])
    tested = welch(own, others) if min(len(own), len(others)) > 1 else None
    return {
        "seeds": len(own),
        "other_seeds": len(others),
        "difference": float(own.mean() - others.mean()),
        "standard_error": tested.standard_error if tested else None,
        "t": tested.t if tested else None,
        "welch_p": tested.p if tested else None,
        "pairs": len(shared),
        "permutation_p": permutation_p(paired) if len(shared) > 1 else None,
    }


def _verdict(difference: float, p: float | None) -> str:
    if p is None:
        return TOO_FEW
    if p >= LEVEL:
        return EQUAL
    return BETTER if difference > 0 else WORSE


def _summary(runs: Sequence[Row]) -> dict[str, Any]:
    mean, error = mean_and_error(np.array([run["mean_return"] for run in runs], np.float64))
    final, final_error = mean_and_error(np.array([run["final_return"] for run in runs], np.float64))
    taken = np.array([np.inf if run["steps_to_threshold"] is None else run["steps_to_threshold"] for run in runs])
    # The upper of two middle ones: a median must not lie between a run that arrived and one that never did.
    median = float(np.sort(taken)[len(taken) // 2])
    return {
        "seeds": len(runs),
        "mean_return": mean,
        "standard_error": error,
        "final_return": final,
        "final_standard_error": final_error,
        "reached": int(np.isfinite(taken).sum()),
        "steps_to_threshold": median if np.isfinite(median) else None,
        "diverged": sum(run["reason"].startswith(DIVERGED) for run in runs),
        "steps": float(np.mean([run["steps"] for run in runs])),
        "cpu_s": float(np.mean([run["cpu_s"] for run in runs])),
    }


def mean_and_error(values: FloatArray) -> tuple[float, float | None]:
    """Mean of values [n] and its standard error; None for one value."""
    error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None
    return float(values.mean()), error
