"""Pages of what came out: confusion, tagged sentences, learning curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.tables import read_provenance, read_table
from predplan.inspection.figures import Panel, Scale, heat_maps
from predplan.inspection.labelling import SETS, corpus_of, of_method, percent, set_title, subsets, timeline_of
from predplan.inspection.markdown import about, escape, markdown_table, viewable
from predplan.inspection.palette import rgb
from predplan.inspection.recording import Page, log_pictures, log_text, log_texts, picture_view, text_view
from predplan.labelling.tables import CONFUSION, CURVE, TAGGED
from predplan.palette import colour_of

Floats = NDArray[np.float64]

SENTENCE, SIZE = "sentence", "labelled_sentences"
SHOWN_CONFUSIONS = 15


def draw_confusion(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Given tags by true tag: a tab for each method, a step of the timeline for each size of training set."""
    table, provenance = read_table(artifact, CONFUSION), read_provenance(artifact)
    sets, methods, tags = _by_size(table), pc.unique(table["method"]).to_pylist(), _by_support(table)
    views = []
    for method, path in zip(methods, entity_names(methods), strict=True):
        matrices = [_confusion(of_method(rows, method), tags) for rows in sets.values()]
        titles = [f"{method}: {name}" for name in sets]
        pictures = [_confusion_picture(matrix, tags, title) for matrix, title in zip(matrices, titles, strict=True)]
        log_pictures(recording, f"confusion/{path}", SETS, pictures)
        texts = [
            f"## {escape(title)}\n\n{_worst(matrix, tags)}" for matrix, title in zip(matrices, titles, strict=True)
        ]
        log_texts(recording, f"mistakes/{path}", SETS, texts)
        picture, mistakes = picture_view(f"confusion/{path}", "Confusion"), text_view(f"mistakes/{path}", "Mistakes")
        views.append(rrb.Horizontal(picture, mistakes, column_shares=[5, 2], name=viewable(method)))
    text = (
        "Each row is a true tag and says in percent which tags its test words were given; what is right stands on the "
        "diagonal. A bright cell off the diagonal is a mistake that the method makes again and again. The list beside "
        "it counts the mistakes, the most frequent first; the tabs are the methods."
    )
    return Page(
        f"{corpus_of(provenance)}: confusion",
        about("Which tags are mistaken for which", text, provenance, timeline_of(sets)),
        rrb.Tabs(*views),
        timeline=SETS,
        shares=(1.0, 3.5),
    )


