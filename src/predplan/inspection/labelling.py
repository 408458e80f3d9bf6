"""Pages of what the labelling branch learns from: moments, anchors, posteriors, transitions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_provenance, read_table
from predplan.inspection.figures import Panel, Scale, heat_maps
from predplan.inspection.markdown import about, escape, markdown_table
from predplan.inspection.plots import anchor_plot, residual_plot
from predplan.inspection.recording import (
    Page,
    log_picture,
    log_pictures,
    log_texts,
    picture_view,
    text_view,
)
from predplan.labelling.tables import ANCHORS, POSTERIORS, TAG_NAMES, TRANSITIONS, matrix_of

Floats = NDArray[np.float64]

SETS = "training_set"
SHOWN_ANCHORS = 8
FREQUENT, MIDDLING, AMBIGUOUS = 14, 10, 14


def draw_anchors(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Anchor words of each tag with purity and frequency, a step of the timeline for each training set."""
    table, provenance = read_table(artifact, ANCHORS), read_provenance(artifact)
    sets = subsets(table)
    log_pictures(recording, "anchors", SETS, [anchor_plot(rows, set_title(name)) for name, rows in sets.items()])
    texts = [f"## {set_title(name)}\n\n{_anchor_table(rows, provenance)}" for name, rows in sets.items()]
    log_texts(recording, "top", SETS, texts)
    text = (
        "An anchor is a word that stands for one tag; what surrounds the anchors of a tag tells what surrounds the "
        "tag. Each dot is one: the further right the more often it occurs in raw text, the brighter the purer its "
        "labels, and the line is the count its tag had to reach. Thresholds that had to be relaxed, because a tag had "
        "no anchor, are **bold** in the table."
    )
    return Page(
        f"{corpus_of(provenance)}: anchors",
        about("Anchor words", text, provenance, timeline_of(sets)),
        picture_view("anchors", "Anchors of each tag"),
        text_view("top", "Most frequent anchors"),
        timeline=SETS,
    )


def draw_posteriors(recording: rr.RecordingStream, artifact: Path) -> Page:
    """p(tag | word) of chosen words, from contexts alone and with labels, a step for each training set."""
    table, provenance = read_table(artifact, POSTERIORS), read_provenance(artifact)
    tags = read_table(artifact.with_name("tags.parquet"), TAG_NAMES)["tag"].to_pylist()
    sets = subsets(table)
    pictures, texts = [], []
    for name, rows in sets.items():
        before, after = matrix_of(rows["gamma"], len(tags)), matrix_of(rows["probability"], len(tags))
        groups = choose_words(rows["count"].to_numpy(), before)
        pictures.append(posterior_picture(rows["word"].to_pylist(), tags, (before, after), groups))
        changed = _changed_words(rows, tags, before, after)
        texts.append(f"## {set_title(name)}\n\nFrequent words that labels and spelling change most:\n\n{changed}")
    log_pictures(recording, "posteriors", SETS, pictures)
    log_texts(recording, "changed", SETS, texts)
    log_picture(recording, "residuals", residual_plot(table["residual"].to_numpy()))
    text = (
        "What is known of a word's tags: on the left from anchors and contexts alone (γ), on the right with its labels "
        "and its spelling. A row is a word and sums to 100 %: one bright cell is a word of one tag, several are a word "
        "that needs its sentence. The words are the most frequent, some of middling frequency, and those least certain "
        "by context."
    )
    worst = float(np.max(table["residual"].to_numpy()))
    figures = f"{len(table) // len(sets):,} words for each training set; largest KKT residual {worst:.1e}."
    return Page(
        f"{corpus_of(provenance)}: posteriors",
        about("Tags of a word", text, provenance, f"{figures} {timeline_of(sets)}"),
        picture_view("posteriors", "p(tag | word), before and after labels"),
        rrb.Tabs(text_view("changed", "What labels change"), picture_view("residuals", "KKT residuals")),
        timeline=SETS,
    )


def draw_transitions(recording: rr.RecordingStream, artifact: Path) -> Page:
    """p(next tag | tag) by each way of estimating it, a step for each training set."""
    table, provenance = read_table(artifact, TRANSITIONS), read_provenance(artifact)
    sets, methods = subsets(table), pc.unique(table["method"]).to_pylist()
    previous, following = (pc.unique(table[name]).to_pylist() for name in ("previous", "next"))
    pictures = []
    for name, rows in sets.items():
        panels = [
            Panel(f"{method}: {set_title(name)}", _matrix(of_method(rows, method), previous, following))
            for method in methods
        ]
        pictures.append(transition_picture(panels, previous, following))
    log_pictures(recording, "transitions", SETS, pictures)
    text = (
        "Each row is a tag, or the start of a sentence, and says in percent which tag follows, or that the sentence "
        "stops. **Counts** come from the labelled sentences alone, **composite** from the raw text's pairs of words "
        "given their posteriors (Algorithm 4). Where the two differ, a few labelled sentences were not enough, or the "
        "posteriors mislead."
    )
    return Page(
        f"{corpus_of(provenance)}: transitions",
        about("Which tag follows which", text, provenance, timeline_of(sets)),
        picture_view("transitions", "p(next tag | tag)"),
        timeline=SETS,
        shares=(1.0, 3.0),
    )


