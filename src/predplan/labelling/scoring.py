"""Scores of a saved model, or of a file of predicted tags, on a file of labelled sentences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from predplan.errors import InputError
from predplan.labelling.evaluation import Scores, score
from predplan.labelling.readers import read_labelled
from predplan.labelling.sentences import LabelledCorpus, label_counts
from predplan.labelling.tagger import AnchorTagger, tag_set


def score_model(model: Path, gold: Path) -> Scores:
    """Scores of the model in a folder. Raises InputError naming the file of gold tags where the model lacks one."""
    tagger, corpus = AnchorTagger.load(model), read_labelled(gold)
    try:
        return tagger.evaluate(corpus)
    except InputError as error:
        raise InputError(f"{gold}: {error}") from error


def score_predictions(predicted: Path, gold: Path) -> Scores:
    """Scores of predicted tags; no word counts as unknown. Raises InputError where the words are not the same."""
    corpus, guesses = read_labelled(gold), read_labelled(predicted)
    tags = tag_set(label_counts(corpus), label_counts(guesses))
    known = {word for words in corpus.words for word in words}
    try:
        return score(corpus, _complete(guesses, predicted), known, tags)
    except InputError as error:
        raise InputError(f"{predicted} against {gold}: {error}") from error


def as_plain_data(scores: Scores) -> dict[str, Any]:
    """Scores as JSON holds them; confusion by gold tag, then by predicted tag."""
    tags = [of.tag for of in scores.per_tag]
    rows = zip(tags, scores.confusion.tolist(), strict=True)
    return {
        "accuracy": scores.accuracy,
        "unknown_accuracy": scores.unknown_accuracy,
        "sentence_accuracy": scores.sentence_accuracy,
        "tokens": scores.tokens,
        "unknown_tokens": scores.unknown_tokens,
        "per_tag": {
            of.tag: {"precision": of.precision, "recall": of.recall, "f1": of.f1, "support": of.support}
            for of in scores.per_tag
        },
        "confusion": {tag: dict(zip(tags, row, strict=True)) for tag, row in rows},
    }


def _complete(guesses: LabelledCorpus, path: Path) -> list[list[str]]:
    """The predicted tags, every one of them."""
    tags = [[tag for tag in of if tag is not None] for of in guesses.tags]
    for place, (kept, words) in enumerate(zip(tags, guesses.words, strict=True), 1):
        if len(kept) != len(words):
            raise InputError(f"{path}: sentence {place} has a word without a tag, expected one for each")
    return tags
