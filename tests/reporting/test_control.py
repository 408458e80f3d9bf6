"""The report on control from made results: claims by their tests, figures for every condition, unknown methods too."""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
import pytest

from predplan.control.comparing import compare_all, compare_runs
from predplan.reporting.control import claims, tables
from predplan.reporting.control.labels import groups, predictor_label
from predplan.reporting.control.results import ControlResults
from predplan.reporting.control.section import control_section
from predplan.reporting.control.speeds import PEER, peers_table, speeds_table
from predplan.reporting.document import Cell
from predplan.reporting.markdown import all_figures, to_markdown
from predplan.reporting.page import to_page

LEVELS = {"rpsp": 100.0, "fm2": 60.0, "fm10": 99.0, "gru": 80.0, "rpsp-frozen": 40.0, "rpsp-obs": 140.0, "new": 70.0}
CONDITIONS = (("cartpole", 0.0, 0.0), ("cartpole", 0.2, 0.0), ("hopper", 0.0, 0.0), ("hopper", 0.0, 0.3))
SPEED = {"task": "hopper", "threads": 2, "raw": 20_000.0, "sampling": 15_000.0, "training": 4000.0}


def made_results(
    seeds: int = 5, methods: tuple[str, ...] = tuple(LEVELS), conditions: Any = CONDITIONS, noise: float = 4.0
) -> ControlResults:
    """Means over training by LEVELS; the last run of `new` on the first condition diverged half-way."""
    rng, learning, runs = np.random.default_rng(0), [], []
    chance = rng.normal(size=seeds)
    for condition, method, seed in itertools.product(conditions, methods, range(seeds)):
        named = dict(zip(("task", "noise", "drop"), condition, strict=True)) | {"method": method, "seed": seed}
        level = LEVELS.get(method, 50.0) + noise * chance[seed]
        broken = method == "new" and seed == seeds - 1 and condition == CONDITIONS[0]
        for update in range(6 if broken else 11):
            learning.append(
                named
                | {"update": update, "steps": 1000 * (update + 1), "episodes": 5, "return_std": 1.0, "length_mean": 9.0}
                | {"return_mean": level * (1.0 - 0.9**update), "prediction_error": None, "policy_kl": None}
                | {"entropy": None, "value_error": None, "skipped": int(method == "rpsp"), "cpu_s": float(update)}
            )
        solved = 9000 + 100 * seed if level > 90.0 and condition[0] == "cartpole" else None
        runs.append(
            named
            | {"steps": 6000 if broken else 11_000, "mean_return": level, "final_return": 1.5 * level, "cpu_s": 10.0}
            | {"steps_to_threshold": solved, "reason": "diverged: a mean that is not finite" if broken else "finished"}
        )
    prediction = [
        {"task": "cartpole", "noise": sigma, "drop": 0.0, "seed": seed, "predictor": name, "steps": ahead, "rows": 99}
        | {"error": (1.0 + sigma) * ahead * error * rng.uniform(0.9, 1.1)}
        for sigma, (name, error), ahead, seed in itertools.product(
            (0.0, 0.2),
            (
                ("last", 0.05),
                ("order 2", 0.002),
                ("gru", 0.0005),
                ("innovation refined", 0.001),
                ("order 20", 0.0008),
                ("innovation refined at order 20", 0.0005),
            ),
            (1, 3, 5),
            range(2),
        )
    ]
    return ControlResults(learning, runs, compare_all(runs), prediction)


def cells(row: tuple[str | Cell, ...]) -> list[Cell]:
    return [cell for cell in row if isinstance(cell, Cell)]


def test_the_best_stand_out_and_are_tested() -> None:
    table = tables.mean_table(made_results())
    rows = [row for row in table.rows if len(row) > 1]
    assert table.header[1:5] == ("RPSP", "2 observations", "10 observations", "GRU")
    assert [row[0] for row in table.rows[:3]] == ["CartPole", "exact positions", "noise σ = 0.2"]
    assert all(sum(cell.best for cell in cells(row)) == 1 for row in rows[:4])
    assert rows[0][-1] == Cell("no difference", "10 observations, p = .383")
    assert "5 runs of each method" in table.caption


