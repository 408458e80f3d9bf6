"""Tables of a saved tagger: their schemas, and the way between tables and what was learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from predplan.artifacts.tables import Column, TableSchema, read_table
from predplan.labelling.chain import OFFSETS, ChainWeights
from predplan.labelling.decoding import Transitions
from predplan.labelling.lexicon import Lexicon, WordClassifier
from predplan.labelling.loglinear import LogLinearEmissions
from predplan.labelling.models import FeatureHiddenMarkovModel
from predplan.labelling.tables import matrix_of, rows_of

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AnchorWord:
    """A word that stands for a tag: share of its labels that are the tag (1 from a dictionary alone), its counts."""

    tag: str
    word: str
    purity: float
    labelled: int
    count: int


def _weights(meaning: str) -> Column:
    return Column("weights", pa.list_(pa.float32()), "nat", f"{meaning}, by tag")


_WORD = Column("word", pa.string(), "1", "word")
LEXICON = TableSchema(
    "tagger lexicon",
    "fit",
    (
        _WORD,
        Column("count", pa.int64(), "occurrences", "times the word occurs in the raw text"),
        Column("labelled", pa.int64(), "occurrences", "times the word is labelled"),
        Column("probability", pa.list_(pa.float32()), "1", "p(tag | word), by tag"),
        Column("contexts", pa.list_(pa.float32()), "1", "evidence of its contexts, by tag; empty where not needed"),
    ),
    "predplan label",
)
CLASSIFIER = TableSchema(
    "tagger classifier",
    "fit",
    (
        Column(
            "feature",
            pa.string(),
            "1",
            "feature of a word's spelling; null for a measurement of contexts",
            nullable=True,
        ),
        _weights("log odds"),
    ),
    "predplan label",
)
TRANSITIONS = TableSchema(
    "tagger transitions",
    "fit",
    (
        Column("previous", pa.string(), "1", "previous tag; null for the start of a sentence", nullable=True),
        Column("next", pa.string(), "1", "next tag; null for the end of a sentence", nullable=True),
        Column("value", pa.float64(), "1", "p(next | previous); of a conditional random field a potential"),
    ),
    "predplan label",
)
ANCHORS = TableSchema(
    "tagger anchors",
    "fit",
    (
        Column("tag", pa.string(), "1", "tag the word stands for"),
        _WORD,
        Column("purity", pa.float64(), "1", "share of the word's labels that are this tag; 1 from a dictionary alone"),
        Column("labelled", pa.int64(), "occurrences", "times the word is labelled"),
        Column("count", pa.int64(), "occurrences", "times the word occurs in the raw text"),
    ),
    "predplan label",
)
EMISSIONS = TableSchema(
    "tagger emissions",
    "fit",
    (Column("feature", pa.string(), "1", "feature of a word"), _weights("theta of Eq. 3.2")),
    "predplan label",
)
CHAIN = TableSchema(
    "tagger chain",
    "fit",
    (
        Column("offset", pa.int8(), "words", "place of the described word, from the token whose tag it speaks for"),
        Column("feature", pa.string(), "1", "feature of the word"),
        _weights("log potential"),
    ),
    "predplan label",
)


def file_of(schema: TableSchema) -> str:
    """The name of a table's file in a model's folder."""
    return f"{schema.name.removeprefix('tagger ')}.parquet"


def lexicon_rows(lexicon: Lexicon, labels: Mapping[str, int]) -> Mapping[str, Any]:
    """Rows of the lexicon; labels: how often each word is labelled."""
    return {
        "word": list(lexicon.word_ids),
        "count": lexicon.count,
        "labelled": [labels.get(word, 0) for word in lexicon.word_ids],
        "probability": rows_of(lexicon.probabilities),
        "contexts": rows_of(lexicon.contexts),
    }


def classifier_rows(classifier: WordClassifier) -> Mapping[str, Any]:
    """Rows of the classifier: features of spelling that have a weight, then evidence."""
    names, spelling = _weighted(classifier.columns, classifier.spelling)
    return {
        "feature": names + [None] * len(classifier.evidence),
        "weights": rows_of(np.vstack([spelling, classifier.evidence])),
    }


def transition_rows(transitions: Transitions, tags: Sequence[str]) -> Mapping[str, Any]:
    """Rows of the transitions: from the start, between tags, to the end."""
    rows = [
        *((None, tag, value) for tag, value in zip(tags, transitions.start.tolist(), strict=True)),
        *(
            (previous, tag, value)
            for previous, values in zip(tags, transitions.between.tolist(), strict=True)
            for tag, value in zip(tags, values, strict=True)
        ),
        *((tag, None, value) for tag, value in zip(tags, transitions.stop.tolist(), strict=True)),
    ]
    return dict(zip(("previous", "next", "value"), zip(*rows, strict=True), strict=True))


def anchor_rows(anchors: Sequence[AnchorWord]) -> Mapping[str, Any]:
    """Rows of the anchors."""
    return {name: [getattr(anchor, name) for anchor in anchors] for name in ANCHORS.arrow.names}


def emission_rows(model: FeatureHiddenMarkovModel) -> Mapping[str, Any]:
    """Rows of log-linear weights that are not all zero."""
    names, weights = _weighted(model.columns, model.emissions.weights)
    return {"feature": names, "weights": rows_of(weights)}


def chain_rows(chain: ChainWeights) -> Mapping[str, Any]:
    """Rows of a field's weights that are not all zero, by offset."""
    parts = [_weighted(chain.columns, weights) for weights in chain.weights]
    return {
        "offset": [offset for offset, (names, _) in zip(OFFSETS, parts, strict=True) for _ in names],
        "feature": [name for names, _ in parts for name in names],
        "weights": rows_of(np.vstack([weights for _, weights in parts])),
    }


