"""Paired tests against SciPy's own, and what happens where nothing differs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from predplan.planning.comparing import paired_test, summary

values = st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=3, max_size=30)


@pytest.mark.parametrize("seed", range(5))
def test_against_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal(30), rng.standard_normal(30) + 0.3
    found = paired_test(a, b)
    student = stats.ttest_rel(a, b)
    assert found.t == pytest.approx(student.statistic)
    assert found.t_p == pytest.approx(student.pvalue)
    wilcoxon = stats.wilcoxon(a, b, method="approx")
    assert found.w == pytest.approx(wilcoxon.statistic)
    assert found.w_p == pytest.approx(wilcoxon.pvalue)
    assert found.effect == pytest.approx(np.mean(a - b) / np.std(a - b, ddof=1))
    assert np.sign(found.w_z) == np.sign(found.t)
    assert found.n == 30


@given(values)
def test_the_other_way_round(pairs: list[tuple[float, float]]) -> None:
    a, b = (np.round(np.array(side), 3) for side in zip(*pairs, strict=True))
    one, other = paired_test(a, b), paired_test(b, a)
    assert one.difference == -other.difference
    assert one.t_p == pytest.approx(other.t_p)
    assert one.w_p == pytest.approx(other.w_p)
    assert one.t == pytest.approx(-other.t)
    assert one.w_z == pytest.approx(-other.w_z, abs=1e-9)


def test_nothing_differs() -> None:
    found = paired_test(np.ones(5), np.ones(5))
    assert (found.t, found.t_p, found.w_p, found.effect) == (0.0, 1.0, 1.0, 0.0)


def test_all_differ_by_the_same() -> None:
    found = paired_test(np.zeros(5), np.ones(5))
    assert (found.t, found.t_p) == (-np.inf, 0.0)
    assert found.w_p < 0.1


@pytest.mark.parametrize(("a", "b"), [(1, 1), (2, 3), (0, 0)])
def test_too_few(a: int, b: int) -> None:
    with pytest.raises(ValueError, match="two at least"):
        paired_test(np.zeros(a), np.zeros(b))


def test_summary() -> None:
    assert tuple(summary(np.array([1.0, 2.0, 3.0]))) == pytest.approx((2.0, 1 / np.sqrt(3), 3))
    assert summary(np.array([4.0])) == (4.0, 0.0, 1)
