"""What chapter 4 claims, and whether it holds here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from predplan.reporting.document import Table
from predplan.reporting.planning.results import SuiteResults

LEVEL = 0.05
"""Differences with a p-value above it are not counted as differences."""


@dataclass(frozen=True)
class Claim:
    """That one method costs less than another on a suite."""

    suite: str  # kind of the suite, or "untuned"
    method: str
    other: str
    measure: str
    test: str = "t"  # or "w": Wilcoxon's
    iteration: int | None = None  # None: the last


def _all(
    suite: str,
    methods: Sequence[str],
    others: Sequence[str],
    measures: Sequence[str],
    test: str = "t",
    iteration: int | None = None,
) -> list[Claim]:
    """A claim for every measure, method and other."""
    return [Claim(suite, m, o, measure, test, iteration) for measure in measures for m in methods for o in others]


OBSTACLE, SMOOTH = ("maximum", "integral"), ("velocity", "acceleration")
WAYPOINTS, CHOMP = ("waypoints-velocity", "waypoints-acceleration"), ("chomp-velocity", "chomp-acceleration")
LARGE = ("waypoints-velocity-large", "waypoints-acceleration-large")
GROUPS: tuple[tuple[str, list[Claim]], ...] = (
    (
        "§4.7.1, planar arm: the Gaussian has lower obstacle cost than waypoints (thesis: t(99) = -2.63)",
        _all("planar", ("grbf", "grbf-narrow"), WAYPOINTS, OBSTACLE),
    ),
    (
        "§4.7.1, planar arm: the Gaussian is smoother than waypoints (thesis: t(99) = -3.53)",
        _all("planar", ("grbf", "grbf-narrow"), WAYPOINTS, SMOOTH),
    ),
    (
        "§4.7.2, maze, large steps, 5 iterations: the Gaussian has lower obstacle cost (thesis: |t(99)| = 5.32)",
        _all("maze", ("grbf-narrow-large",), LARGE, OBSTACLE, iteration=5),
    ),
    (
        "§4.7.2, maze, large steps, 5 iterations: the Gaussian is smoother (thesis: |t(99)| = 8.86)",
        _all("maze", ("grbf-narrow-large",), LARGE, SMOOTH, iteration=5),
    ),
    (
        "§4.7.5, clutter: Gaussian and Gaussian with derivative have lower obstacle cost (thesis: -3.7, -4.04)",
        _all("kitchen-cluttered", ("grbf", "grbf-der"), CHOMP, OBSTACLE, test="w"),
    ),
    (
        "§4.7.5, clutter: coupled joints are smoother (thesis: Wilcoxon -4.4)",
        _all("kitchen-cluttered", ("grbf-jj",), CHOMP, SMOOTH, test="w"),
    ),
    (
        "§4.7.6, microwave: all three kernels are smoother (thesis: -3.04, 3.12, -3.8)",
        _all("kitchen-constrained", ("grbf", "grbf-jj", "grbf-der"), CHOMP, SMOOTH, test="w"),
    ),
    (
        "§4.7.8, microwave, steps not tuned: coupled joints are smoother (thesis: not significantly)",
        _all("untuned", ("grbf-jj",), CHOMP, SMOOTH, test="w"),
    ),
)


@dataclass(frozen=True)
class Judged:
    """A claim held against the tests."""

    claim: Claim
    statistic: float
    p: float
    n: int

    @property
    def verdict(self) -> str:
        """Whether the method costs less, more, or neither."""
        if self.p >= LEVEL or np.isnan(self.p):
            return "no difference"
        return "holds" if self.statistic < 0 else "the reverse"


def judge(claim: Claim, suites: Mapping[str, SuiteResults]) -> Judged | None:
    """The claim's test; None where the suite was not run."""
    suite = suites.get(claim.suite)
    row = suite.compared(claim.method, claim.other, claim.measure, claim.iteration) if suite else None
    if row is None:
        return None
    statistic, p = (row["w_z"], row["w_p"]) if claim.test == "w" else (row["t"], row["t_p"])
    return Judged(claim, statistic, p, row["n"])


def by_claim(suites: Sequence[SuiteResults]) -> dict[str, SuiteResults]:
    """Suites by what claims call them."""
    return {"untuned" if suite.borrowed else suite.kind: suite for suite in reversed(suites)}


def claims_table(suites: Sequence[SuiteResults]) -> Table:
    """Every claim with its tests: a row for each pair of methods and each measure."""
    known = by_claim(suites)
    rows: list[tuple[str, ...]] = []
    for text, claims in GROUPS:
        judged = [each for claim in claims if (each := judge(claim, known)) is not None]
        if not judged:
            continue
        rows.append((text,))
        for each in judged:
            claim, labels = each.claim, known[each.claim.suite].methods
            rows.append(
                (
                    f"{labels[claim.method].label} / {labels[claim.other].label}",
                    claim.measure,
                    f"{'z' if claim.test == 'w' else 't'} = {each.statistic:+.2f}",
                    "< .001" if each.p < 0.001 else f"{each.p:.3f}".removeprefix("0"),
                    str(each.n),
                    each.verdict,
                )
            )
    return Table(
        ("Method / other", "Cost", "Statistic", "p", "n", "Verdict"),
        tuple(rows),
        "The thesis’s comparisons, made again: paired t-tests, in the kitchen Wilcoxon’s signed ranks (score z). "
        "Below zero the method costs less. “holds”: it costs less with p < .05; “the reverse”: it costs more with "
        "p < .05. p-values are two-sided and not corrected for the number of tests.",
    )


def verdicts(suites: Sequence[SuiteResults]) -> tuple[tuple[str, str], ...]:
    """For each claim how many of its tests say what."""
    known, found = by_claim(suites), []
    for text, claims in GROUPS:
        judged = [each.verdict for claim in claims if (each := judge(claim, known)) is not None]
        if judged:
            counts = [f"{judged.count(verdict)} {words}" for verdict, words in WORDS if verdict in judged]
            told = f"Of {len(judged)} tests: {', '.join(counts)}.{_at_what_cost(claims, known)}"
            found.append((f"{text}.", told))
    return tuple(found)


def _at_what_cost(claims: Sequence[Claim], suites: Mapping[str, SuiteResults]) -> str:
    """In how many tests of smoothness that agree the smoother method is left with more obstacle cost, if in any."""
    agree = [c for c in claims if c.measure in SMOOTH and _verdict(c, suites) == "holds"]
    dearer = [c for c in agree if _verdict(replace(c, measure="integral"), suites) == "the reverse"]
    if not dearer:
        return ""
    shares = f"{len(dearer)} of {len(agree)}"
    return f" Where they agree, the smoother one is left with more obstacle cost (by arc length) in {shares}."


def _verdict(claim: Claim, suites: Mapping[str, SuiteResults]) -> str:
    judged = judge(claim, suites)
    return "" if judged is None else judged.verdict


WORDS = (("holds", "agree"), ("no difference", "find no difference"), ("the reverse", "find the reverse"))
