"""A trained tagger as a folder of Parquet and JSON.

| file | holds |
|---|---|
| model.json | format, kind, style, tags, settings, provenance, and numbers by tag |
| lexicon.parquet | words: raw count, labels, p(tag given word), evidence of contexts |
| classifier.parquet | the word classifier's weights of spelling features and of evidence |
| transitions.parquet | p(next tag previous tag), or a field's potentials |
| anchors.parquet | anchor words of every tag |
| emissions.parquet | fhmm: log-linear weights |
| chain.parquet | crf: weights of each feature of the word before, here and after |

Weights are kept in single precision; a tagger rounds its own to that, so that one saved and loaded tags the same.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from predplan.artifacts.files import read_json, write_json
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import TableSchema, write_table
from predplan.errors import InputError
from predplan.labelling.lexicon import Lexicon
from predplan.labelling.model_tables import (
    ANCHORS,
    CHAIN,
    CLASSIFIER,
    EMISSIONS,
    LEXICON,
    TRANSITIONS,
    AnchorWord,
    ModelTables,
    anchor_rows,
    chain_rows,
    classifier_rows,
    emission_rows,
    file_of,
    lexicon_rows,
    transition_rows,
)
from predplan.labelling.models import ChainModel, FeatureHiddenMarkovModel, HiddenMarkovModel, SequenceModel
from predplan.labelling.readers import Style
from predplan.labelling.training import TrainingSettings

Floats = NDArray[np.float64]
ModelKind = Literal["hmm", "fhmm", "crf"]

HEADER = "model.json"
FORMAT = "predplan tagger"
VERSION = 1
REMEDY = "make it again: predplan label fit"


@dataclass(frozen=True)
class TrainedTagger:
    """All that a tagger has learned; labels: how often each labelled word is labelled."""

    kind: ModelKind
    style: Style
    tags: tuple[str, ...]
    settings: TrainingSettings
    provenance: Provenance
    lexicon: Lexicon
    labels: Mapping[str, int]
    anchors: tuple[AnchorWord, ...]
    model: SequenceModel


def save(trained: TrainedTagger, folder: Path) -> None:
    """Write the folder whole; raises InputError as `check_target` does."""
    with _whole_folder(folder) as temporary:
        header = {
            "format": FORMAT,
            "version": VERSION,
            "predplan": trained.provenance.version,
            "kind": trained.kind,
            "style": trained.style,
            "tags": list(trained.tags),
            "seed": trained.provenance.seed,
            **trained.provenance.params,
            "tag_probability": trained.lexicon.tag_probability.tolist(),
        }
        if isinstance(trained.model, FeatureHiddenMarkovModel):
            header["log_normaliser"] = trained.model.emissions.log_normaliser.tolist()
        write_json(temporary / "model.json", header)
        for schema, table in _tables(trained):
            write_table(temporary / file_of(schema), schema, table, trained.provenance)


def load(folder: Path) -> TrainedTagger:
    """The tagger in a folder.

    Raises InputError naming the file and the remedy where it is no model, another version's, or incomplete.
    """
    header = _read_header(folder)
    try:
        tags, kind = tuple(map(str, header["tags"])), header["kind"]
        reader = ModelTables(folder, tags)
        settings = _settings(TrainingSettings(), header["settings"])
        provenance = Provenance(
            {"settings": header["settings"], "data": header["data"]}, header["seed"], header["predplan"]
        )
        lexicon, labels = reader.lexicon(np.array(header["tag_probability"]))
        transitions = reader.transitions()
        if kind == "hmm":
            model: SequenceModel = HiddenMarkovModel(lexicon, transitions)
        elif kind == "fhmm":
            model = reader.feature_model(transitions, np.array(header["log_normaliser"]))
        elif kind == "crf":
            model = ChainModel(lexicon, {}, tags, reader.chain(transitions))
        else:
            raise ValueError(f"unknown kind {kind!r}")
        return TrainedTagger(
            kind, header["style"], tags, settings, provenance, lexicon, labels, reader.anchors(), model
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / HEADER}: broken ({type(error).__name__}: {error}); {REMEDY}") from error


def check_target(folder: Path) -> None:
    """Raises InputError where saving to `folder` would replace anything but a predplan model or an empty folder."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    try:
        found = read_json(folder / HEADER)
    except InputError:
        found = None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise InputError(f"{folder}: is there already and is no predplan model; name another folder, or remove it")


def in_single_precision(trained: TrainedTagger) -> TrainedTagger:
    """The tagger with weights rounded to what `save` keeps, and without evidence that its model does not look at."""
    classifier, contexts = trained.lexicon.classifier, trained.lexicon.contexts
    lexicon = replace(
        trained.lexicon,
        probabilities=_single(trained.lexicon.probabilities),
        contexts=_single(contexts if isinstance(trained.model, ChainModel) else contexts[:, :0]),
        classifier=replace(classifier, spelling=_single(classifier.spelling), evidence=_single(classifier.evidence)),
    )
    model = trained.model
    if isinstance(model, HiddenMarkovModel):
        model = replace(model, lexicon=lexicon)
    elif isinstance(model, ChainModel):
        model = replace(model, lexicon=lexicon, chain=replace(model.chain, weights=_single(model.chain.weights)))
    elif isinstance(model, FeatureHiddenMarkovModel):
        emissions = replace(model.emissions, weights=_single(model.emissions.weights))
        model = replace(model, emissions=emissions)
    return replace(trained, lexicon=lexicon, model=model)


def _tables(trained: TrainedTagger) -> Iterator[tuple[TableSchema, Mapping[str, Any]]]:
    yield LEXICON, lexicon_rows(trained.lexicon, trained.labels)
    yield CLASSIFIER, classifier_rows(trained.lexicon.classifier)
    yield TRANSITIONS, transition_rows(trained.model.transitions, trained.tags)
    yield ANCHORS, anchor_rows(trained.anchors)
    if isinstance(trained.model, FeatureHiddenMarkovModel):
        yield EMISSIONS, emission_rows(trained.model)
    elif isinstance(trained.model, ChainModel):
        yield CHAIN, chain_rows(trained.model.chain)


def _read_header(folder: Path) -> Mapping[str, Any]:
    path = folder / HEADER
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected a model that predplan label fit wrote")
    if not path.exists():
        raise InputError(f"{folder}: not a predplan model, or not a whole one: it has no {HEADER}; {REMEDY}")
    header = read_json(path)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise InputError(f"{path}: not the header of a predplan model; expected format {FORMAT!r}; {REMEDY}")
    if header.get("version") != VERSION:
        raise InputError(
            f"{path}: a model of format version {header.get('version')} (predplan {header.get('predplan')}), expected "
            f"{VERSION}; {REMEDY}"
        )
    return header


def _settings(defaults: Any, values: Mapping[str, Any]) -> Any:
    """The dataclass of `defaults` with plain values put back; raises TypeError for a name it does not have."""
    changed = {}
    for name, value in values.items():
        default = getattr(defaults, name, None)
        changed[name] = _settings(default, value) if is_dataclass(default) else value
    return replace(defaults, **changed)


@contextmanager
def _whole_folder(folder: Path) -> Iterator[Path]:
    """A new folder to write to; when the block ends without an error, it becomes `folder`."""
    check_target(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary, old = (folder.with_name(f".{os.getpid()}-{part}-{folder.name}") for part in ("new", "old"))
    temporary.mkdir()
    try:
        yield temporary
        if folder.exists():
            folder.rename(old)
        temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def _single(weights: Floats) -> Floats:
    return weights.astype(np.float32).astype(np.float64)