def posterior_picture(
    words: Sequence[str], tags: Sequence[str], matrices: tuple[Floats, Floats], groups: Mapping[str, NDArray[np.intp]]
) -> bytes:
    """Heat maps before and after labels of groups of words."""
    rows = np.concatenate(list(groups.values()))
    starts = np.cumsum([0, *(len(group) for group in groups.values())])[:-1]
    titles = ("contexts and anchors alone (γ)", "with labels and spelling")
    return heat_maps(
        [Panel(title, matrix[rows]) for title, matrix in zip(titles, matrices, strict=True)],
        [words[row] for row in rows],
        tags,
        ("word", "tag"),
        Scale("p(tag | word)"),
        (12.6, 10.0),
        percent,
        list(zip(starts.tolist(), groups, strict=True)),
    )


def transition_picture(panels: Sequence[Panel], previous: Sequence[str], following: Sequence[str]) -> bytes:
    """Heat maps of p(next | previous)."""
    width = 7.4 * len(panels) + 0.6
    return heat_maps(
        panels, previous, following, ("previous tag", "next tag"), Scale("p(next | previous)"), (width, 7.4), percent
    )


def choose_words(count: NDArray[np.int64], gamma: Floats) -> dict[str, NDArray[np.intp]]:
    """Rows to look at: the most frequent, some of middling frequency, and of the 2,000 most frequent the least certain.

    count [n] falls; gamma [n, K]. No row is in two groups.
    """
    frequent = np.arange(min(FREQUENT, len(count)))
    rest = np.arange(len(frequent), len(count))
    middling = (
        rest[np.unique(np.geomspace(1, max(len(rest), 1), MIDDLING + 2).astype(np.intp)[1:-1] - 1)]
        if len(rest)
        else rest
    )
    rest = np.setdiff1d(rest, middling)[:2000]
    entropy = -(gamma[rest] * np.log(np.maximum(gamma[rest], 1e-12))).sum(axis=1)
    ambiguous = rest[np.argsort(-entropy, kind="stable")[:AMBIGUOUS]]
    groups = {"most frequent": frequent, "less and less frequent": middling, "least certain": ambiguous}
    return {name: rows for name, rows in groups.items() if len(rows)}


def subsets(table: pa.Table) -> dict[str, pa.Table]:
    """The rows of each training set, in the table's order."""
    return {name: table.filter(pc.equal(table["subset"], name)) for name in pc.unique(table["subset"]).to_pylist()}


def of_method(table: pa.Table, method: str) -> pa.Table:
    """The rows of one method."""
    return table.filter(pc.equal(table["method"], method))


def set_title(subset: str) -> str:
    """A training set's name in words: labelled sentences and draw."""
    size, _, draw = subset.partition("-")
    return f"{size} labelled sentences, draw {draw}" if draw else subset


def timeline_of(sets: Mapping[str, pa.Table]) -> str:
    """What the steps of the timeline are."""
    steps = "; ".join(f"{step}: {escape(title)}" for step, title in enumerate(map(set_title, sets)))
    return f"**Move along the timeline below** for other training sets ({steps})."


def corpus_of(provenance: Provenance) -> str:
    """Name of the corpus; "labelling" where the provenance has none."""
    return (
        str(provenance.params.get("corpus", "labelling"))
        if isinstance(provenance.params.get("corpus"), str)
        else "labelling"
    )


def percent(value: float) -> str:
    """A share in percent, nothing below half a percent."""
    return f"{100 * value:.0f}" if value >= 0.005 else ""


def _anchor_table(rows: pa.Table, provenance: Provenance) -> str:
    lines = []
    asked = provenance.params.get("anchors", {})
    settings = {"labelled_count": "least_labelled", "raw_count": "least_count", "purity": "least_purity"}
    usual = [asked.get(setting, max(rows[name].to_pylist())) for setting, name in settings.items()]
    for tag in pc.unique(rows["tag"]).to_pylist():
        of_tag = rows.filter(pc.equal(rows["tag"], tag)).sort_by([("count", "descending")])
        found = [of_tag[name][0].as_py() for name in ("least_labelled", "least_count", "least_purity")]
        limits = [f"{a:,}" if a == b else f"**{a:,}**" for a, b in zip(found, usual, strict=True)]
        words = ", ".join(escape(word) for word in of_tag["word"][:SHOWN_ANCHORS].to_pylist())
        purity = float(np.mean(of_tag["purity"].to_numpy()))
        lines.append((escape(tag), f"{len(of_tag)}", f"{purity:.2f}", *limits, words))
    header = ("tag", "anchors", "mean purity", "labels ≥", "count ≥", "purity ≥", "most frequent")
    return markdown_table(header, lines, header[1:6])


def _changed_words(rows: pa.Table, tags: Sequence[str], before: Floats, after: Floats) -> str:
    frequent = slice(0, 500)
    moved = np.abs(after[frequent] - before[frequent]).sum(axis=1) / 2
    chosen = np.argsort(-moved, kind="stable")[:12]
    words = rows["word"].to_pylist()
    lines = [(escape(words[row]), _likeliest(before[row], tags), _likeliest(after[row], tags)) for row in chosen]
    return markdown_table(("word", "by contexts", "with labels"), lines)


def _likeliest(shares: Floats, tags: Sequence[str]) -> str:
    best = np.argsort(-shares, kind="stable")[:2]
    return ", ".join(f"{escape(tags[tag])} {100 * shares[tag]:.0f} %" for tag in best if shares[tag] >= 0.05)


def _matrix(rows: pa.Table, previous: Sequence[str], following: Sequence[str]) -> Floats:
    place = [{name: at for at, name in enumerate(names)} for names in (previous, following)]
    matrix = np.full((len(previous), len(following)), np.nan)
    matrix[
        [place[0][name] for name in rows["previous"].to_pylist()], [place[1][name] for name in rows["next"].to_pylist()]
    ] = rows["probability"].to_numpy()
    return matrix
