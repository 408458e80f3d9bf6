"""Tag the test sentences with every training set's anchor models: predictions-anchor.parquet, costs-anchor.parquet."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from predplan.artifacts.tables import read_table
from predplan.labelling.decoding import Transitions
from predplan.labelling.methods import AnchorInputs, anchor_models
from predplan.labelling.models import SequenceModel
from predplan.labelling.tables import ANCHORS, TRANSITIONS
from predplan.labelling.training import RawStatistics
from stages.common import CorpusStage, run_stage
from stages.labelling.emissions import anchor_matrix
from stages.labelling.subsets import TrainingSet, read_evidence, read_statistics, read_tags, training_sets
from stages.labelling.trained import Sentences, Trained, emission_seconds, predict, write_predicted

CALIBRATED = ("anchor", "anchor-fhmm")


def main(stage: CorpusStage) -> None:
    names = ("anchors.parquet", "posteriors.parquet", "transitions.parquet", "bigrams.parquet", "test_words.parquet")
    provenance = stage.provenance(*map(stage.path, names), training=stage.settings.labelling.training)
    raw, tags, sentences = read_statistics(stage), read_tags(stage), Sentences.read(stage)
    seconds = emission_seconds(stage)
    predicted = (
        predict(drawn.name, trained, sentences, tags)
        for drawn in training_sets(stage, stage.corpus.sizes)
        for trained in timed(anchor_models(read_inputs(stage, drawn, raw, tags)), seconds[drawn.name])
    )
    write_predicted(stage, "anchor", provenance, predicted)


def read_inputs(stage: CorpusStage, drawn: TrainingSet, raw: RawStatistics, tags: tuple[str, ...]) -> AnchorInputs:
    """What the stages before left for one training set."""
    settings = stage.settings.labelling.training
    anchors = anchor_matrix(read_table(stage.path("anchors.parquet"), ANCHORS), drawn.name, raw, tags)
    _, lexicon = read_evidence(stage, drawn, raw, tags)
    table = read_table(stage.path("transitions.parquet"), TRANSITIONS)
    counted, composite = (read_transitions(table, drawn.name, method, tags) for method in ("counts", "composite"))
    return AnchorInputs(raw, tags, drawn.supervision, anchors, lexicon, counted, composite, settings)


def read_transitions(table: pa.Table, subset: str, method: str, tags: tuple[str, ...]) -> Transitions:
    """Transitions of one training set and method from their table."""
    chosen = table.filter(pc.and_(pc.equal(table["subset"], subset), pc.equal(table["method"], method)))
    square = chosen["probability"].to_numpy().reshape(len(tags) + 1, len(tags) + 1)
    return Transitions(
        np.ascontiguousarray(square[0, :-1]), np.ascontiguousarray(square[1:, :-1]), square[1:, -1].copy()
    )


def timed(models: Iterator[tuple[str, SequenceModel]], emissions_s: float) -> Iterator[Trained]:
    """Each model as it comes, with the seconds its making took; ours stand on the emissions stage's work too."""
    start = time.perf_counter()
    for name, model in models:
        before = emissions_s if name in CALIBRATED else 0.0
        yield Trained(name, model, before + time.perf_counter() - start)
        start = time.perf_counter()


if __name__ == "__main__":
    run_stage(CorpusStage, main)
