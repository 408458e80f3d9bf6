"""Transitions: counting by hand, and composite likelihood's ascent, optimum and equality with the plain algorithm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from predplan.errors import InputError
from predplan.labelling.active_set import Floats
from predplan.labelling.decoding import Transitions
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.transitions import composite_likelihood, counted_transitions, normalised

SEEDS = st.integers(0, 2**32 - 1)
TAGS = ("A", "B")


def corpus(*sentences: str) -> LabelledCorpus:
    tags = tuple(tuple(None if tag == "_" else tag for tag in sentence) for sentence in sentences)
    return LabelledCorpus(tuple(("w",) * len(sentence) for sentence in sentences), tags)


def check_distributions(chain: Transitions) -> None:
    assert chain.start.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(chain.between.sum(axis=1) + chain.stop, 1.0)
    assert min(chain.start.min(), chain.between.min(), chain.stop.min()) >= 0.0


def test_counts_by_hand() -> None:
    chain = counted_transitions(corpus("AAB", "B"), TAGS, smoothing=0.0)
    np.testing.assert_allclose(chain.start, [0.5, 0.5])
    np.testing.assert_allclose(chain.between, [[0.5, 0.5], [0.0, 0.0]])
    np.testing.assert_allclose(chain.stop, [0.0, 1.0])
    smoothed = counted_transitions(corpus("AAB", "B"), TAGS)
    np.testing.assert_allclose(smoothed.start, [2 / 4, 2 / 4])
    np.testing.assert_allclose(smoothed.between, [[2 / 5, 2 / 5], [1 / 5, 1 / 5]])
    np.testing.assert_allclose(smoothed.stop, [1 / 5, 3 / 5])


def test_pairs_with_an_unlabelled_word_are_not_counted() -> None:
    partly = counted_transitions(corpus("AB_A", "_"), TAGS, smoothing=0.0)
    np.testing.assert_allclose(partly.start, [1.0, 0.0])
    np.testing.assert_allclose(partly.between[0], [0.0, 0.5])
    np.testing.assert_allclose(partly.stop[0], 0.5)


@settings(max_examples=50, deadline=None)
@given(
    sentences=st.lists(st.text(alphabet="AB_", max_size=6), max_size=5),
    smoothing=st.sampled_from([0.0, 0.1, 1.0]),
)
def test_rows_are_distributions_and_no_sentence_is_empty(sentences: list[str], smoothing: float) -> None:
    check_distributions(counted_transitions(corpus(*sentences), TAGS, smoothing))


def test_rows_without_weight_are_uniform() -> None:
    chain = normalised(np.zeros((3, 3)))
    check_distributions(chain)
    np.testing.assert_allclose(chain.start, 1 / 2)
    np.testing.assert_allclose(chain.stop, 1 / 3)


def random_problem(rng: np.random.Generator) -> tuple[sparse.csr_array, Floats, Floats]:
    """Sparse bigram counts of 20 words, emissions and initial weights of 3 tags."""
    counts = rng.poisson(0.5, (21, 21)) * rng.integers(1, 20, (21, 21))
    counts[-1, -1] = 0
    counts[0, 0] += 1
    return sparse.csr_array(counts), rng.dirichlet(np.ones(20), size=3).T, rng.random((4, 4)) + 0.1


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_composite_likelihood_never_decreases(seed: int) -> None:
    bigrams, emissions, initial = random_problem(np.random.default_rng(seed))
    chain, likelihoods = composite_likelihood(bigrams, emissions, initial, 30)
    check_distributions(chain)
    assert len(likelihoods) == 30
    assert (np.diff(likelihoods) >= -1e-12).all()


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_one_iteration_is_algorithm_4_as_corrected(seed: int) -> None:
    bigrams, emissions, initial = random_problem(np.random.default_rng(seed))
    edged = np.block([[emissions, np.zeros((20, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    joint = initial / initial.sum()
    updated, likelihood = np.zeros((4, 4)), 0.0
    dense = bigrams.toarray() / bigrams.sum()
    for i, j in zip(*dense.nonzero(), strict=True):
        together = joint * np.outer(edged[i], edged[j])
        likelihood += dense[i, j] * np.log(together.sum())
        updated += dense[i, j] * together / together.sum()
    chain, likelihoods = composite_likelihood(bigrams, emissions, initial, 1)
    assert likelihoods == [pytest.approx(likelihood)]
    expected = normalised(updated)
    np.testing.assert_allclose(chain.between, expected.between, rtol=1e-9)
    np.testing.assert_allclose(chain.start, expected.start, rtol=1e-9)


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_recovers_a_chain_from_exact_bigram_probabilities(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.dirichlet(np.ones(16)).reshape(4, 4) + 0.01
    truth[-1, -1] = 0.0
    truth /= truth.sum()
    emissions = np.vstack([0.8 * np.eye(3), rng.dirichlet(np.ones(10), size=3).T * 0.2])
    edged = np.block([[emissions, np.zeros((13, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    chain, likelihoods = composite_likelihood(
        sparse.csr_array(edged @ truth @ edged.T), emissions, np.ones((4, 4)), 300
    )
    expected = normalised(truth)
    np.testing.assert_allclose(chain.between, expected.between, atol=1e-4)
    np.testing.assert_allclose(chain.start, expected.start, atol=1e-4)
    np.testing.assert_allclose(chain.stop, expected.stop, atol=1e-4)
    assert likelihoods[-1] > likelihoods[0]


def test_a_word_no_tag_emits_is_refused() -> None:
    emissions = np.array([[1.0, 1.0], [0.0, 0.0]])
    with pytest.raises(InputError, match="no pair of tags allows"):
        composite_likelihood(sparse.csr_array(np.ones((3, 3))), emissions, np.ones((3, 3)), 2)
