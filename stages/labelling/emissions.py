"""Fit p(tag | word) of every word for each training set (section 3.3.4): posteriors.parquet, emissions.json."""

from __future__ import annotations

import time

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from predplan.artifacts.files import write_json
from predplan.artifacts.tables import open_writer, read_table
from predplan.labelling.lexicon import build_lexicon
from predplan.labelling.tables import ANCHORS, POSTERIORS, rows_of
from predplan.labelling.training import RawStatistics, gather_evidence, judge_contexts
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import read_statistics, read_tags, training_sets


def main(stage: CorpusStage) -> None:
    raw, tags, settings = read_statistics(stage), read_tags(stage), stage.settings.labelling
    inputs = [stage.path(name) for name in ("anchors.parquet", "bigrams.parquet")]
    provenance = stage.provenance(*inputs, training=settings.training)
    anchors = read_table(stage.path("anchors.parquet"), ANCHORS)
    seconds = {}
    with open_writer(stage.path("posteriors.parquet"), POSTERIORS, provenance) as write:
        for drawn in training_sets(stage, stage.corpus.sizes):
            chosen = anchor_matrix(anchors, drawn.name, raw, tags)
            training, start = settings.training, time.perf_counter()
            contexts = judge_contexts(raw, drawn.supervision, chosen, training, settings.seed)
            evidence = gather_evidence(raw, contexts)
            lexicon = build_lexicon(drawn.supervision, evidence, tags, training.lexicon)
            seconds[drawn.name] = time.perf_counter() - start
            known = [word for word in lexicon.word_ids if word in evidence.word_ids]
            ids = np.array([evidence.word_ids[word] for word in known])
            write(
                pa.table(
                    {
                        "subset": pa.repeat(drawn.name, len(known)),
                        "word": known,
                        "count": evidence.count[ids],
                        "gamma": rows_of(contexts.gamma[ids]),
                        "log_ratio": rows_of(contexts.log_ratio[ids]),
                        "residual": contexts.residual[ids],
                        "probability": rows_of(lexicon.of(known)),
                    }
                )
            )
    write_json(stage.path("emissions.json"), {"seconds": seconds})


def anchor_matrix(anchors: pa.Table, subset: str, raw: RawStatistics, tags: tuple[str, ...]) -> NDArray[np.bool_]:
    """Which words [V, K] are anchors of which tags in one training set."""
    chosen = np.zeros((len(raw.word_ids), len(tags)), np.bool_)
    for row in anchors.to_pylist():
        if row["subset"] == subset:
            chosen[raw.word_ids[row["word"]], tags.index(row["tag"])] = True
    return chosen


if __name__ == "__main__":
    run_stage(CorpusStage, main)
