"""Laws of the simplex programs, and both solvers against qpsolvers."""

from typing import Any

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.errors import InputError, PredplanError
from predplan.labelling import simplex
from predplan.labelling.active_set import Floats
from predplan.labelling.simplex import kkt_residuals, simplex_posteriors, solve_active_set, solve_piqp

SOLVERS = {"active_set": solve_active_set, "piqp": solve_piqp}
SEEDS = st.integers(0, 2**32 - 1)


def rows_sharing(share: float, states: int, rng: np.random.Generator, contexts: int = 60) -> Floats:
    """Context distributions that have a share of their mass in common: the nearer to 1, the worse conditioned."""
    common = rng.dirichlet(np.full(contexts, 0.3))
    return share * common + (1.0 - share) * rng.dirichlet(np.full(contexts, 0.3), size=states)


def noisy_program(share: float, states: int, words: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    R = rows_sharing(share, states, rng)
    Q = rng.dirichlet(np.full(states, 0.3), size=words) @ R + 0.01 * rng.normal(size=(words, R.shape[1]))
    return R @ R.T, Q @ R.T


def objective(H: Floats, B: Floats, gamma: Floats) -> Floats:
    values: Floats = np.einsum("wi,ij,wj->w", gamma, H, gamma) - 2.0 * (B * gamma).sum(axis=1)
    return values


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("share", [0.0, 0.9, 0.999])
@pytest.mark.parametrize("states", [2, 5, 12])
def test_equals_qpsolvers(solver: str, share: float, states: int) -> None:
    H, B = noisy_program(share, states, 40, np.random.default_rng(states))
    solution = SOLVERS[solver](H, B)
    ones, zero = np.ones((1, states)), np.zeros(states)
    accuracy: dict[str, Any] = {"eps_abs": 1e-12, "eps_rel": 1e-12}
    reference = np.array(
        [qpsolvers.solve_qp(2 * H, -2 * b, A=ones, b=ones[0, :1], lb=zero, solver="piqp", **accuracy) for b in B]
    )
    np.testing.assert_allclose(solution.gamma, reference, atol=2e-4)
    assert (objective(H, B, solution.gamma) <= objective(H, B, reference) + 1e-11).all()
    assert solution.residual.max() <= (1e-10 if solver == "active_set" else 1e-9)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, states=st.integers(1, 15), rank=st.integers(0, 15), magnitude=st.integers(-8, 8))
def test_active_set_solves_any_semidefinite_program(seed: int, states: int, rank: int, magnitude: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(states, rank)) * 10.0 ** rng.uniform(-4.0, 0.0, size=rank)
    B = 10.0**magnitude * rng.normal(size=(30, states))
    solution = solve_active_set(root @ root.T, B)
    assert solution.residual.max() <= 1e-10
    assert (solution.gamma >= 0.0).all()
    np.testing.assert_allclose(solution.gamma.sum(axis=1), 1.0, rtol=1e-14)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, states=st.integers(2, 8))
def test_ties_and_duplicate_rows(seed: int, states: int) -> None:
    rng = np.random.default_rng(seed)
    R = rng.integers(0, 2, size=(states, 4)).astype(np.float64)
    R = np.vstack([R, R[:2]])
    Q = rng.integers(0, 3, size=(20, 4)) / 2.0
    H, B = R @ R.T, Q @ R.T
    exact, interior = solve_active_set(H, B), solve_piqp(H, B)
    assert exact.residual.max() <= 1e-10
    np.testing.assert_allclose(exact.gamma @ R, interior.gamma @ R, atol=1e-4)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, states=st.integers(2, 12))
def test_permuting_the_states_permutes_the_solution(seed: int, states: int) -> None:
    rng = np.random.default_rng(seed)
    H, B = noisy_program(0.5, states, 20, rng)
    order = rng.permutation(states)
    permuted = solve_active_set(H[np.ix_(order, order)], B[:, order]).gamma
    np.testing.assert_allclose(permuted, solve_active_set(H, B).gamma[:, order], atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, factor=st.floats(1e-6, 1e6), shift=st.floats(-1.0, 1.0))
def test_units_and_a_shift_of_the_linear_term_do_not_matter(seed: int, factor: float, shift: float) -> None:
    H, B = noisy_program(0.5, 6, 20, np.random.default_rng(seed))
    gamma = solve_active_set(H, B).gamma
    np.testing.assert_allclose(solve_active_set(factor * H, factor * (B + shift)).gamma, gamma, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, states=st.integers(1, 12), share=st.sampled_from([0.0, 0.9, 0.99]))
