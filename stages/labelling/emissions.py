"""Fit p(tag | word) of every word for each training set (section 3.3.4): posteriors.parquet."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from predplan.artifacts.tables import open_writer, read_table
from predplan.labelling.lexicon import build_lexicon
from predplan.labelling.posteriors import cross_fitted_posteriors
from predplan.labelling.tables import ANCHORS, POSTERIORS, rows_of
from predplan.labelling.training import RawStatistics, gather_evidence
from stages.common import CorpusStage, run_corpus_stage
from stages.labelling.subsets import read_statistics, read_tags, training_sets


def main(stage: CorpusStage) -> None:
    raw, tags, settings = read_statistics(stage), read_tags(stage), stage.settings.labelling
    inputs = [stage.path(name) for name in ("anchors.parquet", "bigrams.parquet")]
    provenance = stage.provenance(*inputs, training=settings.training)
    anchors = read_table(stage.path("anchors.parquet"), ANCHORS)
    with open_writer(stage.path("posteriors.parquet"), POSTERIORS, provenance) as write:
        for drawn in training_sets(stage, stage.corpus.sizes):
            chosen = anchor_matrix(anchors, drawn.name, raw, tags)
            rng = np.random.default_rng(settings.seed)
            training = settings.training
            contexts = cross_fitted_posteriors(raw.moments, chosen, training.posteriors, training.folds, rng)
            lexicon = build_lexicon(drawn.supervision, gather_evidence(raw, contexts), tags, training.lexicon)
            known = [word for word in lexicon.word_ids if word in raw.word_ids]
            ids = np.array([raw.word_ids[word] for word in known])
            write(
                pa.table(
                    {
                        "subset": pa.repeat(drawn.name, len(known)),
                        "word": known,
                        "count": raw.moments.word_count[ids],
                        "gamma": rows_of(contexts.gamma[ids]),
                        "log_ratio": rows_of(contexts.log_ratio[ids]),
                        "residual": contexts.residual[ids],
                        "probability": rows_of(lexicon.of(known)),
                    }
                )
            )


def anchor_matrix(anchors: pa.Table, subset: str, raw: RawStatistics, tags: tuple[str, ...]) -> np.ndarray:
    """Which words [V, K] are anchors of which tags in one training set."""
    chosen = np.zeros((len(raw.word_ids), len(tags)), np.bool_)
    for row in anchors.to_pylist():
        if row["subset"] == subset:
            chosen[raw.word_ids[row["word"]], tags.index(row["tag"])] = True
    return chosen


if __name__ == "__main__":
    run_corpus_stage(main)
