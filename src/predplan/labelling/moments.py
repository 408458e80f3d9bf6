"""Moments of words and contexts (section 3.3.1), derived from bigram counts.

A context is the previous or the next word. Context words that are rare in the raw text stand for their class of
spelling, so every context is seen often enough to be measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import compress, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.labelling.counting import BigramCounts
from predplan.labelling.features import SpellingClasses
from predplan.labelling.subspace import Scaled, right_singular_vectors

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ContextMoments:
    """Counts of contexts around each word: words [V] and, twice, contexts [C]: previous, then next word.

    counts [V, 2C] is |D| p_w Q_wc of Eq. 3.5 before division; names [C] of the contexts of one side.
    """

    vocabulary: tuple[str, ...]
    word_count: NDArray[np.int64]
    names: tuple[str, ...]
    counts: sparse.csr_array

    @property
    def word_probability(self) -> Floats:
        """p of Eq. 3.7 [V]."""
        return np.asarray(self.word_count / self.word_count.sum())

    @property
    def context_probability(self) -> Floats:
        """q of Eq. 3.6 [2C], each side summing to one."""
        return np.asarray(by_side(np.asarray(self.counts.sum(axis=0))[None])[0])


def context_moments(bigrams: BigramCounts, classes: SpellingClasses, least_count: int) -> ContextMoments:
    """Contexts are the words seen at least `least_count` times, a class of spelling for each other word, and the edge.

    A class is named in angle brackets; a word of the text that looks the same is a context of its own.
    """
    size, common = len(bigrams.vocabulary), bigrams.count >= least_count
    own = list(compress(bigrams.vocabulary, common))
    shared = list(map(classes.of, compress(bigrams.vocabulary, ~common)))
    number = {name: len(own) + place for place, name in enumerate(dict.fromkeys([*shared, "edge"]))}
    context = np.empty(size + 1, np.int32)
    context[:size][common] = np.arange(len(own))
    context[:size][~common] = [number[name] for name in shared]
    context[size] = number["edge"]
    width = len(own) + len(number)
    before = _grouped(bigrams.bigrams.T.tocsr(), context, size, 2 * width)
    after = _grouped(bigrams.bigrams, context + width, size, 2 * width)
    counts = sparse.csr_array(before + after)
    names = (*own, *(f"<{name}>" for name in number))
    return ContextMoments(bigrams.vocabulary, bigrams.count, names, counts)


def _grouped(counts: sparse.csr_array, column: NDArray[np.int32], rows: int, width: int) -> sparse.csr_array:
    """The first rows of counts with each column j moved to column[j], where those that meet are added up."""
    end = counts.indptr[rows]
    moved = (counts.data[:end].astype(np.float64), column[counts.indices[:end]], counts.indptr[: rows + 1].copy())
    grouped = sparse.csr_array(moved, shape=(rows, width))
    grouped.sum_duplicates()
    return grouped


def parts(counts: sparse.csr_array, rows: NDArray[np.int64], size: int = 1 << 21) -> Iterator[slice]:
    """Slices of `rows` whose rows hold about `size` counts each: work on a slice at a time copies no more than that."""
    ends = np.cumsum(np.diff(counts.indptr)[rows])
    cuts = np.searchsorted(ends, np.arange(size, ends[-1], size)).tolist() if len(rows) else []
    for first, last in pairwise([0, *dict.fromkeys(cut for cut in cuts if cut), len(rows)]):
        yield slice(first, last)


def by_side(counts: Floats) -> Floats:
    """Rows of counts [n, 2C] as two distributions each, of the previous and of the next word; empty sides are zero."""
    sides = counts.reshape(len(counts), 2, -1)
    totals = sides.sum(axis=2, keepdims=True)
    shares: Floats = np.divide(sides, totals, out=np.zeros_like(sides), where=totals > 0)
    return shares.reshape(counts.shape)


def context_label_moments(moments: ContextMoments, anchors: NDArray[np.bool_], smoothing: float) -> Floats:
    """R of Eq. 3.12 [K, 2C] from anchors [V, K]: contexts of a tag's anchors, each side a distribution.

    `smoothing` pseudo-counts of the overall context distribution are added, so that no context is impossible.
    """
    rows = np.flatnonzero(anchors.any(axis=1))
    counted = np.asarray((moments.counts[rows].T @ anchors[rows].astype(np.float64)).T)
    return by_side(counted + smoothing * moments.context_probability)


def canonical_contexts(moments: ContextMoments, dimension: int, seed: int) -> Floats:
    """The projection P_C [2C, dimension] of contexts by a canonical correlation analysis with words (section 3.5).

    It is scaled to act on counts.
    """
    rows, columns = (_inverse_root(np.asarray(moments.counts.sum(axis=axis)).ravel()) for axis in (1, 0))
    whitened = Scaled(moments.counts, rows, columns)
    return np.asarray(right_singular_vectors(whitened, dimension, np.random.default_rng(seed)) * columns[:, None])


def canonical_vectors(counts: sparse.csr_array, projection: Floats) -> Floats:
    """Words with counts of contexts [n, 2C] as unit vectors [n, dimension] of the analysis that gave P_C."""
    vectors = np.asarray(counts @ projection)
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=vectors, where=lengths > 0))


def _inverse_root(totals: Floats) -> Floats:
    return np.divide(1.0, np.sqrt(totals), out=np.zeros_like(totals), where=totals > 0)
