"""Decoding against enumeration of every path of short sentences."""

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.errors import PredplanError
from predplan.labelling.active_set import Floats, Integers
from predplan.labelling.decoding import ExpectedCounts, Transitions, posteriors, viterbi
from predplan.labelling.transitions import normalised

SEEDS = st.integers(0, 2**32 - 1)


def random_chain(rng: np.random.Generator, tags: int) -> Transitions:
    return normalised(rng.random((tags + 1, tags + 1)) + 0.01)


def random_batch(rng: np.random.Generator, lengths: list[int], tags: int) -> tuple[Floats, Integers]:
    """Scores over many magnitudes, some zero."""
    scores = rng.random((sum(lengths), tags)) * 10.0 ** rng.uniform(-30, 5, (sum(lengths), tags))
    scores *= rng.random(scores.shape) < 0.9
    return scores, np.cumsum([0, *lengths])


def all_paths(scores: Floats, chain: Transitions) -> dict[tuple[int, ...], float]:
    """The weight of each path of one sentence, rows scaled to a largest entry of one as documented."""
    top = scores.max(axis=1, keepdims=True)
    rows = np.where(top > 0, scores / np.where(top > 0, top, 1), 1.0)
    weights = {}
    for path in product(range(len(chain.start)), repeat=len(rows)):
        weight = chain.start[path[0]] * chain.stop[path[-1]]
        for token, tag in enumerate(path):
            weight *= rows[token, tag]
        for previous, following in pairwise(path):
            weight *= chain.between[previous, following]
        weights[path] = float(weight)
    return weights


def enumerated(scores: Floats, offsets: Integers, chain: Transitions) -> ExpectedCounts:
    tags = len(chain.start)
    tokens, start, stop = np.zeros(scores.shape), np.zeros(tags), np.zeros(tags)
    between, log_likelihood = np.zeros((tags, tags)), 0.0
    for first, last in pairwise(offsets):
        if first == last:
            continue
        weights = all_paths(scores[first:last], chain)
        total = sum(weights.values())
        log_likelihood += np.log(total)
        for path, weight in weights.items():
            start[path[0]] += weight / total
            stop[path[-1]] += weight / total
            for token, tag in enumerate(path):
                tokens[first + token, tag] += weight / total
            for previous, following in pairwise(path):
                between[previous, following] += weight / total
    return ExpectedCounts(tokens, start, between, stop, log_likelihood)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, tags=st.integers(1, 3), lengths=st.lists(st.integers(0, 5), max_size=4))
def test_posteriors_equal_enumeration(seed: int, tags: int, lengths: list[int]) -> None:
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, tags)
    scores, offsets = random_batch(rng, lengths, tags)
    found, expected = posteriors(scores, offsets, chain), enumerated(scores, offsets, chain)
    np.testing.assert_allclose(found.tags, expected.tags, atol=1e-12)
    np.testing.assert_allclose(found.start, expected.start, atol=1e-12)
    np.testing.assert_allclose(found.between, expected.between, atol=1e-12)
    np.testing.assert_allclose(found.stop, expected.stop, atol=1e-12)
    assert found.log_likelihood == pytest.approx(expected.log_likelihood, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, tags=st.integers(1, 3), lengths=st.lists(st.integers(0, 5), max_size=4))
def test_viterbi_finds_a_path_as_probable_as_any(seed: int, tags: int, lengths: list[int]) -> None:
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, tags)
    scores, offsets = random_batch(rng, lengths, tags)
    path = viterbi(scores, offsets, chain)
    assert path.shape == (sum(lengths),)
    for first, last in pairwise(offsets):
        if first < last:
            weights = all_paths(scores[first:last], chain)
            assert weights[tuple(path[first:last].tolist())] == pytest.approx(max(weights.values()), rel=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_a_sentence_does_not_feel_its_neighbours(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, 4)
    scores, offsets = random_batch(rng, [3, 0, 7, 1, 40], 4)
    together, path = posteriors(scores, offsets, chain), viterbi(scores, offsets, chain)
    alone = [posteriors(scores[a:b], np.array([0, b - a]), chain) for a, b in pairwise(offsets)]
    np.testing.assert_array_equal(together.tags, np.concatenate([part.tags for part in alone]))
    np.testing.assert_allclose(together.between, sum(part.between for part in alone), rtol=1e-12)
    assert together.log_likelihood == pytest.approx(sum(part.log_likelihood for part in alone))
    paths = [viterbi(scores[a:b], np.array([0, b - a]), chain) for a, b in pairwise(offsets)]
    np.testing.assert_array_equal(path, np.concatenate(paths))


def test_a_long_sentence_neither_under_nor_overflows() -> None:
    rng = np.random.default_rng(0)
    chain = random_chain(rng, 3)
    found = posteriors(rng.random((100_000, 3)) * 1e-200, np.array([0, 100_000]), chain)
    np.testing.assert_allclose(found.tags.sum(axis=1), 1.0, rtol=1e-9)
    assert found.between.sum() == pytest.approx(99_999)


def test_a_row_of_zeros_is_no_evidence() -> None:
    chain = random_chain(np.random.default_rng(1), 3)
    rows = np.array([[0.2, 0.0, 0.5], [0.0, 0.0, 0.0], [0.1, 0.1, 0.4]])
    ones = np.where(rows.any(axis=1, keepdims=True), rows, 1.0)
    offsets = np.array([0, 3])
    np.testing.assert_array_equal(posteriors(rows, offsets, chain).tags, posteriors(ones, offsets, chain).tags)
    np.testing.assert_array_equal(viterbi(rows, offsets, chain), viterbi(ones, offsets, chain))


def test_no_sentence_at_all() -> None:
    chain = random_chain(np.random.default_rng(1), 2)
    for offsets in (np.array([0]), np.array([0, 0, 0])):
        found = posteriors(np.empty((0, 2)), offsets, chain)
        assert (found.tags.shape, found.log_likelihood, found.start.sum()) == ((0, 2), 0.0, 0.0)
        assert viterbi(np.empty((0, 2)), offsets, chain).shape == (0,)


def test_ties_go_to_the_lower_tag() -> None:
    even = Transitions(np.full(3, 1 / 3), np.full((3, 3), 0.25), np.full(3, 0.25))
    np.testing.assert_array_equal(viterbi(np.ones((4, 3)), np.array([0, 4]), even), np.zeros(4))


def test_an_impossible_sentence_is_named() -> None:
    apart = Transitions(np.array([1.0, 0.0]), np.array([[0.5, 0.0], [0.0, 0.5]]), np.array([0.5, 0.5]))
    scores = np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(PredplanError, match="sentence 2"):
        posteriors(scores, np.array([0, 1, 1, 3]), apart)
