"""Paths in Bernstein form: against their own definition, finite differences and SciPy's Bernstein polynomials."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from predplan.planning.paths import Path, acceleration_cost, length, polyline, quintic, velocity_cost

SEEDS = st.integers(0, 2**32 - 1)


def drawn(seed: int, pieces: int = 5, joints: int = 3) -> tuple[Path, list[np.ndarray]]:
    """A quintic path with knots at unequal times, and what it was made of."""
    generator = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(generator.uniform(0.1, 1, pieces))])
    breaks /= breaks[-1]
    given_values = [generator.standard_normal((pieces + 1, joints)) for _ in range(3)]
    return quintic(breaks, *given_values), given_values


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_a_quintic_meets_values_and_derivatives_at_knots_from_both_sides(seed: int) -> None:
    path, values = drawn(seed)
    for order, expected in enumerate(values):
        np.testing.assert_allclose(path(path.breaks, order), expected, atol=1e-9)
        before = path(path.breaks[1:] - 1e-12, order)
        np.testing.assert_allclose(before, expected[1:], atol=1e-5)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(0, 6))
def test_derivatives_agree_with_scipy(seed: int, order: int) -> None:
    path, _ = drawn(seed)
    s = np.random.default_rng(seed).uniform(0, 1, 50)
    theirs = BPoly(np.swapaxes(path.coefficients, 0, 1), path.breaks)
    expected = theirs.derivative(order)(s) if order else theirs(s)
    np.testing.assert_allclose(path(s, order), expected, rtol=1e-9, atol=1e-7 * 10.0**order)


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_a_path_stays_within_its_coefficients(seed: int) -> None:
    path, _ = drawn(seed)
    for left, right, points in zip(path.breaks[:-1], path.breaks[1:], path.coefficients, strict=True):
        q = path(np.linspace(left, right, 50)[:-1])
        assert np.all(q >= points.min(axis=0) - 1e-12)
        assert np.all(q <= points.max(axis=0) + 1e-12)


@pytest.mark.parametrize("parts", [1, 2, 7])
def test_a_cut_path_is_the_same_path(parts: int) -> None:
    path, _ = drawn(3)
    cut, s = path.cut(parts), np.linspace(0, 1, 101)
    assert cut.coefficients.shape == (5 * parts, 6, 3)
    for order in range(3):
        np.testing.assert_allclose(cut(s, order), path(s, order), atol=1e-9 * 10.0 ** (2 * order))


def test_a_polyline_visits_its_points_at_equal_speed() -> None:
    points = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 5.0]])
    path = polyline(points)
    assert path.degree == 1
    np.testing.assert_allclose(path.breaks, [0.0, 5.0 / 6.0, 1.0])
    np.testing.assert_allclose(path(path.breaks), points[[0, 1, 3]])
    np.testing.assert_allclose(np.linalg.norm(path(np.linspace(0, 1, 20), 1), axis=1), 6.0)
    np.testing.assert_array_equal(path(np.linspace(0, 1, 5), 2), 0.0)
    assert length(path, 6001) == pytest.approx(6.0, rel=1e-3)


def test_a_polyline_of_one_place_stands_still() -> None:
    path = polyline(np.array([[1.0, 2.0], [1.0, 2.0]]))
    np.testing.assert_array_equal(path(np.linspace(0, 1, 3)), [[1.0, 2.0]] * 3)
    assert (length(path), velocity_cost(path), acceleration_cost(path)) == (0.0, 0.0, 0.0)


def test_costs_are_those_of_their_formulas() -> None:
    line = polyline(np.array([[0.0, 0.0], [3.0, 4.0]]))
    assert length(line) == pytest.approx(5.0)
    assert velocity_cost(line) == pytest.approx(12.5)
    assert acceleration_cost(line) == pytest.approx(0.0, abs=1e-15)
    # q = 3 s²: ½ ∫ (6 s)² = 6 and ½ 6² = 18
    values = [np.array([[0.0], [3.0]]), np.array([[0.0], [6.0]]), np.array([[6.0], [6.0]])]
    parabola = quintic(np.array([0.0, 1.0]), *values)
    assert length(parabola) == pytest.approx(3.0)
    assert velocity_cost(parabola) == pytest.approx(6.0, rel=1e-3)
    assert acceleration_cost(parabola) == pytest.approx(18.0)
