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
        scores = score(corpus, _complete(guesses), known, tags)
        _check_words(guesses, corpus)
    except InputError as error:
        raise InputError(f"{predicted} against {gold}: {error}") from error
    return scores


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


def _complete(guesses: LabelledCorpus) -> list[list[str]]:
    """The predicted tags, every one of them."""
    for place, (words, tags) in enumerate(zip(guesses.words, guesses.tags, strict=True), 1):
        if None in tags:
            raise InputError(f"sentence {place}: the word {words[tags.index(None)]!r} is predicted without a tag")
    return [[tag for tag in tags if tag is not None] for tags in guesses.tags]


def _check_words(guesses: LabelledCorpus, gold: LabelledCorpus) -> None:
    for place, (found, expected) in enumerate(zip(guesses.words, gold.words, strict=True), 1):
        for word, other in zip(found, expected, strict=True):
            if word != other:
                raise InputError(f"sentence {place}: found the predicted word {word!r}, expected {other!r}")
