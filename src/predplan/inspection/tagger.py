"""The page of a saved tagger: what it knows of tags, words and features."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.inspection.figures import Panel, Scale, heat_maps
from predplan.inspection.labelling import choose_words, percent
from predplan.inspection.markdown import about, escape, markdown_table
from predplan.inspection.palette import DIVERGING
from predplan.inspection.recording import Page, log_picture, log_text, picture_view, text_view
from predplan.labelling.models import ChainModel, FeatureHiddenMarkovModel
from predplan.labelling.storage import TrainedTagger, load

Floats = NDArray[np.float64]

SHOWN_ANCHORS, SHOWN_FEATURES = 8, 7


def draw_tagger(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Tabs of words, transitions, anchors and features. Raises InputError as `storage.load` does."""
    trained = load(artifact)
    log_picture(recording, "words", _words(trained))
    log_picture(recording, "transitions", _transitions(trained))
    log_text(recording, "anchors", _anchors(trained))
    log_text(recording, "features", _features(trained))
    kinds = {
        "hmm": "hidden Markov model",
        "fhmm": "feature hidden Markov model",
        "crf": "conditional random field on the posteriors of words",
    }
    text = (
        f"A saved tagger, a {kinds[trained.kind]}. It knows the tags of words it has met (Words), which tag follows "
        "which (Transitions), and judges any other word by its spelling (Features). All of it was learned from the "
        "anchors, words that stand for one tag, and what surrounds them in raw text."
    )
    figures = (
        f"{len(trained.tags)} tags, {len(trained.lexicon.word_ids):,} words, of which {len(trained.labels):,} were "
        f"labelled, {len(trained.anchors):,} anchors."
    )
    return Page(
        f"{artifact.name}: {trained.kind} tagger",
        about(f"Tagger {artifact.name}", text, trained.provenance, figures),
        rrb.Tabs(
            picture_view("words", "Words"),
            picture_view("transitions", "Transitions"),
            text_view("anchors", "Anchors"),
            text_view("features", "Features"),
        ),
    )


def _words(trained: TrainedTagger) -> bytes:
    """p(tag | word) of chosen words."""
    lexicon = trained.lexicon
    falling = np.argsort(-lexicon.count, kind="stable")
    groups = choose_words(lexicon.count[falling], lexicon.probabilities[falling])
    chosen = falling[np.concatenate(list(groups.values()))] if groups else falling
    starts = np.cumsum([0, *map(len, groups.values())])[:-1].tolist()
    words = list(lexicon.word_ids)
    panel = Panel("tags of words, in percent", lexicon.probabilities[chosen])
    named, marks = [words[row] for row in chosen], list(zip(starts, groups, strict=True))
    return heat_maps(
        [panel], named, trained.tags, ("word", "tag"), Scale("p(tag | word)"), (10.0, 10.0), percent, marks
    )


def _transitions(trained: TrainedTagger) -> bytes:
    """p(next tag | tag), or the logarithms of a field's factors."""
    found = trained.model.transitions
    values = np.vstack(
        [np.append(found.start, np.nan), np.hstack([found.between, found.stop[:, None]])],
    )
    names, axes = (("start", *trained.tags), (*trained.tags, "stop")), ("previous tag", "next tag")
    if isinstance(trained.model, ChainModel):
        with np.errstate(divide="ignore"):
            panel = Panel("logarithms of the factors of neighbouring tags", np.log(values))
        scale = Scale("log factor [nat]", DIVERGING, None)
        return heat_maps([panel], *names, axes, scale, (9.6, 8.4), lambda value: f"{value:+.1f}")
    panel = Panel("which tag follows which, in percent", values)
    return heat_maps([panel], *names, axes, Scale("p(next | previous)"), (9.6, 8.4), percent)


def _anchors(trained: TrainedTagger) -> str:
    lines = []
    for tag in trained.tags:
        of_tag = sorted((a for a in trained.anchors if a.tag == tag), key=lambda anchor: -anchor.count)
        purity = f"{np.mean([anchor.purity for anchor in of_tag]):.2f}" if of_tag else "–"
        words = ", ".join(f"{escape(anchor.word)} ({anchor.count:,})" for anchor in of_tag[:SHOWN_ANCHORS])
        lines.append((escape(tag), f"{len(of_tag)}", purity, words))
    header = ("tag", "anchors", "mean purity", "most frequent, with raw counts")
    return f"## Anchors\n\n{markdown_table(header, lines, header[1:3])}"


def _features(trained: TrainedTagger) -> str:
    """The features that speak most for each tag."""
    model = trained.model
    if isinstance(model, FeatureHiddenMarkovModel):
        columns, weights = model.columns, model.emissions.weights
    elif isinstance(model, ChainModel):
        columns, weights = model.chain.columns, model.chain.weights[1]
    else:
        columns, weights = trained.lexicon.classifier.columns, trained.lexicon.classifier.spelling
    names, lines = {column: name for name, column in columns.items()}, []
    for tag, of_tag in zip(trained.tags, weights.T, strict=True):
        best = np.argsort(-of_tag, kind="stable")[:SHOWN_FEATURES]
        told = [f"{escape(names[column])} {of_tag[column]:+.1f}" for column in best if of_tag[column] > 0]
        lines.append((escape(tag), ", ".join(told)))
    return f"## Features that speak most for a tag\n\n{markdown_table(('tag', 'feature and weight [nat]'), lines)}"