def test_recovers_exact_mixtures(seed: int, states: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    R = rows_sharing(share, states, rng)
    truth = rng.dirichlet(np.full(states, 0.3), size=20)
    np.testing.assert_allclose(solve_active_set(R @ R.T, truth @ R @ R.T).gamma, truth, atol=1e-7)


@pytest.mark.parametrize("solver", SOLVERS)
def test_anchors_give_one_hot(solver: str) -> None:
    R = rows_sharing(0.9, 12, np.random.default_rng(0))
    gamma = SOLVERS[solver](R @ R.T, R @ R.T).gamma
    np.testing.assert_allclose(gamma, np.eye(12), atol=1e-9 if solver == "active_set" else 1e-4)


@pytest.mark.parametrize("solver", SOLVERS)
def test_rows_do_not_depend_on_each_other(solver: str) -> None:
    H, B = noisy_program(0.9, 12, 50, np.random.default_rng(3))
    solve = SOLVERS[solver]
    whole = solve(H, B).gamma
    parts = np.vstack([solve(H, B[:7]).gamma, solve(H, B[7:]).gamma])
    assert whole.tobytes() == parts.tobytes()


def test_rows_the_active_set_leaves_go_to_piqp(monkeypatch: pytest.MonkeyPatch) -> None:
    H, B = noisy_program(0.5, 4, 10, np.random.default_rng(4))
    monkeypatch.setattr(simplex, "minimise_rows", lambda H, B, inverse, gamma: gamma.fill(0.25))
    assert solve_active_set(H, B).residual.max() <= 1e-10
    monkeypatch.setattr(simplex, "solve_piqp", lambda H, B: simplex.SimplexSolution(0 * B, np.ones(len(B))))
    with pytest.raises(PredplanError, match="word 0: active set left"):
        solve_active_set(H, B)


def test_residual_sees_every_kind_of_error() -> None:
    H, B = np.eye(3), np.zeros((4, 3))
    gamma = np.array([[1, 1, 1], [1, 1, 2], [3, 0, 0], [-1, 2, 2]]) / 3.0
    residual = kkt_residuals(H, B, gamma)
    assert residual[0] < 1e-15
    assert (residual[1:] > 0.1).all()


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, lam=st.floats(0.0, 1.0), solver=st.sampled_from(["active_set", "piqp"]))
def test_regularised_posteriors(seed: int, lam: float, solver: simplex.Solver) -> None:
    rng = np.random.default_rng(seed)
    H, B = noisy_program(0.5, 5, 20, rng)
    labelled, seen = rng.dirichlet(np.full(5, 0.3), size=20), rng.random(20) < 0.5
    solution = simplex_posteriors(H, B, labelled, seen, lam, solver)
    free = simplex_posteriors(H, B, None, np.zeros(20, bool), lam, solver)
    assert solution.gamma[~seen].tobytes() == free.gamma[~seen].tobytes()
    drift = np.linalg.norm(solution.gamma - labelled, axis=1) - np.linalg.norm(free.gamma - labelled, axis=1)
    assert (drift[seen] <= 1e-4).all()
    if lam < 1.0:
        weight = np.where(seen, lam, 0.0)[:, None]
        gradient = (1 - weight) * (solution.gamma @ H - B) + weight * (solution.gamma - labelled)
        gap = (solution.gamma * (gradient - gradient.min(axis=1, keepdims=True))).sum(axis=1)
        assert gap.max() <= 1e-8


def test_full_regularisation_keeps_labelled_posteriors_exactly() -> None:
    rng = np.random.default_rng(0)
    H, B = noisy_program(0.5, 5, 20, rng)
    labelled, seen = rng.dirichlet(np.full(5, 0.3), size=20), np.arange(20) < 8
    gamma = simplex_posteriors(H, B, labelled, seen, 1.0).gamma
    assert gamma[seen].tobytes() == labelled[seen].tobytes()
    assert gamma[~seen].tobytes() == solve_active_set(H, B).gamma[~seen].tobytes()


H3, B3, SEEN = np.eye(3), np.zeros((2, 3)), np.array([True, False])
ROWS = np.full((2, 3), 1 / 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.full((3, 3), np.nan), B3, ROWS, SEEN, 0.5), "Hessian: found a value that is not finite"),
        ((np.ones((3, 2)), B3, ROWS, SEEN, 0.5), r"Hessian: found shape \(3, 2\)"),
        ((np.triu(np.ones((3, 3))), B3, ROWS, SEEN, 0.5), "Hessian: found one not symmetric"),
        ((-H3, B3, ROWS, SEEN, 0.5), "Hessian: found one not symmetric positive semidefinite"),
        ((H3, np.array([[0, 0, 0], [0, np.inf, 0]]), ROWS, SEEN, 0.5), "linear terms, row 1"),
        ((H3, np.zeros((2, 4)), ROWS, SEEN, 0.5), r"linear terms: found shape \(2, 4\)"),
        ((H3, B3, None, SEEN, 0.5), "labelled: found none"),
        ((H3, B3, ROWS[:1], SEEN, 0.5), r"labelled: found shape \(1, 3\)"),
        ((H3, B3, ROWS * 2, SEEN, 0.5), "labelled, row 0"),
        ((H3, B3, ROWS * np.nan, SEEN, 0.5), "labelled, row 0"),
        ((H3, B3, ROWS, SEEN[:1], 0.5), r"seen: found shape \(1,\)"),
        ((H3, B3, ROWS, SEEN, 1.5), r"lam: found 1.5, expected a number in \[0, 1\]"),
        ((H3, B3, ROWS, SEEN, float("nan")), "lam: found nan"),
        ((H3, B3, ROWS, SEEN, 0.5, "simplex"), "solver: found 'simplex'"),
    ],
)
def test_bad_input_is_named(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simplex_posteriors(*arguments)


def test_no_words() -> None:
    assert solve_active_set(H3, np.zeros((0, 3))).gamma.shape == (0, 3)
    assert solve_piqp(H3, np.zeros((0, 3))).gamma.shape == (0, 3)