def draw_tagged(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Tagged test sentences: a step for each sentence, a tab for each training set, a column for each method."""
    table, provenance = read_table(artifact, TAGGED), read_provenance(artifact)
    methods, views = pc.unique(table["method"]).to_pylist(), []
    for name, rows in subsets(table).items():
        path = entity_names([name])[0]
        groups = {method: of_method(rows, method).to_pylist() for method in methods}
        groups = {method: sentences for method, sentences in groups.items() if sentences}
        steps = min(len(sentences) for sentences in groups.values())
        texts = [_sentence({m: of[step] for m, of in groups.items()}, step, steps) for step in range(steps)]
        log_texts(recording, f"sentences/{path}", SENTENCE, texts)
        for method, entity in zip(groups, entity_names(list(groups)), strict=True):
            wrong = [float(_wrong(row)) for row in groups[method][:steps]]
            _log_curve(recording, f"wrong/{path}/{entity}", method, SENTENCE, np.arange(steps), wrong, 1.0)
        plot = rrb.TimeSeriesView(
            origin=f"wrong/{path}",
            name="Wrong tags in each sentence",
            axis_x=rrb.TimeAxis(view_range=_range(0, max(steps - 1, 1))),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
        )
        views.append(
            rrb.Vertical(
                text_view(f"sentences/{path}", "Sentence"), plot, row_shares=[3, 1], name=viewable(set_title(name))
            )
        )
    text = (
        "Each step of the timeline is a test sentence with the tag every word has and the tags it was given. A wrong "
        "tag stands **bold** after a cross, so a row of crosses is a word that every method gets wrong. The curve "
        "below counts them: click where it is high to see why; the tabs are the training sets."
    )
    return Page(
        f"{corpus_of(provenance)}: tagged sentences",
        about("Tagged sentences", text, provenance),
        rrb.Tabs(*views),
        timeline=SENTENCE,
    )


def draw_curve(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Accuracy by labelled sentences: the mean of the draws, and thin lines at the least and the greatest."""
    table, provenance = read_table(artifact, CURVE), read_provenance(artifact)
    methods, all_sizes = pc.unique(table["method"]).to_pylist(), sorted(set(table["size"].to_pylist()))
    lines = []
    for method, path in zip(methods, entity_names(methods), strict=True):
        rows = of_method(table, method)
        size, accuracy = rows["size"].to_numpy(), 100 * rows["accuracy"].to_numpy()
        sizes = np.unique(size)
        drawn = [accuracy[size == at] for at in sizes]
        for name, value in (("mean", np.mean), ("least", np.min), ("greatest", np.max)):
            values = [float(value(of)) for of in drawn]
            _log_curve(recording, f"curve/{path}/{name}", method, SIZE, sizes, values, 2.5 if name == "mean" else 0.7)
        means = dict(zip(sizes.tolist(), (float(of.mean()) for of in drawn), strict=True))
        lines.append((method, means))
    header = ("method", *(f"{size:,}" for size in all_sizes))
    lines.sort(key=lambda line: -line[1].get(all_sizes[-1], 0.0))
    cells = [
        (escape(method), *(f"{means[at]:.1f}" if at in means else "–" for at in all_sizes)) for method, means in lines
    ]
    log_text(
        recording, "means", f"Mean accuracy [%] by labelled sentences\n\n{markdown_table(header, cells, header[1:])}"
    )
    text = (
        "How accuracy on the test words [%] grows with the number of labelled sentences. A thick line is the mean over "
        "draws of the training set, the thin lines of its colour the worst and the best draw. A method has the same "
        "colour here and in the report."
    )
    return Page(
        f"{corpus_of(provenance)}: learning curves",
        about("Learning curves", text, provenance),
        rrb.TimeSeriesView(
            origin="curve",
            name="Accuracy [%] by labelled sentences",
            axis_x=rrb.TimeAxis(view_range=_range(all_sizes[0], max(all_sizes[-1], all_sizes[0] + 1))),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
        ),
        text_view("means", "Means"),
        timeline=SIZE,
    )


def entity_names(names: Sequence[str]) -> list[str]:
    """Names fit for entity paths, all distinct."""
    plain = ["".join(letter if letter.isalnum() else "_" for letter in name) for name in names]
    return [name if plain.count(name) == 1 else f"{name}_{at}" for at, name in enumerate(plain)]


def _by_size(table: pa.Table) -> dict[str, pa.Table]:
    """The rows of the training sets of each size, all draws together."""
    parts: dict[str, list[pa.Table]] = {}
    for name, rows in subsets(table).items():
        size, _, draw = name.partition("-")
        parts.setdefault(f"{size} labelled sentences" if draw else name, []).append(rows)
    return {
        name if len(rows) == 1 else f"{name}, {len(rows)} draws": pa.concat_tables(rows) for name, rows in parts.items()
    }


def _by_support(table: pa.Table) -> list[str]:
    """All tags, the ones that most words have first."""
    words = Counter(dict.fromkeys(table["predicted"].to_pylist(), 0))
    for gold, n in zip(table["gold"].to_pylist(), table["n"].to_pylist(), strict=True):
        words[gold] += n
    return [tag for tag, _ in words.most_common()]


def _confusion(rows: pa.Table, tags: Sequence[str]) -> Floats:
    place = {tag: at for at, tag in enumerate(tags)}
    matrix = np.zeros((len(tags), len(tags)))
    gold, given = ([place[tag] for tag in rows[name].to_pylist()] for name in ("gold", "predicted"))
    np.add.at(matrix, (gold, given), rows["n"].to_numpy())
    return matrix


def _confusion_picture(matrix: Floats, tags: Sequence[str], title: str) -> bytes:
    with np.errstate(invalid="ignore"):
        shares = matrix / matrix.sum(axis=1, keepdims=True)
    axes, scale = ("true tag", "tag given"), Scale("share of the words of a true tag")
    return heat_maps([Panel(title, shares)], tags, tags, axes, scale, (9.6, 8.4), percent)


def _worst(matrix: Floats, tags: Sequence[str]) -> str:
    wrong = matrix * (1 - np.eye(len(tags)))
    total = max(float(matrix.sum()), 1.0)
    order = np.argsort(-wrong, axis=None, kind="stable")[:SHOWN_CONFUSIONS]
    lines = [
        (
            escape(f"{tags[gold]} → {tags[given]}"),
            f"{wrong[gold, given]:,.0f}",
            f"{100 * wrong[gold, given] / total:.2f}",
        )
        for gold, given in zip(*np.unravel_index(order, wrong.shape), strict=True)
        if wrong[gold, given]
    ]
    header = ("true → given", "words", "% of all")
    return f"{100 * np.trace(matrix) / total:.2f} % right\n\n{markdown_table(header, lines, header[1:])}"


def _wrong(row: dict[str, list[str]]) -> int:
    return sum(gold != given for gold, given in zip(row["gold"], row["predicted"], strict=True))


def _sentence(of: dict[str, dict[str, list[str]]], step: int, steps: int) -> str:
    """One sentence as Markdown: the words in a row, then a table with a line for each word."""
    first = next(iter(of.values()))
    words, gold = first["words"], first["gold"]
    given = [row["predicted"] for row in of.values()]
    lines = [
        (escape(word), escape(true), *(escape(tag) if tag == true else f"**✗ {escape(tag)}**" for tag in tags))
        for word, true, *tags in zip(words, gold, *given, strict=True)
    ]
    missed = [any(tags[at] != gold[at] for tags in given) for at in range(len(words))]
    text = " ".join(f"**{escape(word)}**" if at else escape(word) for word, at in zip(words, missed, strict=True))
    header = ("word", "true tag", *(f"{escape(name)} ({_wrong(row)} wrong)" for name, row in of.items()))
    return f"## Sentence {step} of {steps - 1}\n\n{text}\n\n{markdown_table(header, lines)}"


def _log_curve(
    recording: rr.RecordingStream,
    path: str,
    method: str,
    timeline: str,
    steps: NDArray[np.int64],
    values: Sequence[float],
    width: float,
) -> None:
    line = rr.SeriesLines(names=viewable(method), colors=rgb(colour_of(method)), widths=width)
    recording.log(path, line, static=True)
    recording.send_columns(path, [rr.TimeColumn(timeline, sequence=steps)], rr.Scalars.columns(scalars=values))


def _range(low: int, high: int) -> rr.TimeRange:
    return rr.TimeRange(start=rr.TimeRangeBoundary.absolute(seq=low), end=rr.TimeRangeBoundary.absolute(seq=high))
