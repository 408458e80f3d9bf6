"""How the stages that train models leave what these predict: tags of the test sentences, and what each model cost."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyarrow as pa

from predplan.artifacts.files import read_json
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import open_writer, read_table, write_table
from predplan.labelling.models import SequenceModel, Tokens, decode
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.tables import COSTS, PREDICTIONS, UNTAGGED, prediction_rows, read_corpus
from stages.common import CorpusStage


@dataclass(frozen=True)
class Trained:
    """A model under its method's name, the seconds its training took, and what was chosen on dev, if anything."""

    method: str
    model: SequenceModel
    training_s: float
    chosen: str = ""


@dataclass(frozen=True)
class Sentences:
    """The development sentences with their tags, and the test sentences without."""

    dev: LabelledCorpus
    test: Tokens

    @classmethod
    def read(cls, stage: CorpusStage) -> Sentences:
        """From the corpus stage's tables."""
        words = read_table(stage.path("test_words.parquet"), UNTAGGED)["words"].to_pylist()
        return cls(read_corpus(stage.path("dev.parquet")), Tokens.of(words))


@dataclass(frozen=True)
class Predicted:
    """Rows of the predictions table from one trained model, and its row of the costs table."""

    rows: pa.Table
    cost: tuple[str, str, float, float, str]


def dev_accuracy(model: SequenceModel, dev: LabelledCorpus, tags: tuple[str, ...]) -> float:
    """Share of the labelled development words that the model tags right."""
    gold = [tag for sentence in dev.tags for tag in sentence]
    right = [tags[found] == tag for found, tag in zip(decode(model, Tokens.of(dev.words)), gold, strict=True) if tag]
    return float(np.mean(right))


def predict(subset: str, trained: Trained, sentences: Sentences, tags: tuple[str, ...]) -> Predicted:
    """Tag the test sentences with a model trained on `subset`."""
    found, offsets = decode(trained.model, sentences.test), sentences.test.offsets
    tagged = [[tags[t] for t in found[a:b]] for a, b in pairwise(offsets)]
    accuracy = dev_accuracy(trained.model, sentences.dev, tags)
    cost = (subset, trained.method, trained.training_s, accuracy, trained.chosen)
    return Predicted(prediction_rows(subset, trained.method, tagged), cost)


def write_predicted(stage: CorpusStage, kind: str, provenance: Provenance, predicted: Iterable[Predicted]) -> None:
    """Write both tables of one kind of methods as the models come; the files appear when all are done."""
    costs = []
    with open_writer(stage.path(f"predictions-{kind}.parquet"), PREDICTIONS, provenance) as write:
        for one in predicted:
            write(one.rows)
            costs.append(one.cost)
            subset, method, seconds, accuracy, _ = one.cost
            sys.stderr.write(f"{stage.name} {subset} {method}: {100 * accuracy:.1f} % on dev, {seconds:.1f} s\n")
    columns = {column.name: [cost[place] for cost in costs] for place, column in enumerate(COSTS.columns)}
    write_table(stage.path(f"costs-{kind}.parquet"), COSTS, columns, provenance)


def emission_seconds(stage: CorpusStage) -> dict[str, float]:
    """How long the emissions of each training set took."""
    seconds: dict[str, float] = read_json(stage.path("emissions.json"))["seconds"]
    return seconds
