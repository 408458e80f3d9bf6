"""The labelling branch's tables: their schemas, and the way between tables and what the algorithms exchange."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy import sparse

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import Column, TableSchema, open_table, read_table, write_table
from predplan.labelling.counting import BigramCounts
from predplan.labelling.sentences import LabelledCorpus

Floats = NDArray[np.float64]

_WORDS = Column("words", pa.list_(pa.string()), "1", "words of the sentence in order")
_SUBSET = Column("subset", pa.string(), "1", "training set: number of labelled sentences, then the seed of the draw")
_METHOD = Column("method", pa.string(), "1", "name of the method")

SENTENCES = TableSchema(
    "sentences",
    "corpus",
    (_WORDS, Column("tags", pa.list_(pa.string()), "1", "tag of each word; null where nobody has labelled it")),
)
UNTAGGED = TableSchema("untagged", "corpus", (_WORDS,))
DICTIONARY = TableSchema(
    "dictionary",
    "corpus",
    (Column("word", pa.string(), "1", "word"), Column("tag", pa.string(), "1", "a tag the word may have")),
)
TOKENS = TableSchema(
    "tokens",
    "tokenise",
    (Column("words", pa.list_(pa.int32()), "1", "a raw sentence: rows of the vocabulary table, in order"),),
)
VOCABULARY = TableSchema(
    "vocabulary", "tokenise", (Column("word", pa.string(), "1", "word, in order of first appearance in the raw text"),)
)
WORDS = TableSchema(
    "words",
    "moments",
    (
        Column("word", pa.string(), "1", "word, by falling count, then by spelling"),
        Column("count", pa.int64(), "occurrences", "times the word occurs in the raw text"),
    ),
)
BIGRAMS = TableSchema(
    "bigrams",
    "moments",
    (
        Column("previous", pa.int32(), "1", "row of the words table; one past the last is the edge of a sentence"),
        Column("next", pa.int32(), "1", "row of the words table, as for previous"),
        Column("n", pa.int64(), "occurrences", "times the two stand side by side in the raw text"),
    ),
)
ANCHORS = TableSchema(
    "anchors",
    "anchors",
    (
        _SUBSET,
        Column("tag", pa.string(), "1", "tag the word stands for"),
        Column("word", pa.string(), "1", "anchor word"),
        Column("purity", pa.float64(), "1", "share of the word's labels that are this tag; 1 from a dictionary alone"),
        Column("labelled", pa.int64(), "occurrences", "times the word is labelled"),
        Column("count", pa.int64(), "occurrences", "times the word occurs in the raw text"),
        Column("least_labelled", pa.int64(), "occurrences", "threshold on labels that the tag ended with"),
        Column("least_count", pa.int64(), "occurrences", "threshold on the raw count that the tag ended with"),
        Column("least_purity", pa.float64(), "1", "threshold on purity that the tag ended with"),
    ),
)
POSTERIORS = TableSchema(
    "posteriors",
    "emissions",
    (
        _SUBSET,
        Column("word", pa.string(), "1", "word"),
        Column("count", pa.int64(), "occurrences", "times the word occurs in the raw text"),
        Column("gamma", pa.list_(pa.float32()), "1", "p(tag | word) from anchors and contexts alone, by tag"),
        Column("log_ratio", pa.list_(pa.float32()), "nat", "mean log R_hc / q_c of the word's contexts, by tag"),
        Column("residual", pa.float64(), "1", "KKT residual of the word's problem"),
        Column("probability", pa.list_(pa.float32()), "1", "p(tag | word) with labels and spelling, by tag"),
    ),
)
TAG_NAMES = TableSchema("tags", "anchors", (Column("tag", pa.string(), "1", "tag, in the order used everywhere"),))
TRANSITIONS = TableSchema(
    "transitions",
    "transitions",
    (
        _SUBSET,
        _METHOD,
        Column("previous", pa.string(), "1", "previous tag, or start"),
        Column("next", pa.string(), "1", "next tag, or stop"),
        Column("probability", pa.float64(), "1", "p(next | previous)"),
    ),
)
PREDICTIONS = TableSchema(
    "predictions",
    "tag",
    (
        _SUBSET,
        _METHOD,
        Column("sentence", pa.int32(), "1", "row of the untagged test sentences"),
        Column("tags", pa.list_(pa.string()), "1", "predicted tag of each word"),
    ),
)
COSTS = TableSchema(
    "costs",
    "tag",
    (
        _SUBSET,
        _METHOD,
        Column("training_s", pa.float64(), "s", "wall time of training, counting of raw text left out"),
        Column("dev_accuracy", pa.float64(), "1", "accuracy a word on the development sentences"),
        Column("chosen", pa.string(), "1", "what was chosen on the development sentences"),
    ),
)

SCORES = TableSchema(
    "scores",
    "evaluate",
    (
        _SUBSET,
        _METHOD,
        Column("accuracy", pa.float64(), "1", "share of the test words tagged right"),
        Column("low", pa.float64(), "1", "lower end of the 95 % interval, sentences drawn anew"),
        Column("high", pa.float64(), "1", "upper end of the 95 % interval, sentences drawn anew"),
        Column("unknown_accuracy", pa.float64(), "1", "accuracy on words without label in the training set", True),
        Column("sentence_accuracy", pa.float64(), "1", "share of the test sentences tagged right throughout"),
        Column("tokens", pa.int64(), "words", "test words scored"),
    ),
)
TAG_SCORES = TableSchema(
    "tag_scores",
    "evaluate",
    (
        _SUBSET,
        _METHOD,
        Column("tag", pa.string(), "1", "tag"),
        Column("precision", pa.float64(), "1", "share of the words given this tag that have it"),
        Column("recall", pa.float64(), "1", "share of the words that have this tag that are given it"),
        Column("f1", pa.float64(), "1", "harmonic mean of precision and recall"),
        Column("support", pa.int64(), "words", "test words that have this tag"),
    ),
)
CONFUSION = TableSchema(
    "confusion",
    "evaluate",
    (
        _SUBSET,
        _METHOD,
        Column("gold", pa.string(), "1", "tag the word has"),
        Column("predicted", pa.string(), "1", "tag the word was given"),
        Column("n", pa.int64(), "words", "test words"),
    ),
)
COMPARISONS = TableSchema(
    "comparisons",
    "evaluate",
    (
        _SUBSET,
        Column("method", pa.string(), "1", "the method"),
        Column("other", pa.string(), "1", "the method it is held against"),
        Column("difference", pa.float64(), "1", "accuracy of the method less that of the other"),
        Column("low", pa.float64(), "1", "lower end of its 95 % interval, sentences drawn anew"),
        Column("high", pa.float64(), "1", "upper end of its 95 % interval"),
        Column("mcnemar_p", pa.float64(), "1", "p-value of McNemar's test over words"),
        Column("ks_p", pa.float64(), "1", "p-value of the thesis's Kolmogorov-Smirnov test over words"),
    ),
)
TAGGED = TableSchema(
    "tagged",
    "evaluate",
    (
        _SUBSET,
        _METHOD,
        _WORDS,
        Column("gold", pa.list_(pa.string()), "1", "tag each word has"),
        Column("predicted", pa.list_(pa.string()), "1", "tag each word was given"),
    ),
)
CURVE = TableSchema(
    "curve",
    "evaluate",
    (
        _METHOD,
        Column("size", pa.int64(), "sentences", "labelled sentences"),
        Column("draw", pa.int64(), "1", "seed of the draw"),
        Column("accuracy", pa.float64(), "1", "share of the test words tagged right"),
    ),
)
ABLATIONS = TableSchema(
    "ablations",
    "ablate",
    (
        _SUBSET,
        Column("component", pa.string(), "1", "what was changed"),
        Column("setting", pa.string(), "1", "its value"),
        Column("default", pa.bool_(), "1", "whether this is the default"),
        Column("dev_accuracy", pa.float64(), "1", "accuracy a word of the anchor HMM on the development sentences"),
    ),
)


def write_corpus(path: Path, corpus: LabelledCorpus, provenance: Provenance) -> None:
    """Labelled sentences as a table."""
    write_table(path, SENTENCES, {"words": list(corpus.words), "tags": list(corpus.tags)}, provenance)


def read_corpus(path: Path) -> LabelledCorpus:
    """Labelled sentences from their table."""
    table = read_table(path, SENTENCES)
    words, tags = table["words"].to_pylist(), table["tags"].to_pylist()
    return LabelledCorpus(tuple(map(tuple, words)), tuple(map(tuple, tags)))


def read_dictionary_table(path: Path) -> Mapping[str, frozenset[str]]:
    """Word -> its possible tags."""
    table = read_table(path, DICTIONARY)
    allowed: dict[str, set[str]] = {}
    for word, tag in zip(table["word"].to_pylist(), table["tag"].to_pylist(), strict=True):
        allowed.setdefault(word, set()).add(tag)
    return {word: frozenset(tags) for word, tags in allowed.items()}


def token_rows(ids: NDArray[np.int32], offsets: NDArray[np.int64]) -> pa.Table:
    """Rows of the tokens table for a batch of sentences."""
    return pa.table({"words": pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), pa.array(ids, pa.int32()))})


@contextmanager
def open_token_batches(path: Path) -> Iterator[Iterator[tuple[NDArray[np.int32], NDArray[np.int64]]]]:
    """The tokens table a row group at a time, as ids [tokens] and offsets [sentences + 1]."""
    with open_table(path, TOKENS) as file:
        yield (_batch(file.read_row_group(group)) for group in range(file.num_row_groups))


def _batch(table: pa.Table) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    column = table["words"].combine_chunks()
    offsets = column.offsets.to_numpy().astype(np.int64)
    return column.flatten().to_numpy().astype(np.int32, copy=False), offsets - offsets[0]


def write_bigrams(words: Path, bigrams: Path, counts: BigramCounts, provenance: Provenance) -> None:
    """Bigram counts as a table of words and a table of pairs."""
    pairs = sparse.coo_array(counts.bigrams)
    write_table(words, WORDS, {"word": list(counts.vocabulary), "count": counts.count}, provenance)
    write_table(bigrams, BIGRAMS, {"previous": pairs.row, "next": pairs.col, "n": pairs.data}, provenance)


def read_bigrams(words: Path, bigrams: Path) -> BigramCounts:
    """Bigram counts from their two tables."""
    table, pairs = read_table(words, WORDS), read_table(bigrams, BIGRAMS)
    edge = len(table)
    matrix = sparse.csr_array(
        (pairs["n"].to_numpy(), (pairs["previous"].to_numpy(), pairs["next"].to_numpy())), shape=(edge + 1, edge + 1)
    )
    return BigramCounts(tuple(table["word"].to_pylist()), table["count"].to_numpy(), matrix)


def rows_of(matrix: Floats) -> pa.ListArray:
    """A matrix [n, K] as a column of lists of float32."""
    offsets = np.arange(len(matrix) + 1) * matrix.shape[1]
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), pa.array(matrix.ravel().astype(np.float32)))


def matrix_of(column: pa.ChunkedArray, width: int) -> Floats:
    """A column of lists of equal length as a matrix [n, width]."""
    values = column.combine_chunks().flatten().to_numpy().astype(np.float64)
    return np.asarray(values.reshape(-1, width))


def prediction_rows(subset: str, method: str, sentences: Sequence[Sequence[str]]) -> pa.Table:
    """Rows of the predictions table for one method."""
    return pa.table(
        {
            "subset": pa.repeat(subset, len(sentences)),
            "method": pa.repeat(method, len(sentences)),
            "sentence": pa.array(range(len(sentences)), pa.int32()),
            "tags": pa.array(sentences, pa.list_(pa.string())),
        }
    )
