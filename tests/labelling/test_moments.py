"""Moments against loops over the tokens, and the identities of section 3.3."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from predplan.labelling.active_set import Floats
from predplan.labelling.counting import BigramCounts, count_sentences
from predplan.labelling.features import SpellingClasses
from predplan.labelling.moments import (
    ContextMoments,
    by_side,
    canonical_contexts,
    canonical_vectors,
    context_label_moments,
    context_moments,
    parts,
)
from predplan.labelling.sentences import TokenBatch

TEXT = [line.split() for line in ("the cat saw the dog", "the dog was going", "a cat was doing 7 things", "ok")]
LEAST = 2


@pytest.fixture
def bigrams(tmp_path: Path) -> BigramCounts:
    ids: dict[str, int] = {}
    tokens = np.array([ids.setdefault(word, len(ids)) for line in TEXT for word in line], np.int32)
    return count_sentences([TokenBatch(tuple(ids), tokens, np.cumsum([0, *map(len, TEXT)]))], tmp_path)


@pytest.fixture
def classes(bigrams: BigramCounts) -> SpellingClasses:
    return SpellingClasses.learn(bigrams.vocabulary, bigrams.count.tolist(), rare=1, least_types=2)


def test_counts_equal_a_loop_over_tokens(bigrams: BigramCounts, classes: SpellingClasses) -> None:
    moments = context_moments(bigrams, classes, LEAST)
    count = Counter(word for line in TEXT for word in line)
    naive: Counter[tuple[str, str, str]] = Counter()
    for line in TEXT:
        for place, word in enumerate(line):
            for side, neighbour in (("previous", place - 1), ("next", place + 1)):
                name = "<edge>"
                if 0 <= neighbour < len(line):
                    seen = line[neighbour]
                    name = seen if count[seen] >= LEAST else f"<{classes.of(seen)}>"
                naive[word, side, name] += 1
    sides = [("previous", name) for name in moments.names] + [("next", name) for name in moments.names]
    table = moments.counts.tocoo()
    found = {(moments.vocabulary[w], *sides[c]): n for w, c, n in zip(table.row, table.col, table.data, strict=True)}
    assert found == naive
    assert {"<lower:ing>", "<edge>", "<number>", "the"} <= set(moments.names)
    assert "going" not in moments.names
    np.testing.assert_array_equal(moments.counts.sum(axis=1), 2 * moments.word_count)


def test_a_word_that_looks_like_a_class_or_the_edge_is_its_own_context() -> None:
    after = sparse.csr_array(np.array([[0, 1, 2], [1, 0, 0], [2, 0, 0]]))
    bigrams = BigramCounts(("<edge>", "x"), np.array([3, 1]), after)
    moments = context_moments(bigrams, SpellingClasses(frozenset()), LEAST)
    assert moments.names == ("<edge>", "<lower>", "<edge>")
    np.testing.assert_array_equal(moments.counts.toarray(), [[0, 1, 2, 0, 1, 2], [1, 0, 0, 1, 0, 0]])


def test_sides_are_distributions_with_equal_words(bigrams: BigramCounts, classes: SpellingClasses) -> None:
    moments = context_moments(bigrams, classes, LEAST)
    contexts = len(moments.names)
    q = moments.context_probability
    assert q[:contexts].sum() == pytest.approx(1.0)
    assert q[contexts:].sum() == pytest.approx(1.0)
    assert moments.word_probability.sum() == pytest.approx(1.0)
    Q = by_side(moments.counts.toarray())
    np.testing.assert_allclose(moments.word_probability @ Q, q)
    np.testing.assert_allclose(Q.reshape(len(Q), 2, -1).sum(axis=2), 1.0)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), smoothing=st.sampled_from([0.0, 1.0, 50.0]))
def test_label_contexts_average_those_of_anchors(seed: int, smoothing: float) -> None:
    rng = np.random.default_rng(seed)
    moments = random_moments(rng)
    chosen = np.zeros((12, 3), np.bool_)
    chosen[rng.permutation(12)[:6], [0, 0, 1, 1, 2, 2]] = True
    found = context_label_moments(moments, chosen, smoothing)
    q = moments.context_probability
    dense = moments.counts.toarray()
    for tag in range(3):
        for side in (slice(0, 7), slice(7, 14)):
            total = sum(dense[word, side] for word in np.flatnonzero(chosen[:, tag])) + smoothing * q[side]
            np.testing.assert_allclose(found[tag, side], total / total.sum())
    assert smoothing == 0.0 or (found[:, q > 0] > 0).all()


@given(lengths=st.lists(st.integers(0, 9), max_size=12), size=st.integers(1, 12))
def test_parts_cover_the_rows_in_order_and_hold_few_counts(lengths: list[int], size: int) -> None:
    counts = sparse.csr_array((np.arange(9) < np.array(lengths, int).reshape(-1, 1)).astype(float))
    rows = np.flatnonzero(np.arange(len(lengths)) % 3)
    found = [rows[some] for some in parts(counts, rows, size)]
    np.testing.assert_array_equal(np.concatenate([*found, []]), rows)
    assert all(counts[some].nnz < size + 2 * 9 for some in found)


def test_empty_sides_stay_zero() -> None:
    rows = by_side(np.array([[1.0, 3.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(rows, [[0.25, 0.75, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])


def random_moments(rng: np.random.Generator) -> ContextMoments:
    """12 words, 7 contexts a side, both sides of a word equally many."""
    count = rng.integers(20, 200, 12)
    sides = [np.array([rng.multinomial(n, rng.dirichlet(np.full(7, 0.5))) for n in count], float) for _ in range(2)]
    words, names = tuple(f"w{i}" for i in range(12)), tuple(f"c{i}" for i in range(7))
    return ContextMoments(words, count, names, sparse.csr_array(np.hstack(sides)))


def whitened(moments: ContextMoments) -> Floats:
    dense = moments.counts.toarray()
    return np.asarray(dense / np.sqrt(dense.sum(axis=1))[:, None] / np.sqrt(dense.sum(axis=0)))


def test_canonical_vectors_have_unit_length_and_the_geometry_of_the_analysis() -> None:
    moments = random_moments(np.random.default_rng(0))
    vectors = canonical_vectors(moments.counts, canonical_contexts(moments, 4, seed=0))
    assert vectors.shape == (12, 4)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0)
    left, values, _ = np.linalg.svd(whitened(moments))
    exact = left[:, :4] * values[:4]
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    np.testing.assert_allclose(vectors @ vectors.T, exact @ exact.T, atol=1e-6)
    np.testing.assert_array_equal(vectors, canonical_vectors(moments.counts, canonical_contexts(moments, 4, seed=0)))


def test_canonical_contexts_are_uncorrelated_under_the_contexts_frequency() -> None:
    moments = random_moments(np.random.default_rng(1))
    projection = canonical_contexts(moments, 4, seed=0)
    assert projection.shape == (14, 4)
    totals = moments.counts.toarray().sum(axis=0)
    np.testing.assert_allclose(projection.T @ (totals[:, None] * projection), np.eye(4), atol=1e-8)
