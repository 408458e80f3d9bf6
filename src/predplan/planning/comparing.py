"""Which method is better on the same problems: curves over iterations, paired t-tests and Wilcoxon's signed ranks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from predplan.planning.robots import FloatArray


class PairedTest(NamedTuple):
    """A method's costs less those of another, problem by problem."""

    n: int
    difference: float  # mean
    effect: float  # Cohen's d of paired samples: the mean over the standard deviation of differences
    t: float  # Student's, of n - 1 degrees of freedom
    t_p: float  # two-sided
    w: float  # Wilcoxon's signed-rank statistic: the smaller of both rank sums
    w_z: float  # its normal score, below zero where the method costs less
    w_p: float  # two-sided


def paired_test(method: FloatArray, other: FloatArray) -> PairedTest:
    """Both tests on costs [n] of the same problems, n >= 2.

    Where all problems differ by the same, Student's t has no variance: t is 0 and p 1 without a difference, infinite
    and 0 with one. Problems without a difference take no part in Wilcoxon's test. Raises ValueError for n < 2.
    """
    if len(method) != len(other) or len(method) < 2:
        raise ValueError(f"found {len(method)} and {len(other)} costs; expected as many of each, two at least")
    differences = method - other
    mean, n = float(differences.mean()), len(differences)
    spread = float(differences.std(ddof=1))
    if spread > 1e-12 * max(1.0, abs(mean)):
        effect = mean / spread
        t = effect * float(np.sqrt(n))
        t_p = float(2.0 * stats.t.sf(abs(t), n - 1))
    else:
        effect = t = 0.0 if mean == 0.0 else float(np.copysign(np.inf, mean))
        t_p = 1.0 if mean == 0.0 else 0.0
    w, z, w_p = _wilcoxon(differences)
    return PairedTest(n, mean, effect, t, t_p, w, z, w_p)


def _wilcoxon(differences: FloatArray) -> tuple[float, float, float]:
    """Statistic, normal score and p; nothing differs: 0, 0 and 1."""
    kept = differences[differences != 0.0]
    if len(kept) == 0:
        return 0.0, 0.0, 1.0
    found = stats.wilcoxon(kept, method="approx")
    above = float(stats.rankdata(np.abs(kept))[kept > 0.0].sum())
    middle = len(kept) * (len(kept) + 1) / 4
    return float(found.statistic), float(np.copysign(abs(found.zstatistic), above - middle)), float(found.pvalue)


class Summary(NamedTuple):
    """Mean over problems and its standard error."""

    mean: float
    standard_error: float
    n: int


def summary(values: FloatArray) -> Summary:
    """Mean and standard error of values [n]; the error of one value is 0."""
    n = len(values)
    error = float(values.std(ddof=1) / np.sqrt(n)) if n > 1 else 0.0
    return Summary(float(values.mean()), error, n)
