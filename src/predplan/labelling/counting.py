"""Bigram counts of raw text in one streaming pass, in bounded memory: the sufficient statistic of all moments.

Each batch of sentences is counted by itself and its counts are written whole to a part file, so an interrupted count
goes on where it was; DuckDB adds the parts up out of core, in integers, so the sum does not depend on their order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy import sparse

from predplan.artifacts.files import write_whole
from predplan.errors import InputError
from predplan.labelling.sentences import TokenBatch

EDGE = -1
MEMORY_LIMIT = "512MB"


@dataclass(frozen=True)
class BigramCounts:
    """Counts of words and of neighbours. The id V, one past the vocabulary, is the edge of a sentence.

    vocabulary [V] by falling count, then by spelling; count [V];
    bigrams [V + 1, V + 1]: row u, column v counts u followed by v.
    """

    vocabulary: tuple[str, ...]
    count: NDArray[np.int64]
    bigrams: sparse.csr_array


class WordIndex:
    """Gives words their ids in the order of their first appearance, over all batches."""

    def __init__(self) -> None:
        self._ids: dict[str, int] = {}

    def global_ids(self, batch: TokenBatch) -> NDArray[np.int32]:
        """The batch's tokens [tokens] as ids that mean the same in every batch."""
        ids = self._ids
        table = np.fromiter((ids.setdefault(word, len(ids)) for word in batch.vocabulary), np.int32)
        return table[batch.ids]

    @property
    def words(self) -> list[str]:
        """All words seen so far, by id."""
        return list(self._ids)


def count_pairs(ids: NDArray[np.int32], offsets: NDArray[np.int64]) -> pa.Table:
    """Neighbouring pairs of a batch with their counts, sentence edges as EDGE: columns previous, next, n."""
    padded = np.insert(ids.astype(np.int64), np.unique(offsets), EDGE)
    base = int(ids.max(initial=0)) + 2
    keys, counts = np.unique((padded[:-1] + 1) * base + padded[1:] + 1, return_counts=True)
    return pa.table(
        {
            "previous": (keys // base - 1).astype(np.int32),
            "next": (keys % base - 1).astype(np.int32),
            "n": counts.astype(np.int64),
        }
    )


def write_part(path: Path, ids: NDArray[np.int32], offsets: NDArray[np.int64]) -> None:
    """Count a batch into the part file `path`; a part that is already there is kept."""
    if path.exists():
        return
    pairs = count_pairs(ids, offsets)
    with write_whole(path) as temporary:
        pq.write_table(pairs, temporary, compression="lz4", use_dictionary=False)


def merge_parts(parts: Sequence[Path], words: Sequence[str]) -> BigramCounts:
    """Add up part files written for the global ids of `words`, out of core. Raises InputError without any part."""
    if not parts:
        raise InputError("raw text: found no batch of sentences, expected at least one")
    import duckdb  # not needed where a model is only used

    with duckdb.connect(config={"memory_limit": MEMORY_LIMIT, "threads": 2}) as connection:
        pairs = connection.execute(
            "SELECT previous, next, sum(n)::BIGINT AS n FROM read_parquet($parts) GROUP BY ALL",
            {"parts": [str(part) for part in parts]},
        ).fetchnumpy()
    return _by_falling_count(pairs["previous"], pairs["next"], pairs["n"], words)


def _by_falling_count(
    previous: NDArray[np.int32], following: NDArray[np.int32], n: NDArray[np.int64], words: Sequence[str]
) -> BigramCounts:
    size = len(words)
    count = np.bincount(following[following != EDGE], n[following != EDGE], minlength=size).astype(np.int64)
    table = pa.table({"count": count, "word": pa.array(words, pa.string())})
    order = pc.sort_indices(table, [("count", "descending"), ("word", "ascending")]).to_numpy()
    rank = np.empty(size + 1, np.int32)
    rank[order] = np.arange(size)
    rank[EDGE] = size
    bigrams = sparse.csr_array((n, (rank[previous], rank[following])), shape=(size + 1, size + 1))
    bigrams.sort_indices()
    return BigramCounts(tuple([words[i] for i in order.tolist()]), count[order], bigrams)


def count_sentences(batches: Iterable[TokenBatch], folder: Path) -> BigramCounts:
    """Bigram counts of all batches; `folder` holds the parts meanwhile."""
    index, parts = WordIndex(), []
    for number, batch in enumerate(batches):
        parts.append(folder / f"part-{number:05d}.parquet")
        write_part(parts[-1], index.global_ids(batch), batch.offsets)
    return merge_parts(parts, index.words)