def test_shares_of_the_best() -> None:
    table = tables.mean_table(made_results(noise=0.0))
    [row] = [row for row in table.rows if row[0] == "exact positions, 2 tasks"]
    assert row[1:5] == ("1.00", "0.60", "0.99", "0.80")


def test_claims_are_judged_by_their_tests() -> None:
    told = dict(claims.verdicts(made_results()))
    assert told["Figure 5.8: it beats a filter that stays as first learned."] == "Holds here. 4 tests: 4 better."
    assert told["Figure 5.6: an observation beside the state helps."].startswith("Holds here")
    assert told["§5.9: a predictive state learns more than finite memories and GRUs."].startswith("Holds in 4 of 6.")
    assert "Figure 5.8: it beats a random filter." not in told


def test_the_reverse_is_said() -> None:
    levels = made_results(methods=("rpsp", "rpsp-obs"))
    names = {"rpsp": "rpsp-obs", "rpsp-obs": "rpsp"}
    runs = [{**run, "method": names[run["method"]]} for run in levels.runs]
    results = ControlResults(runs=runs, comparisons=compare_runs(runs, "rpsp", ["rpsp-obs"]))
    told = dict(claims.verdicts(results))
    assert told["Figure 5.6: an observation beside the state helps."] == "Not found here. 4 tests: 4 worse."


def test_comparisons_turn_round() -> None:
    results, condition = made_results(), CONDITIONS[0]
    one, other = results.compared(condition, "rpsp", "fm2"), results.compared(condition, "fm2", "rpsp")
    assert one is not None
    assert other is not None
    assert (one["verdict"], other["verdict"], other["difference"]) == ("better", "worse", -one["difference"])


def test_against_the_best_is_told_in_full() -> None:
    told = claims.against_the_best(made_results())
    assert "4 in all" in told
    assert "No difference in 4: CartPole, exact positions (10 observations); CartPole, noise σ = 0.2" in told
    few = claims.against_the_best(made_results(methods=("rpsp", "fm2")))
    assert "Better in 4:" in few
    assert "not held against a baseline" in claims.against_the_best(made_results(methods=("rpsp",)))


def test_conditions_together() -> None:
    table = tables.pooled_table(made_results())
    assert table is not None
    names = [row[0] for row in table.rows]
    both = ["All tasks, noise or losses", "All tasks, exact positions"]
    assert names == ["CartPole, noise or losses", "Hopper, noise or losses", *both]
    [shorter] = [cells(row)[0] for row in table.rows[:1]]
    assert shorter.value == "1.67 ▲"
    assert tables.pooled_table(made_results(1)) is None
    assert tables.pooled_table(ControlResults()) is None


def test_steps_to_the_threshold() -> None:
    table = tables.threshold_table(made_results(noise=0.0))
    assert table is not None
    own = next(row for row in table.rows if row[0] == "RPSP")
    assert own[1] == Cell("9.2k", "5 of 5")
    never = next(row for row in table.rows if row[0] == "2 observations")
    assert never[1] == Cell("not by half", "0 of 5")
    assert tables.threshold_table(made_results(methods=("fm2",))) is None


def test_diverged_runs_are_named() -> None:
    results = made_results()
    cost = next(row for row in tables.cost_table(results).rows if row[0] == "new")
    assert cost[1:4] == ("20", "1", "0")
    variants = tables.variants_table(results, ["rpsp", "new"], "x")
    assert "1 diverged" in str(variants.rows[1][1])


def test_what_is_foretold_better() -> None:
    told = claims.foretold(made_results(1, ("rpsp",)))
    assert told is not None
    assert "the predictive state, refined, foretells better than the last observation in 2 of 2, " in told
    assert "than autoregression of order 2 in 2 of 2, than every order that was tried in 2 of 2, " in told
    assert "than the GRU in 0 of 2 conditions" in told
    assert claims.foretold(ControlResults()) is None


