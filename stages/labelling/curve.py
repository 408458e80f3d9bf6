"""Tag the test sentences after training on ever more labelled sentences (Figure 3.3): predictions-curve.parquet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from predplan.labelling.lexicon import build_lexicon
from predplan.labelling.models import HiddenMarkovModel, SequenceModel
from predplan.labelling.supervised import (
    BaselineSettings,
    supervised_chain_model,
    supervised_feature_model,
    supervised_model,
)
from predplan.labelling.training import (
    RawStatistics,
    TrainingSettings,
    learn_evidence,
    train_chain_model,
    train_feature_model,
)
from predplan.labelling.transitions import counted_transitions
from predplan.parallel import run
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import TrainingSet, read_statistics, read_tags, training_sets
from stages.labelling.trained import Predicted, Sentences, Trained, predict, write_predicted


@dataclass(frozen=True)
class CurveInputs:
    """What every point of the curves shares."""

    raw: RawStatistics
    sentences: Sentences
    tags: tuple[str, ...]
    training: TrainingSettings
    baselines: BaselineSettings
    seed: int


def main(stage: CorpusStage) -> None:
    labelling = stage.settings.labelling
    names = ("train.parquet", "dictionary.parquet", "bigrams.parquet", "test_words.parquet")
    provenance = stage.provenance(*map(stage.path, names), training=labelling.training, baselines=labelling.baselines)
    inputs = CurveInputs(
        read_statistics(stage),
        Sentences.read(stage),
        read_tags(stage),
        labelling.training,
        labelling.baselines,
        labelling.seed,
    )
    sets = [drawn for drawn in training_sets(stage, stage.corpus.curve) if drawn.has_all(inputs.tags)]
    work = partial(point, inputs=inputs)
    points = run(work, sets, workers=stage.settings.workers, scheduler=stage.settings.scheduler)
    write_predicted(stage, "curve", provenance, (predicted for found in points for predicted in found))


def point(drawn: TrainingSet, inputs: CurveInputs) -> list[Predicted]:
    """What each method, trained on one training set, predicts."""
    return [
        predict(drawn.name, Trained(name, model, 0.0), inputs.sentences, inputs.tags)
        for name, model in models(drawn, inputs)
    ]


def models(drawn: TrainingSet, inputs: CurveInputs) -> Iterator[tuple[str, SequenceModel]]:
    """The methods of the curves."""
    tags, training, known = inputs.tags, inputs.training, drawn.supervision
    yield "supervised", supervised_model(drawn.corpus, tags, inputs.baselines)
    yield "supervised-fhmm", supervised_feature_model(drawn.corpus, tags, inputs.baselines)
    yield "crf", supervised_chain_model(drawn.corpus, tags, inputs.baselines.chain)
    _, _, evidence = learn_evidence(inputs.raw, known, tags, training, inputs.seed)
    lexicon, transitions = (
        build_lexicon(known, evidence, tags, training.lexicon),
        counted_transitions(drawn.corpus, tags),
    )
    yield "anchor", HiddenMarkovModel(lexicon, transitions)
    words, probabilities = list(lexicon.word_ids), lexicon.probabilities
    yield "anchor-fhmm", train_feature_model(words, lexicon.count, probabilities, transitions, training)
    yield (
        "crf-posteriors",
        train_chain_model(drawn.corpus, known.dictionary, lexicon, evidence, {}, tags, training, inputs.seed),
    )


if __name__ == "__main__":
    run_stage(CorpusStage, main)
