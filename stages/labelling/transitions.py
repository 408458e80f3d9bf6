"""Transition probabilities of every training set (section 3.3.5), by smoothed counts and by composite likelihood."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from predplan.artifacts.tables import open_writer, read_table
from predplan.labelling.decoding import Transitions
from predplan.labelling.tables import POSTERIORS, TRANSITIONS, matrix_of, read_bigrams
from predplan.labelling.transitions import composite_likelihood, counted_transitions
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import read_tags, training_sets


def main(stage: CorpusStage) -> None:
    tags, settings = read_tags(stage), stage.settings.labelling
    inputs = [stage.path(name) for name in ("train.parquet", "posteriors.parquet", "bigrams.parquet")]
    provenance = stage.provenance(*inputs, iterations=settings.composite_iterations)
    posteriors = read_table(stage.path("posteriors.parquet"), POSTERIORS)
    counts = read_bigrams(stage.path("words.parquet"), stage.path("bigrams.parquet"))
    place = {word: row for row, word in enumerate(counts.vocabulary)}
    with open_writer(stage.path("transitions.parquet"), TRANSITIONS, provenance) as write:
        for drawn in training_sets(stage, stage.corpus.sizes):
            rows = posteriors.filter(pc.equal(posteriors["subset"], drawn.name))
            # Words left out of the table are rare: each gets the tags' overall share.
            joint = np.zeros((len(place), len(tags)))
            joint[:] = matrix_of(rows["probability"], len(tags)).mean(axis=0)
            joint[[place[word] for word in rows["word"].to_pylist()]] = matrix_of(rows["probability"], len(tags))
            joint *= counts.count[:, None]
            uniform = np.ones((len(tags) + 1, len(tags) + 1))
            composite, _ = composite_likelihood(
                counts.bigrams, joint / joint.sum(axis=0), uniform, settings.composite_iterations
            )
            write(transition_rows(drawn.name, "counts", tags, counted_transitions(drawn.corpus, tags)))
            write(transition_rows(drawn.name, "composite", tags, composite))


def transition_rows(subset: str, method: str, tags: tuple[str, ...], transitions: Transitions) -> pa.Table:
    """Rows of the transitions table for one training set and method."""
    table = np.vstack([transitions.start, transitions.between])
    stop = np.concatenate([[0.0], transitions.stop])
    names, size = ("start", *tags), len(tags) + 1
    return pa.table(
        {
            "subset": pa.repeat(subset, size * size),
            "method": pa.repeat(method, size * size),
            "previous": [name for name in names for _ in range(size)],
            "next": [*tags, "stop"] * size,
            "probability": np.hstack([table, stop[:, None]]).ravel(),
        }
    )


if __name__ == "__main__":
    run_stage(CorpusStage, main)
