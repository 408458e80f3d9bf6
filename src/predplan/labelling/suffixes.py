"""Tags of words from words of the same kind and suffix, backing off to shorter suffixes (Brants 2000, TnT)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predplan.labelling.features import kind

Floats = NDArray[np.float64]
LONGEST_SUFFIX = 4


def suffix_chain(word: str) -> list[str]:
    """Classes of a word, wide to narrow: all words, its kind, then its kind with suffixes of growing length."""
    name, lower = kind(word), word.lower()
    return ["", name, *(f"{name}:{lower[-n:]}" for n in range(1, min(LONGEST_SUFFIX, len(lower)) + 1))]


@dataclass(frozen=True)
class SuffixTree:
    """Classes of the words it was grown from: rows by name, parent [classes] of each, depth [classes], the root first.

    leaf [words] is each word's narrowest class.
    """

    rows: Mapping[str, int]
    parent: NDArray[np.int64]
    depth: NDArray[np.int64]
    leaf: NDArray[np.int64]

    @classmethod
    def grow(cls, words: Sequence[str]) -> SuffixTree:
        """The tree of all classes that `words` fall into."""
        rows, parent, depth = {"": 0}, [0], [0]
        leaf = np.zeros(len(words), np.int64)
        for place, word in enumerate(words):
            row = 0
            for level, name in enumerate(suffix_chain(word)):
                if name not in rows:
                    rows[name] = len(rows)
                    parent.append(row)
                    depth.append(level)
                row = rows[name]
            leaf[place] = row
        return cls(rows, np.array(parent), np.array(depth), leaf)

    def judge(self, counts: Floats, backoff: float) -> Suffixes:
        """From counts of tags [words, K]; each class starts from `backoff` pseudo-counts shared as in its parent."""
        own = np.zeros((len(self.rows), counts.shape[1]))
        np.add.at(own, self.leaf, counts)
        levels = [np.flatnonzero(self.depth == level) for level in range(1, self.depth.max() + 1)]
        for level in reversed(levels):
            np.add.at(own, self.parent[level], own[level])
        table = own.copy()
        table[0] += 1.0
        table[0] /= table[0].sum()
        for level in levels:
            table[level] += backoff * table[self.parent[level]]
            table[level] /= table[level].sum(axis=1, keepdims=True)
        return Suffixes(self.rows, table)


@dataclass(frozen=True)
class Suffixes:
    """p(tag | class) [classes, K] and the row of each class; the class "" holds all words."""

    rows: Mapping[str, int]
    table: Floats

    def probabilities(self, words: Sequence[str]) -> Floats:
        """p(tag | word) [words, K] by each word's narrowest known class."""
        places = [max(self.rows.get(name, 0) for name in suffix_chain(word)) for word in words]
        return self.table[np.array(places, np.int64)]
