"""The mixture of each word: its optimality, its limits, and SciPy's answer to the same problem."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from predplan.errors import InputError, PredplanError
from predplan.labelling.active_set import Floats, Integers
from predplan.labelling.mixtures import fit_mixtures

SEEDS = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Problem:
    """The arguments of fit_mixtures, and the dense counts [V, C] they came from."""

    indptr: Integers
    indices: Integers
    data: Floats
    R: Floats
    alpha: Floats
    weight: Floats
    dense: Floats

    def arguments(self) -> tuple[Integers, Integers, Floats, Floats, Floats, Floats]:
        return self.indptr, self.indices, self.data, self.R, self.alpha, self.weight


def problem(counts: Floats, R: Floats, alpha: Floats | float = 0.0, weight: Floats | float = 1.0) -> Problem:
    rows, indices = np.nonzero(counts)
    words = len(counts)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=words))])
    prior = np.broadcast_to(np.asarray(alpha, float), (words, len(R)))
    factor = np.broadcast_to(np.asarray(weight, float), (words,))
    return Problem(indptr, indices, counts[rows, indices], R, prior, factor, counts)


def random_problem(seed: int, states: int = 4, words: int = 6, contexts: int = 15) -> Problem:
    rng = np.random.default_rng(seed)
    R = 0.95 * rng.dirichlet(np.full(contexts, 0.2), size=states) + 0.05 / contexts
    counts = rng.poisson(rng.choice([0.1, 1.0, 20.0], size=(words, 1)), size=(words, contexts)).astype(float)
    alpha = rng.choice([0.0, 1e-6, 0.1, 3.0], size=(words, states))
    return problem(counts, R, alpha, rng.choice([0.25, 1.0], size=words))


def objective(p: Problem, gamma: Floats) -> Floats:
    """[V]; -inf where a label with pseudo-counts has probability zero."""
    with np.errstate(divide="ignore"):
        logs = np.where(p.alpha > 0.0, np.log(gamma), 0.0)
    values: Floats = p.weight * (p.dense * np.log(gamma @ p.R)).sum(axis=1) + (p.alpha * logs).sum(axis=1)
    return values


def gaps(p: Problem, gamma: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        prior = np.where(p.alpha > 0.0, p.alpha / gamma, 0.0)
        gradient = p.weight[:, None] * (p.dense / (gamma @ p.R)) @ p.R.T + prior
        total = p.weight * p.dense.sum(axis=1) + p.alpha.sum(axis=1)
        return np.where(total > 0.0, gradient.max(axis=1) / total - 1.0, 0.0)


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS, states=st.integers(1, 8), words=st.integers(0, 6))
def test_on_the_simplex_and_optimal(seed: int, states: int, words: int) -> None:
    p = random_problem(seed, states, words)
    solution = fit_mixtures(*p.arguments())
    assert (solution.gamma >= 0.0).all()
    np.testing.assert_allclose(solution.gamma.sum(axis=1), 1.0, rtol=1e-12)
    assert (gaps(p, solution.gamma) <= 1.01e-6).all()
    np.testing.assert_allclose(solution.residual, np.maximum(gaps(p, solution.gamma), 0.0), atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS)
def test_every_further_step_raises_the_objective(seed: int) -> None:
    p = random_problem(seed)
    values = []
    for tolerance in (1e9, 1.0, 0.3, 0.1, 1e-2, 1e-4, 1e-7, 1e-10):
        values.append(objective(p, fit_mixtures(*p.arguments(), tolerance=tolerance).gamma))
    assert (np.diff(values, axis=0) >= -1e-11 * (1.0 + np.abs(values[0]))).all()


@pytest.mark.parametrize("seed", range(5))
def test_equals_scipy(seed: int) -> None:
    p = random_problem(seed)
    gamma = fit_mixtures(*p.arguments(), tolerance=1e-9).gamma
    total = p.weight * p.dense.sum(axis=1) + p.alpha.sum(axis=1)
    for w in np.flatnonzero(total > 0.0).tolist():

        def loss(x: Floats, w: int = w) -> float:
            return -float(objective(p, np.maximum(x, 1e-12)[None, :])[w] / total[w])

        reference = minimize(
            loss,
            np.full(4, 0.25),
            method="SLSQP",
            bounds=[(0.0, 1.0)] * 4,
            constraints={"type": "eq", "fun": lambda x: x.sum() - 1.0},
            options={"ftol": 1e-12, "maxiter": 500},
        )
        assert loss(gamma[w]) <= reference.fun + 1e-9
        assert loss(gamma[w]) >= reference.fun - 1e-3
        np.testing.assert_allclose(gamma[w], reference.x, atol=5e-3)


def test_error_falls_as_the_square_root_of_the_counts() -> None:
    rng = np.random.default_rng(0)
    R = 0.95 * rng.dirichlet(np.full(40, 0.2), size=5) + 0.05 / 40
    truth = rng.dirichlet(np.ones(5), size=200)
    sizes = np.array([100, 1_000, 10_000, 100_000])
    errors = []
    for size in sizes:
        counts = rng.multinomial(size, truth @ R).astype(float)
        errors.append(np.abs(fit_mixtures(*problem(counts, R).arguments()).gamma - truth).mean())
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert -0.6 < slope < -0.4


def test_expected_counts_give_the_mixture_back() -> None:
    rng = np.random.default_rng(1)
    R = 0.95 * rng.dirichlet(np.full(40, 0.2), size=5) + 0.05 / 40
    truth = np.vstack([rng.dirichlet(np.full(5, 0.3), size=20), np.eye(5)])
    gamma = fit_mixtures(*problem(1000.0 * truth @ R, R).arguments(), tolerance=1e-12).gamma
    np.testing.assert_allclose(gamma, truth, atol=1e-5)


def test_the_prior_decides_where_there_are_no_counts() -> None:
    alpha = np.array([[1.0, 3.0, 0.0], [0.0, 0.0, 0.0], [1e9, 3e9, 0.0]])
    R = np.array([[0.8, 0.2], [0.5, 0.5], [0.1, 0.9]])
    counts = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 5.0]])
    gamma = fit_mixtures(*problem(counts, R, alpha).arguments()).gamma
    np.testing.assert_allclose(gamma, [[0.25, 0.75, 0], [1 / 3, 1 / 3, 1 / 3], [0.25, 0.75, 0]], atol=1e-5)
    ignored = fit_mixtures(*problem(np.ones((3, 2)), R, alpha, weight=0.0).arguments()).gamma
    np.testing.assert_allclose(ignored[:2], gamma[:2], atol=1e-15)


def test_weight_multiplies_the_counts() -> None:
    p = random_problem(7)
    scaled = problem(p.dense * p.weight[:, None], p.R, p.alpha)
    gamma = fit_mixtures(*p.arguments(), tolerance=1e-9).gamma
    np.testing.assert_allclose(fit_mixtures(*scaled.arguments(), tolerance=1e-9).gamma, gamma, atol=1e-7)


def test_threads_do_not_change_a_byte() -> None:
    p = random_problem(11, states=12, words=300)
    one, three = (fit_mixtures(*p.arguments(), threads=threads) for threads in (1, 3))
    assert one.gamma.tobytes() == three.gamma.tobytes()
    assert one.residual.tobytes() == three.residual.tobytes()


def test_zeros_of_R_that_no_count_meets_are_harmless() -> None:
    R = np.array([[0.5, 0.5, 0.0], [0.1, 0.9, 0.0]])
    gamma = fit_mixtures(*problem(np.array([[5.0, 1.0, 0.0]]), R).arguments()).gamma
    np.testing.assert_allclose(gamma, [[1.0, 0.0]], atol=1e-6)
    with pytest.raises(InputError, match="R, row 0: found 0 at context 2"):
        fit_mixtures(*problem(np.array([[5.0, 1.0, 1.0]]), R).arguments())


def test_nearly_zero_rows_of_R() -> None:
    R = np.array([[1.0 - 1e-200, 1e-200], [0.5, 0.5]])
    solution = fit_mixtures(*problem(np.array([[1e6, 1.0], [0.0, 3.0]]), R).arguments())
    assert np.isfinite(solution.gamma).all()
    assert solution.residual.max() <= 1e-6


def test_too_few_steps_is_an_error() -> None:
    with pytest.raises(PredplanError, match=r"mixture of word \d: residual .* after 1 steps"):
        fit_mixtures(*random_problem(0).arguments(), iteration_limit=1)


def test_bad_input_is_named() -> None:
    good: dict[str, Any] = {
        "indptr": np.array([0, 1]),
        "indices": np.array([1]),
        "data": np.array([2.0]),
        "R": np.full((2, 3), 1 / 3),
        "alpha": np.zeros((1, 2)),
        "weight": np.ones(1),
    }
    fit_mixtures(**good)
    for name, value, message in (
        ("indptr", np.array([0, 2]), "indptr"),
        ("indptr", np.array([1, 1]), "indptr"),
        ("indices", np.array([3]), "contexts: found 3 to 3, expected 0 to 2"),
        ("data", np.array([np.nan]), "counts: found a value negative or not finite"),
        ("data", np.array([-1.0]), "counts: found a value negative or not finite"),
        ("data", np.array([1.0, 1.0]), "counts: found 2 values for 1 contexts"),
        ("R", np.full((2, 3), np.nan), "R, row 0: found a value negative or not finite"),
        ("alpha", np.zeros((2, 2)), r"alpha: found shape \(2, 2\), expected \(1, 2\)"),
        ("alpha", np.full((1, 2), -1.0), "alpha: found a value negative"),
        ("weight", np.array([np.inf]), "weight: found a value negative or not finite"),
    ):
        with pytest.raises(InputError, match=message):
            fit_mixtures(**{**good, name: value})
