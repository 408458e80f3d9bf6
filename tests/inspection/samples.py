"""Small artifacts of every kind that has a page of its own, with words that are hard to show."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import TableSchema, write_table
from predplan.labelling.tables import (
    ANCHORS,
    BIGRAMS,
    CONFUSION,
    CURVE,
    POSTERIORS,
    SCORES,
    TAG_NAMES,
    TAGGED,
    TRANSITIONS,
    WORDS,
    rows_of,
)

PROVENANCE = Provenance({"corpus": "tiny", "training": {"loss": "kl"}}, seed=3, upstream={"raw.gz": "ab" * 32})
TAGS = ("NOUN", "VERB", ".")
VOCABULARY = ("the", "|*_`", "》😂", "$x$", "run", "\ufe0f", "a" * 40, "işçi", ".")
SETS = ("5-0", "5-1", "all")
METHODS = ("supervised", "anchor", "crf-clusters-posteriors")


def write_sample(folder: Path, name: str) -> Path:
    """The table of that name, and what belongs to it, in the folder."""
    for schema, rows in _BESIDE.get(name, ()):
        write_table(folder / f"{schema.name}.parquet", schema, rows(), PROVENANCE)
    schema, rows = _SAMPLES[name]
    write_table(folder / f"{name}.parquet", schema, rows(), PROVENANCE)
    return folder / f"{name}.parquet"


def write_empty(folder: Path, name: str) -> Path:
    """The table of that name without rows."""
    schema, _ = _SAMPLES[name]
    write_table(folder / f"{name}.parquet", schema, schema.arrow.empty_table(), PROVENANCE)
    return folder / f"{name}.parquet"


def _words() -> Mapping[str, Any]:
    return {"word": list(VOCABULARY), "count": [1000 // rank for rank in range(1, len(VOCABULARY) + 1)]}


def _bigrams() -> Mapping[str, Any]:
    counts = np.random.default_rng(0).poisson(3.0, (len(VOCABULARY) + 1,) * 2)
    previous, following = np.nonzero(counts)
    return {"previous": previous, "next": following, "n": counts[previous, following]}


def _anchors() -> Mapping[str, Any]:
    rows = [
        (subset, tag, VOCABULARY[at], 1.0 - 0.1 * at, 4, 1000 // (at + 1), 4 - at, 500, 0.7)
        for subset in SETS
        for at, tag in enumerate(TAGS)
    ]
    return _columns(ANCHORS, rows)


def _posteriors() -> Mapping[str, Any]:
    shares = np.random.default_rng(1).dirichlet(np.ones(len(TAGS)), (2, len(SETS) * len(VOCABULARY)))
    return {
        "subset": np.repeat(SETS, len(VOCABULARY)),
        "word": list(VOCABULARY) * len(SETS),
        "count": [1000 // rank for rank in range(1, len(VOCABULARY) + 1)] * len(SETS),
        "gamma": rows_of(shares[0]),
        "log_ratio": rows_of(np.log(shares[0])),
        "residual": np.zeros(len(SETS) * len(VOCABULARY)),
        "probability": rows_of(shares[1]),
    }


def _transitions() -> Mapping[str, Any]:
    rows = [
        (subset, method, previous, following, 1 / 4)
        for subset in SETS
        for method in ("counts", "composite")
        for previous in ("start", *TAGS)
        for following in (*TAGS, "stop")
    ]
    return _columns(TRANSITIONS, rows)


def _confusion() -> Mapping[str, Any]:
    rows = [
        (subset, method, gold, given, 50 if gold == given else 2)
        for subset in SETS
        for method in METHODS
        for gold in TAGS
        for given in TAGS[:2]
    ]
    return _columns(CONFUSION, rows)


def _tagged() -> Mapping[str, Any]:
    words, gold = VOCABULARY[:4], ("NOUN", "VERB", "NOUN", ".")
    rows = [
        (subset, method, words, gold, gold if method == "anchor" else (*gold[:3], "VERB"))
        for subset in SETS
        for method in METHODS
        for _ in range(2)
    ]
    return _columns(TAGGED, rows)


def _curve() -> Mapping[str, Any]:
    rows = [
        (method, size, draw, 0.5 + size / 1000 + draw / 100)
        for method in METHODS
        for size in (20, 50)
        for draw in (0, 1)
    ]
    return _columns(CURVE, rows)


def _scores() -> Mapping[str, Any]:
    return _columns(SCORES, [("5-0", method, 0.9, 0.88, 0.92, None, 0.4, 1234) for method in METHODS])


def _tag_names() -> Mapping[str, Any]:
    return {"tag": list(TAGS)}


def _columns(schema: TableSchema, rows: Sequence[Sequence[Any]]) -> Mapping[str, Any]:
    return dict(zip(schema.arrow.names, (list(column) for column in zip(*rows, strict=True)), strict=True))


_SAMPLES = {
    "words": (WORDS, _words),
    "bigrams": (BIGRAMS, _bigrams),
    "anchors": (ANCHORS, _anchors),
    "posteriors": (POSTERIORS, _posteriors),
    "transitions": (TRANSITIONS, _transitions),
    "confusion": (CONFUSION, _confusion),
    "tagged": (TAGGED, _tagged),
    "curve": (CURVE, _curve),
    "scores": (SCORES, _scores),
}
_BESIDE = {"words": [(BIGRAMS, _bigrams)], "bigrams": [(WORDS, _words)], "posteriors": [(TAG_NAMES, _tag_names)]}
