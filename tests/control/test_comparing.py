"""Tests over seeds: against SciPy, by hand, and by their laws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_rows, write_rows, write_table
from predplan.control.comparing import (
    compare_all,
    compare_runs,
    final_mean,
    holm,
    is_baseline,
    mean_over_training,
    permutation_p,
    pooled_ratio,
    summarise,
    welch,
)
from predplan.control.tables import COMPARISONS, RUNS, SUMMARY


def made_run(method: str, seed: int, mean: float, **changed: Any) -> dict[str, Any]:
    run = {"task": "cartpole", "noise": 0.2, "drop": 0.0, "method": method, "seed": seed, "steps": 1000}
    run |= {"mean_return": mean, "final_return": 2 * mean, "steps_to_threshold": None, "reason": "finished"}
    return run | {"cpu_s": 1.0} | changed


def made_runs(seeds: int = 5) -> list[dict[str, Any]]:
    """A method, one that is far worse and one that is as good."""
    rng = np.random.default_rng(0)
    level = {"rpsp": 100.0, "fm2": 50.0, "gru": 100.0}
    return [made_run(method, seed, level[method] + rng.normal()) for method in level for seed in range(seeds)]


def test_welch_is_scipys() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(0.0, 1.0, 5), rng.normal(1.0, 4.0, 8)
    found, expected = welch(a, b), stats.ttest_ind(a, b, equal_var=False)
    np.testing.assert_allclose((found.t, found.p), (expected.statistic, expected.pvalue))


def test_welch_where_nothing_varies() -> None:
    assert welch(np.ones(3), np.ones(3)).p == 1.0
    assert welch(np.ones(3), np.zeros(3)).p == 0.0


def test_welch_needs_two() -> None:
    with pytest.raises(ValueError, match="found 1 and 3"):
        welch(np.ones(1), np.ones(3))


def test_permutation_is_scipys() -> None:
    differences = np.random.default_rng(2).normal(0.5, 1.0, 7)
    expected = stats.permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=np.inf)
    np.testing.assert_allclose(permutation_p(differences), expected.pvalue)


def test_permutation_of_many_pairs_is_near_the_t_test() -> None:
    differences = np.random.default_rng(3).normal(0.3, 1.0, 40)
    assert permutation_p(differences) == pytest.approx(stats.ttest_1samp(differences, 0.0).pvalue, abs=0.01)


def test_five_seeds_cannot_get_below_a_sixteenth() -> None:
    assert permutation_p(np.arange(1.0, 6.0)) == 2 / 32
    assert permutation_p(np.zeros(5)) == 1.0


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, None]) == [pytest.approx(0.03), pytest.approx(0.06), pytest.approx(0.06), None]
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
def test_holm_keeps_the_order_and_starts_at_bonferroni(p: list[float]) -> None:
    raw, corrected = np.array(p), np.array(holm(p), np.float64)
    assert np.all((raw <= corrected) & (corrected <= 1.0))
    assert np.all(np.diff(corrected[np.argsort(raw, kind="stable")]) >= 0.0)
    assert corrected.min() == pytest.approx(min(1.0, len(p) * raw.min()))


def test_verdicts() -> None:
    rows = compare_runs(made_runs(), "rpsp", ["fm2", "gru", "absent"])
    assert [(row["other"], row["verdict"]) for row in rows] == [("fm2", "better"), ("gru", "no difference")]
    assert all(row["holm_p"] >= row["welch_p"] for row in rows)
    assert rows[0]["permutation_p"] == 2 / 32
    [back] = compare_runs(made_runs(), "fm2", ["rpsp"])
    assert back["verdict"] == "worse"
    assert back["difference"] == pytest.approx(-rows[0]["difference"])


def test_conditions_are_apart() -> None:
    runs = made_runs() + [run | {"noise": 0.0} for run in made_runs() if run["method"] != "fm2"]
    rows = compare_runs(runs, "rpsp", ["fm2", "gru"], measure="final_return")
    assert [(row["noise"], row["other"]) for row in rows] == [(0.2, "fm2"), (0.2, "gru"), (0.0, "gru")]
    assert rows[0]["measure"] == "final_return"


def test_baselines() -> None:
    names = ["fm2", "fm10", "gru", "gru-64", "rpsp", "fm2-trpo", "gru-predictive"]
    assert [name for name in names if is_baseline(name)] == ["fm2", "fm10", "gru", "gru-64"]


def test_all_comparisons_that_are_told() -> None:
    runs = [
        made_run(name, seed, 10.0 * seed) for name in ("rpsp", "fm2", "gru", "rpsp-vrpg", "rpsp-alt") for seed in (0, 1)
    ]
    pairs = [(row["method"], row["other"]) for row in compare_all(runs)]
    own = [("rpsp", other) for other in ("fm2", "gru", "rpsp-vrpg", "rpsp-alt")]
    assert pairs == [*own, ("rpsp-vrpg", "rpsp-alt")]


def test_one_seed_is_too_few() -> None:
    [row] = compare_runs([made_run("rpsp", 0, 2.0), made_run("fm2", 0, 1.0)], "rpsp", ["fm2"])
    assert (row["verdict"], row["welch_p"], row["difference"]) == ("too few seeds", None, 1.0)


def test_only_shared_seeds_are_paired() -> None:
    runs = [made_run("rpsp", seed, float(seed)) for seed in range(4)]
    runs += [made_run("fm2", seed, 0.0) for seed in range(2, 5)]
    [row] = compare_runs(runs, "rpsp", ["fm2"])
    assert (row["seeds"], row["other_seeds"], row["pairs"]) == (4, 3, 2)


def test_summary_by_hand() -> None:
    runs = [
        made_run("rpsp", 0, 1.0, steps_to_threshold=10),
        made_run("rpsp", 1, 3.0, steps_to_threshold=30),
        made_run("rpsp", 2, 5.0, reason="diverged: a mean that is not finite"),
    ]
    [row] = summarise(runs)
    assert (row["mean_return"], row["standard_error"]) == (3.0, pytest.approx(2.0 / np.sqrt(3.0)))
    assert (row["reached"], row["steps_to_threshold"], row["diverged"]) == (2, 30.0, 1)
    assert summarise(runs[1:])[0]["steps_to_threshold"] is None


def test_mean_over_training_by_hand() -> None:
    steps, returns = np.array([10.0, 20.0, 40.0]), np.array([1.0, np.nan, 4.0])
    assert mean_over_training(steps, returns, 40) == pytest.approx((10 + 10 + 80) / 40)
    assert mean_over_training(steps, returns, 80) == pytest.approx((100 + 40) / 80)


def test_a_diverged_run_is_not_spared() -> None:
    steps, returns = np.array([10.0, 20.0]), np.array([1.0, 9.0])
    assert mean_over_training(steps, returns, 100) < mean_over_training(steps, returns, 20)


def test_final_mean_by_hand() -> None:
    steps, returns = np.array([50.0, 95.0, 100.0]), np.array([1.0, 2.0, 6.0])
    assert final_mean(steps, returns) == pytest.approx(4.0)
    assert final_mean(steps, np.array([1.0, 2.0, np.nan])) == 2.0
    assert final_mean(steps, np.array([1.0, np.nan, np.nan])) == 1.0


def test_tables_take_the_rows(tmp_path: Path) -> None:
    runs = made_runs()
    for schema, rows in ((RUNS, runs), (COMPARISONS, compare_runs(runs, "rpsp", ["fm2"])), (SUMMARY, summarise(runs))):
        write_rows(tmp_path / "a.parquet", schema, rows, Provenance())
        assert read_rows(tmp_path / "a.parquet", schema) == rows
    with pytest.raises(ValueError, match="cpu_s"):
        write_table(tmp_path / "b.parquet", RUNS, {}, Provenance())


def test_a_ratio_over_one_condition_is_welch_s_test_of_logarithms() -> None:
    rng = np.random.default_rng(0)
    method, other = np.exp(rng.normal(1.0, 0.2, 6)), np.exp(rng.normal(0.8, 0.4, 5))
    expected = stats.ttest_ind(np.log(method), np.log(other), equal_var=False)
    found, interval = pooled_ratio([(method, other)]), expected.confidence_interval(0.95)
    assert found.ratio == pytest.approx(np.exp(np.log(method).mean() - np.log(other).mean()))
    assert found.p == pytest.approx(expected.pvalue)
    assert (found.low, found.high) == pytest.approx((np.exp(interval.low), np.exp(interval.high)))


def test_ratios_over_conditions_hold_what_they_say() -> None:
    """The interval holds the true ratio in 95 of 100 draws, whatever the conditions' own levels and units."""
    rng, levels = np.random.default_rng(1), np.array([1.0, 30.0, 400.0, 7.0])

    def draw() -> list[tuple[Any, Any]]:
        return [
            (1.2 * level * np.exp(rng.normal(0, 0.3, 5)), level * np.exp(rng.normal(0, 0.1, 5))) for level in levels
        ]

    drawn = [draw() for _ in range(1000)]
    found = [pooled_ratio(one) for one in drawn]
    assert np.mean([one.low <= 1.2 <= one.high for one in found]) == pytest.approx(0.95, abs=0.02)
    turned = pooled_ratio([(b, a) for a, b in drawn[0]])
    assert (turned.ratio, turned.low, turned.p) == pytest.approx((1 / found[0].ratio, 1 / found[0].high, found[0].p))
    scaled = pooled_ratio([(9.0 * a, 9.0 * b) for a, b in drawn[0]])
    assert scaled == pytest.approx(found[0])


@pytest.mark.parametrize("own", [[1.0], [1.0, 0.0], [1.0, -2.0], [1.0, float("nan")]])
def test_a_ratio_needs_runs_above_zero(own: list[float]) -> None:
    with pytest.raises(ValueError, match="two runs"):
        pooled_ratio([(np.array(own), np.ones(3))])


def test_runs_that_do_not_vary() -> None:
    assert pooled_ratio([(np.full(3, 2.0), np.ones(3))]) == (2.0, 2.0, 2.0, 0.0)
    assert pooled_ratio([(np.ones(3), np.ones(3))]).p == 1.0
