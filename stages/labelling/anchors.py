"""Choose anchor words for every training set (sections 3.3.2, 3.5): anchors.parquet and the tags, tags.parquet."""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa

from predplan.artifacts.tables import open_writer, write_table
from predplan.labelling.anchors import Anchors
from predplan.labelling.tables import ANCHORS, TAG_NAMES
from predplan.labelling.training import RawStatistics, find_anchors
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import TrainingSet, read_statistics, tag_names, training_sets


def main(stage: CorpusStage) -> None:
    raw, sets, settings = read_statistics(stage), training_sets(stage, stage.corpus.sizes), stage.settings.labelling
    tags = tag_names(sets)
    inputs = [stage.path(name) for name in ("train.parquet", "dictionary.parquet", "bigrams.parquet")]
    provenance = stage.provenance(*inputs, sizes=stage.corpus.sizes, anchors=settings.training.anchors)
    write_table(stage.path("tags.parquet"), TAG_NAMES, {"tag": list(tags)}, provenance)
    with open_writer(stage.path("anchors.parquet"), ANCHORS, provenance) as write:
        for drawn in sets:
            write(anchor_rows(drawn, raw, tags, find_anchors(raw, drawn.supervision, tags, settings.training.anchors)))


def anchor_rows(drawn: TrainingSet, raw: RawStatistics, tags: tuple[str, ...], anchors: Anchors) -> pa.Table:
    """Rows of the anchors table for one training set, by tag, most frequent word first."""
    rows = []
    for place, tag in enumerate(tags):
        limits = anchors.thresholds[place]
        for word_id in anchors.chosen[:, place].nonzero()[0].tolist():
            word = raw.moments.vocabulary[word_id]
            labels: Mapping[str, int] = drawn.supervision.labels.get(word, {})
            times = sum(labels.values())
            rows.append(
                {
                    "subset": drawn.name,
                    "tag": tag,
                    "word": word,
                    "purity": labels.get(tag, 0) / times if times else 1.0,
                    "labelled": times,
                    "count": int(raw.moments.word_count[word_id]),
                    "least_labelled": limits.labelled_count,
                    "least_count": limits.raw_count,
                    "least_purity": limits.purity,
                }
            )
    return pa.Table.from_pylist(rows)


if __name__ == "__main__":
    run_stage(CorpusStage, main)