@dataclass(frozen=True)
class ModelTables:
    """The tables in a model's folder, for K tags."""

    folder: Path
    tags: tuple[str, ...]

    def lexicon(self, tag_probability: Floats) -> tuple[Lexicon, Mapping[str, int]]:
        """The lexicon with its classifier, and how often each labelled word is labelled."""
        table, weights = self._read(LEXICON), self._read(CLASSIFIER)
        words, labelled = table["word"].to_pylist(), table["labelled"].to_pylist()
        features, values = weights["feature"].to_pylist(), self._matrix(weights["weights"])
        spelling = len(features) - features.count(None)
        classifier = WordClassifier(_numbered(features[:spelling]), values[:spelling], values[spelling:])
        lexicon = Lexicon(
            _numbered(words),
            table["count"].to_numpy(),
            self._matrix(table["probability"]),
            self._contexts(table["contexts"]),
            tag_probability,
            classifier,
        )
        return lexicon, {word: times for word, times in zip(words, labelled, strict=True) if times}

    def transitions(self) -> Transitions:
        """Transitions; ValueError where a pair is unknown or missing."""
        table = self._read(TRANSITIONS)
        number: dict[str | None, int] = {None: len(self.tags)}
        number.update(_numbered(self.tags))
        values = np.full((len(number), len(number)), np.nan)
        values[-1, -1] = 0.0
        for previous, following, value in zip(*(table[name].to_pylist() for name in table.column_names), strict=True):
            values[number[previous], number[following]] = value
        if np.isnan(values).any():
            raise ValueError(f"{file_of(TRANSITIONS)}: a pair of tags is missing")
        return Transitions(values[-1, :-1].copy(), values[:-1, :-1].copy(), values[:-1, -1].copy())

    def anchors(self) -> tuple[AnchorWord, ...]:
        """The anchor words."""
        return tuple(AnchorWord(**row) for row in self._read(ANCHORS).to_pylist())

    def feature_model(self, transitions: Transitions, log_normaliser: Floats) -> FeatureHiddenMarkovModel:
        """The feature hidden Markov model."""
        table = self._read(EMISSIONS)
        emissions = LogLinearEmissions(self._matrix(table["weights"]), log_normaliser)
        return FeatureHiddenMarkovModel(_numbered(table["feature"].to_pylist()), emissions, transitions)

    def chain(self, transitions: Transitions) -> ChainWeights:
        """The conditional random field's weights."""
        table = self._read(CHAIN)
        offsets, names = table["offset"].to_pylist(), table["feature"].to_pylist()
        columns = _numbered(sorted(set(names)))
        weights = np.zeros((len(OFFSETS), len(columns), len(self.tags)))
        weights[[OFFSETS.index(offset) for offset in offsets], [columns[name] for name in names]] = self._matrix(
            table["weights"]
        )
        return ChainWeights(columns, weights, transitions)

    def _read(self, schema: TableSchema) -> pa.Table:
        return read_table(self.folder / file_of(schema), schema)

    def _contexts(self, column: pa.ChunkedArray) -> Floats:
        width = len(column[0]) if len(column) else 0
        return matrix_of(column, width) if width else np.zeros((len(column), 0))

    def _matrix(self, column: pa.ChunkedArray) -> Floats:
        """matrix_of, with ValueError where lists are not as long as there are tags."""
        if (np.asarray(pc.list_value_length(column)) != len(self.tags)).any():
            raise ValueError(f"a list is not of {len(self.tags)} values, one a tag")
        return matrix_of(column, len(self.tags))


def _weighted(columns: Mapping[str, int], weights: Floats) -> tuple[list[str], Floats]:
    """Names and weights [n, K] of the features that have a weight other than zero."""
    kept = [name for name, column in columns.items() if weights[column].any()]
    return kept, weights[[columns[name] for name in kept]]


def _numbered(names: Sequence[str]) -> dict[str, int]:
    return {name: place for place, name in enumerate(names)}