def test_predictors_are_named() -> None:
    assert predictor_label("order 5") == "autoregression, order 5"
    assert predictor_label("innovation at order 20") == "predictive state, on the rows of order 20"
    assert predictor_label("something") == "something"


def test_groups_hold_every_method() -> None:
    named = groups(list(LEVELS))
    assert {name for _, _, methods in named for name in methods} == set(LEVELS)
    assert named[-1] == ("others", "Other methods", ["rpsp", "new"])
    assert [group[0] for group in groups(["rpsp", "fm2", "fm10", "gru"])] == ["learning"]
    assert [group[0] for group in groups(["rpsp", "fm1", "fm2", "gru-16", "gru-64"])] == [
        "learning",
        "sizes",
        "windows",
    ]


@pytest.mark.parametrize("seeds", [1, 5])
def test_the_whole_section(seeds: int) -> None:
    section = control_section(made_results(seeds), [speeds_table([SPEED])])
    text = to_markdown(section, "control")
    figures = [figure.name for figure in all_figures(section)]
    assert len(set(figures)) == len(figures)
    assert set(re.findall(r"\]\(control/([^)]+)\.svg\)", text)) == set(figures)
    assert {"learning", "learning-cartpole", "learning-hopper", "noise", "dropped", "prediction", "others"} <= set(
        figures
    )
    assert "| Hopper | 2 | 20,000 | 15,000 | 75% | 4,000 |" in text
    assert "nan" not in text
    assert "None" not in text
    assert to_page("t", "s", [section]).count("<svg ") == len(figures)
    svg = next(figure.svg for figure in all_figures(section) if figure.name == "others")
    assert "new" in svg
    assert ("too few runs to tell" in text) == (seeds == 1)


def test_figures_show_where_their_own_methods_ran() -> None:
    whole = made_results(methods=("rpsp", "fm2", "rpsp-obs"))
    learning, runs = (
        [row for row in rows if row["method"] != "rpsp-obs" or (row["task"], row["noise"]) == ("cartpole", 0.0)]
        for rows in (whole.learning, whole.runs)
    )
    names = {figure.name for figure in all_figures(control_section(ControlResults(learning, runs, compare_all(runs))))}
    assert {"learning-cartpole", "forms"} <= names
    assert not {"forms-cartpole", "forms-hopper"} & names


@pytest.mark.parametrize("methods", [("rpsp",), ("fm2",), ("new", "other")])
def test_few_methods(methods: tuple[str, ...]) -> None:
    text = to_markdown(control_section(made_results(2, methods, CONDITIONS[:1])), "control")
    assert "nan" not in text
    assert "None" not in text


@pytest.mark.parametrize("seeds", [1, 3])
def test_a_peer_s_runs_are_means_over_seeds(seeds: int) -> None:
    rows = [
        {
            "task": "hopper",
            "learner": name,
            "seed": i,
            "steps": 1000,
            "mean_return": mean + i,
            "final_return": 9.0,
            "cpu_s": cpu,
        }
        for name, mean, cpu in ((PEER, 100.0, 10.0), ("rpsp", 200.0, 0.5))
        for i in range(seeds)
    ]
    first, second = peers_table(rows).rows
    assert first[:3] == ("Hopper", PEER, f"{seeds}")
    assert second[:2] == ("Hopper", "RPSP")
    assert (first[-1], second[-1]) == ("100", "2,000")
    assert first[3] == ("100" if seeds == 1 else "101 (± 0.58)")


def test_nothing_was_run() -> None:
    assert "No task was run" in to_markdown(control_section(ControlResults()), "control")


def test_the_same_bytes() -> None:
    first, second = (control_section(made_results(2, ("rpsp", "fm2"), CONDITIONS[:1])) for _ in range(2))
    assert first == second
