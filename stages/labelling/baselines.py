"""Train the baselines on every training set and tag the test sentences with them; iterations are chosen on dev."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from predplan.artifacts.tables import read_table
from predplan.labelling.expectations import RawTokens
from predplan.labelling.models import SequenceModel
from predplan.labelling.semisupervised import (
    Iteration,
    best_iteration,
    expectation_maximisation,
    feature_expectation_maximisation,
    feature_self_training,
    self_training,
)
from predplan.labelling.supervised import add_one_model, supervised_feature_model, supervised_model
from predplan.labelling.tables import VOCABULARY, open_token_batches
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import TrainingSet, read_tags, training_sets
from stages.labelling.trained import Sentences, Trained, dev_accuracy, predict, write_predicted


def main(stage: CorpusStage) -> None:
    names = ("train.parquet", "dev.parquet", "test_words.parquet", "tokens.parquet")
    baselines = stage.settings.labelling.baselines
    provenance = stage.provenance(*map(stage.path, names), baselines=baselines)
    tags, sentences = read_tags(stage), Sentences.read(stage)
    words = read_table(stage.path("vocabulary.parquet"), VOCABULARY)["word"].to_pylist()
    with open_token_batches(stage.path("tokens.parquet")) as batches:
        raw = RawTokens(words, list(batches))
    predicted = (
        predict(drawn.name, trained, sentences, tags)
        for drawn in training_sets(stage, stage.corpus.sizes)
        for trained in train(stage, drawn, raw, tags, sentences)
    )
    write_predicted(stage, "baselines", provenance, predicted)


def train(
    stage: CorpusStage, drawn: TrainingSet, raw: RawTokens, tags: tuple[str, ...], sentences: Sentences
) -> Iterator[Trained]:
    """Every baseline on one training set."""
    settings, most = stage.settings.labelling.baselines, stage.settings.labelling.iterations
    corpus = drawn.corpus

    def chosen(name: str, passes: Iterator[Iteration[SequenceModel]], limit: int) -> Trained:
        start = time.perf_counter()
        model, scores = best_iteration(passes, lambda model: dev_accuracy(model, sentences.dev, tags), limit)
        return Trained(
            name, model, time.perf_counter() - start, f"pass {scores.index(max(scores))} of {len(scores) - 1}"
        )

    def once(name: str, make: Callable[[], SequenceModel]) -> Trained:
        start = time.perf_counter()
        model = make()
        return Trained(name, model, time.perf_counter() - start)

    yield once("supervised-addone", lambda: add_one_model(corpus, tags))
    yield once("supervised", lambda: supervised_model(corpus, tags, settings))
    yield once("supervised-fhmm", lambda: supervised_feature_model(corpus, tags, settings))
    yield chosen("em", expectation_maximisation(corpus, raw, tags, settings), most)
    yield chosen("self-training", self_training(corpus, raw, tags, settings), most)
    feature_passes = stage.settings.labelling.feature_iterations
    yield chosen("em-fhmm", feature_expectation_maximisation(corpus, raw, tags, settings), feature_passes)
    yield chosen("self-training-fhmm", feature_self_training(corpus, raw, tags, settings), feature_passes)


if __name__ == "__main__":
    run_stage(CorpusStage, main)
