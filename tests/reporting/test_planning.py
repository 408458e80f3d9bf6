"""The report on planning from made results: claims are judged by their tests, and every figure is there."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from predplan.planning.comparing import paired_test, summary
from predplan.planning.kinds import KINDS, SuiteKind
from predplan.planning.methods import methods_of
from predplan.planning.tables import MEASURES
from predplan.reporting.document import Cell, Section
from predplan.reporting.markdown import all_figures, to_markdown
from predplan.reporting.page import to_page
from predplan.reporting.planning import claims, tables
from predplan.reporting.planning.results import SuiteResults
from predplan.reporting.planning.section import planning_section

PROBLEMS, ITERATIONS = 12, 5


def made_suite(kind: SuiteKind = "planar", cheap: str = "grbf", **changed: Any) -> SuiteResults:
    """Costs by chance, those of one method a tenth of the others'."""
    rng = np.random.default_rng(0)
    methods = [method.name for method in methods_of(kind)]
    scale = {name: 0.1 if name == cheap else 1.0 for name in methods}
    costs = {
        (name, measure, i): scale[name] * rng.uniform(0.5, 1.0, PROBLEMS) / (i + 1)
        for name in methods
        for measure in MEASURES
        for i in range(ITERATIONS + 1)
    }
    curves = [
        {"method": name, "measure": measure, "iteration": i, **summary(values)._asdict()}
        for (name, measure, i), values in costs.items()
    ]
    comparisons = [
        {"method": a, "other": b, "iteration": ITERATIONS, "measure": measure, **test._asdict()}
        for k, a in enumerate(methods)
        for b in methods[k + 1 :]
        for measure in MEASURES
        for test in [paired_test(costs[a, measure, ITERATIONS], costs[b, measure, ITERATIONS])]
    ]
    example = [
        {"method": name, "iteration": i, "s": s, "q": [s, s], "tool": [s, s**2, 0.1], "body": [0.0, 0.0, s, s]}
        for name in methods
        for i in range(ITERATIONS + 1)
        for s in np.linspace(0, 1, 101).tolist()
    ]
    field = [{"x": x, "y": y, "cost": x * y} for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)]
    outcomes = [
        {"method": name, "problem": str(n), "inverse_step": 2.0, "free": n < 6, "reason": ""}
        for name in methods
        for n in range(PROBLEMS)
    ]
    times = [
        {"method": name, "samples": samples, "repeat": repeat, "time_ms": samples / 10}
        for name in methods
        for samples in (12, 24, 32, 48)
        for repeat in range(3)
    ]
    steps = [
        {"method": name, "inverse_step": step, "free": step / 10, "chosen": step == 5.0} | dict.fromkeys(MEASURES, 0.0)
        for name in methods
        for step in (1.0, 5.0)
    ]
    results = SuiteResults(
        name=kind,
        kind=kind,
        problems=PROBLEMS,
        tuning=2,
        iterations=ITERATIONS,
        epsilon=0.1,
        steps_of=kind,
        curves=curves,
        comparisons=comparisons,
        example=example,
        field=field,
        outcomes=outcomes,
        times=times,
        steps=steps,
    )
    return replace(results, **changed)


def verdict(suite: SuiteResults, method: str, other: str) -> str:
    judged = claims.judge(claims.Claim("planar", method, other, "integral"), claims.by_claim([suite]))
    assert judged is not None
    return judged.verdict


def test_claims_are_judged_by_their_tests() -> None:
    suite = made_suite()
    assert verdict(suite, "grbf", "waypoints-velocity") == "holds"
    assert verdict(suite, "waypoints-velocity", "grbf") == "the reverse"
    assert verdict(suite, "b-spline", "waypoints-velocity") == "no difference"


def test_a_claim_of_a_suite_that_was_not_run() -> None:
    claim = claims.Claim("maze", "grbf", "waypoints-velocity", "integral")
    assert claims.judge(claim, claims.by_claim([made_suite()])) is None


def test_tests_turn_round() -> None:
    suite = made_suite()
    one, other = (suite.compared(*pair, "velocity") for pair in (("grbf", "laplacian"), ("laplacian", "grbf")))
    assert one is not None
    assert other is not None
    assert (one["t"], one["t_p"]) == (-other["t"], other["t_p"])


def test_the_best_stand_out() -> None:
    table = tables.summary_table(made_suite())
    integral = table.header.index("By arc length, m²")
    best = [row[0] for row in table.rows if isinstance(cell := row[integral], Cell) and cell.best]
    assert best == ["Gaussian σ=0.9"]


def test_chosen_steps_stand_out() -> None:
    table = tables.tuning_table(made_suite())
    assert table.header == ("Method", "λ=1", "λ=5")
    assert all(isinstance(row[2], Cell) and row[2].best for row in table.rows)


@pytest.mark.parametrize("kind", KINDS)
def test_every_suite_makes_a_section(kind: SuiteKind) -> None:
    suite = made_suite(kind)
    section = planning_section([suite])
    text = to_markdown(section, "planning")
    figures = [figure.name for figure in all_figures(section)]
    assert len(set(figures)) == len(figures)
    assert set(re.findall(r"\]\(planning/([^)]+)\.svg\)", text)) == set(figures)
    assert f"{kind}-costs" in figures
    assert "nan" not in text
    page = to_page("t", "s", [section])
    assert page.count("<svg ") == len(figures)


def test_tuned_and_untuned_stand_side_by_side() -> None:
    tuned = made_suite("kitchen-constrained")
    untuned = replace(tuned, name="kitchen-untuned", steps_of="kitchen-cluttered")
    text = to_markdown(planning_section([tuned, untuned]), "planning")
    assert "What tuning is worth" in text
    assert "steps not tuned" in text


def test_one_problem_has_no_tests() -> None:
    text = to_markdown(planning_section([made_suite(comparisons=[])]), "planning")
    assert "agree" not in text


def test_nothing_was_run() -> None:
    assert "No suite was run" in to_markdown(planning_section([]), "planning")


def test_a_benchmark_stands_first() -> None:
    section = planning_section([made_suite()], Section("Benchmark"))
    assert section.sections[0].title == "Benchmark"


def test_the_same_bytes() -> None:
    first, second = (planning_section([made_suite()]) for _ in range(2))
    assert first == second
