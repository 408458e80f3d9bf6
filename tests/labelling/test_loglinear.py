"""Log-linear emissions: gradient, duality with the mean parameters, consistency, and the limit of one-hot features."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import check_grad
from scipy.special import softmax

from predplan.errors import InputError, PredplanError
from predplan.labelling.loglinear import fit_emissions, literal_mean_parameters, mean_parameters, objective
from predplan.labelling.moments import ContextMoments

Floats = NDArray[np.float64]
SEEDS = st.integers(0, 2**32 - 1)


def binary_features(rng: np.random.Generator, words: int, width: int) -> sparse.csr_array:
    """A bias, and features of falling frequency."""
    dense = rng.random((words, width)) < np.linspace(0.7, 0.1, width)
    dense[:, 0] = True
    return sparse.csr_array(dense.astype(np.float64))


def random_means(rng: np.random.Generator, features: sparse.csr_array, tags: int) -> Floats:
    words = features.shape[0]
    return mean_parameters(features, rng.dirichlet(np.ones(words)), rng.dirichlet(np.ones(tags), size=words))


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, penalty=st.sampled_from([1e-4, 1.0]))
def test_gradient_agrees_with_finite_differences(seed: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    features = binary_features(rng, 12, 5)
    mu = random_means(rng, features, 3)
    weights = rng.normal(size=mu.size)
    value = objective(weights.reshape(mu.shape), features, mu, penalty)[0]
    error = check_grad(
        lambda x: objective(x.reshape(mu.shape), features, mu, penalty)[0],
        lambda x: objective(x.reshape(mu.shape), features, mu, penalty)[1].ravel(),
        weights,
    )
    assert error < 1e-6 * (1.0 + abs(value))  # differences round by the size of what is differenced


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, penalty=st.sampled_from([1e-4, 1e-2, 1.0]))
def test_expectations_differ_from_the_means_by_penalty_times_weights(seed: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    features = binary_features(rng, 40, 8)
    mu = random_means(rng, features, 3)
    emissions = fit_emissions(features, mu, penalty, tolerance=1e-6)
    probability = np.exp(emissions.log_scores(features))
    np.testing.assert_allclose(probability.sum(axis=0), 1.0, rtol=1e-10)
    np.testing.assert_allclose(features.T @ probability, mu - penalty * emissions.weights, atol=2e-6)


def test_the_start_does_not_move_the_optimum() -> None:
    rng = np.random.default_rng(3)
    features = binary_features(rng, 40, 8)
    mu = random_means(rng, features, 3)
    cold = fit_emissions(features, mu, 0.01, tolerance=1e-8)
    warm = fit_emissions(features, mu, 0.01, start=rng.normal(size=mu.shape), tolerance=1e-8)
    np.testing.assert_allclose(cold.weights, warm.weights, atol=1e-6)
    np.testing.assert_allclose(cold.log_normaliser, warm.log_normaliser, atol=1e-6)


def test_recovers_a_log_linear_model_at_the_rate_of_its_samples() -> None:
    rng = np.random.default_rng(11)
    features = binary_features(rng, 60, 8)
    truth = softmax(features @ rng.normal(size=(8, 4)), axis=0)
    sizes = np.array([300, 3_000, 30_000, 300_000])
    distances = []
    for size in sizes:
        runs = [np.column_stack([features.T @ rng.multinomial(size, o) / size for o in truth.T]) for _ in range(8)]
        fitted = [np.exp(fit_emissions(features, mu, 1e-9, tolerance=1e-6).log_scores(features)) for mu in runs]
        distances.append(np.mean([np.abs(o - truth).sum(axis=0).mean() for o in fitted]))
    slope = np.polyfit(np.log(sizes), np.log(distances), 1)[0]
    assert -0.6 < slope < -0.4
    assert distances[-1] < 0.01


def test_one_hot_features_give_relative_frequencies_as_the_penalty_vanishes() -> None:
    rng = np.random.default_rng(5)
    frequency = rng.dirichlet(np.ones(30), size=3).T
    one_hot = sparse.csr_array(sparse.eye_array(30))
    fitted = [
        fit_emissions(one_hot, frequency, penalty, iterations=500, tolerance=1e-6) for penalty in (1e-2, 1e-4, 1e-6)
    ]
    distance = [np.abs(np.exp(emissions.log_scores(one_hot)) - frequency).max() for emissions in fitted]
    assert distance[0] > 10 * distance[1] > 100 * distance[2]
    assert distance[2] < 1e-5


def test_means_outside_the_polytope_stay_bounded_by_the_penalty() -> None:
    features = sparse.csr_array(np.array([[1.0, 0.0], [0.0, 1.0]]))
    emissions = fit_emissions(features, np.array([[1.5], [0.5]]), 0.1)
    assert np.abs(emissions.weights).max() < 10


def test_real_valued_features() -> None:
    rng = np.random.default_rng(8)
    features = sparse.csr_array(rng.normal(size=(50, 6)))
    mu = random_means(rng, features, 2)
    probability = np.exp(fit_emissions(features, mu, 1e-8, tolerance=1e-6).log_scores(features))
    np.testing.assert_allclose(features.T @ probability, mu, atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_composed_means_are_the_expectations_of_bayes_rule(seed: int) -> None:
    rng = np.random.default_rng(seed)
    features, p = binary_features(rng, 9, 4), rng.dirichlet(np.ones(9))
    gamma = rng.dirichlet(np.ones(3), size=9)
    mu = mean_parameters(features, p, gamma)
    for tag in range(3):
        emission = [gamma[x, tag] * p[x] / sum(gamma[y, tag] * p[y] for y in range(9)) for x in range(9)]
        expected = sum(emission[x] * features.toarray()[x] for x in range(9))
        np.testing.assert_allclose(mu[:, tag], expected)


def separable(rng: np.random.Generator) -> tuple[ContextMoments, Floats, Floats]:
    """Noiseless moments Q = Gamma R of 30 words, 3 tags, 10 contexts a side; with R and Gamma."""
    R = np.hstack([rng.dirichlet(np.ones(10), size=3), rng.dirichlet(np.ones(10), size=3)])
    gamma = rng.dirichlet(np.ones(3), size=30)
    count = rng.integers(50, 1000, 30)
    counts = sparse.csr_array(count[:, None] * (gamma @ R))
    words = tuple(f"w{i}" for i in range(30))
    return ContextMoments(words, count, tuple(f"c{i}" for i in range(10)), counts), R, gamma


def test_literal_means_equal_the_composed_ones_without_noise() -> None:
    rng = np.random.default_rng(2)
    moments, R, gamma = separable(rng)
    features = binary_features(rng, 30, 6)
    composed = mean_parameters(features, moments.word_probability, gamma)
    np.testing.assert_allclose(literal_mean_parameters(features, moments, R), composed, atol=1e-8)


def test_literal_means_keep_labelled_frequencies_at_lambda_one() -> None:
    rng = np.random.default_rng(4)
    moments, R, gamma = separable(rng)
    one_hot = sparse.csr_array(sparse.eye_array(30))
    labelled = np.zeros((30, 3))
    labelled[7] = [0.0, 1.0, 3.0]
    free = literal_mean_parameters(one_hot, moments, R)
    tied = literal_mean_parameters(one_hot, moments, R, labelled, lam=1.0)
    p, tags = moments.word_probability, moments.word_probability @ gamma
    np.testing.assert_allclose(tied[7], np.array([0.0, 0.25, 0.75]) * p[7] / tags, atol=1e-8)
    np.testing.assert_allclose(np.delete(tied, 7, axis=0), np.delete(free, 7, axis=0), atol=1e-12)


def test_literal_means_refuse_negative_features() -> None:
    moments, R, _ = separable(np.random.default_rng(2))
    with pytest.raises(InputError, match="none below zero"):
        literal_mean_parameters(sparse.csr_array(-np.ones((30, 1))), moments, R)


def test_a_tag_no_word_has_is_named() -> None:
    with pytest.raises(InputError, match="column 1"):
        mean_parameters(sparse.csr_array(np.ones((2, 1))), np.full(2, 0.5), np.array([[1.0, 0.0], [1.0, 0.0]]))


def test_bad_input_is_named() -> None:
    features, mu = sparse.csr_array(np.ones((3, 2))), np.ones((2, 2))
    with pytest.raises(InputError, match=r"found shape \(3, 2\), expected \(2, K\)"):
        fit_emissions(features, np.ones((3, 2)), 0.1)
    with pytest.raises(InputError, match="start"):
        fit_emissions(features, mu, 0.1, start=np.ones((1, 2)))
    with pytest.raises(InputError, match="penalty: found 0"):
        fit_emissions(features, mu, 0.0)
    with pytest.raises(InputError, match="not finite"):
        fit_emissions(features, np.full((2, 2), np.nan), 0.1)
    with pytest.raises(InputError, match="no words"):
        fit_emissions(sparse.csr_array((0, 2)), mu, 0.1)


def test_running_out_of_steps_is_no_error_but_failing_is() -> None:
    rng = np.random.default_rng(3)
    features = binary_features(rng, 40, 8)
    mu = random_means(rng, features, 3)
    assert np.isfinite(fit_emissions(features, mu, 0.01, iterations=1).weights).all()
    with pytest.raises(PredplanError, match="L-BFGS stopped"):
        fit_emissions(features, mu, 0.01, tolerance=1e-40, iterations=10_000)
