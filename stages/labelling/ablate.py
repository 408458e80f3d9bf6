"""Turn each knob of the anchor HMM by itself and measure accuracy on the development sentences: ablations.parquet."""

from __future__ import annotations

from functools import partial

import pyarrow as pa

from predplan.artifacts.tables import write_table
from predplan.labelling.ablations import Variation, variations
from predplan.labelling.counting import BigramCounts
from predplan.labelling.lexicon import build_lexicon
from predplan.labelling.models import HiddenMarkovModel
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.tables import ABLATIONS, read_bigrams, read_corpus
from predplan.labelling.training import learn_evidence, raw_statistics
from predplan.labelling.transitions import counted_transitions
from predplan.parallel import run
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import TrainingSet, read_tags, training_sets
from stages.labelling.trained import dev_accuracy


def main(stage: CorpusStage) -> None:
    labelling = stage.settings.labelling
    names = ("train.parquet", "dev.parquet", "bigrams.parquet")
    provenance = stage.provenance(*map(stage.path, names), training=labelling.training)
    bigrams = read_bigrams(stage.path("words.parquet"), stage.path("bigrams.parquet"))
    drawn = training_sets(stage, stage.corpus.sizes[:1])
    work = partial(
        measure,
        bigrams=bigrams,
        sets=drawn,
        dev=read_corpus(stage.path("dev.parquet")),
        tags=read_tags(stage),
        seed=labelling.seed,
    )
    found = run(
        work,
        variations(labelling.training, labelling.ablations),
        workers=stage.settings.workers,
        scheduler=stage.settings.scheduler,
    )
    rows = [row for measured in found for row in measured]
    write_table(stage.path("ablations.parquet"), ABLATIONS, pa.Table.from_pylist(rows), provenance)


def measure(
    variation: Variation,
    bigrams: BigramCounts,
    sets: list[TrainingSet],
    dev: LabelledCorpus,
    tags: tuple[str, ...],
    seed: int,
) -> list[dict[str, object]]:
    """Rows of the ablations table for one variation, one a training set."""
    settings, rows = variation.settings, []
    raw = raw_statistics(bigrams, settings.moments, seed)
    for drawn in sets:
        _, _, evidence = learn_evidence(raw, drawn.supervision, tags, settings, seed)
        lexicon = build_lexicon(drawn.supervision, evidence, tags, settings.lexicon)
        model = HiddenMarkovModel(lexicon, counted_transitions(drawn.corpus, tags))
        rows.append(
            {
                "subset": drawn.name,
                "component": variation.component,
                "setting": variation.setting,
                "default": variation.default,
                "dev_accuracy": dev_accuracy(model, dev, tags),
            }
        )
    return rows


if __name__ == "__main__":
    run_stage(CorpusStage, main)
