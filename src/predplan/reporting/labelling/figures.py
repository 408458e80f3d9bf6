"""Figures of the report on labelling, one idea each, as SVG."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator

from predplan.labelling.comparing import in_order
from predplan.labelling.methods import METHODS
from predplan.labelling.sentences import UNIVERSAL_TAGS
from predplan.palette import GREY, MISTAKE, colour_of
from predplan.reporting.document import Figure
from predplan.reporting.drawing import INK, drawing_look, label_ends, new_canvas, to_svg
from predplan.reporting.labelling.measurements import seconds
from predplan.reporting.labelling.results import CorpusResults, size_of, summarise, summary

MISTAKES = LinearSegmentedColormap.from_list("mistakes", ["#fbe3d3", MISTAKE, "#6e2f00"])
SHOWN_FROM = 0.005
"""Shares of mistakes below half a percent stay blank."""


def learning_curve(corpus: CorpusResults) -> Figure:
    """Figure 3.3: accuracy by labelled sentences, a line a method."""
    found = summarise(corpus.curve, "accuracy", 100)
    methods = in_order(method for method, _ in found)
    sizes = sorted({size for _, size in found})
    with drawing_look():
        canvas = new_canvas(4.1)
        axes = canvas.add_subplot()
        axes.set_xscale("log")
        ends = []
        for method in methods:
            own = [size for size in sizes if (method, size) in found]
            points = [found[method, size] for size in own]
            colour, dashed = colour_of(method), "FHMM" in METHODS[method].label
            axes.fill_between(own, [p.low for p in points], [p.high for p in points], color=colour, alpha=0.18, lw=0)
            axes.plot(
                own,
                [point.mean for point in points],
                color=colour,
                linestyle=(0, (4, 1.5)) if dashed else "-",
                linewidth=1.6,
                marker="o",
                markersize=3,
            )
            ends.append((float(own[-1]), points[-1].mean, METHODS[method].label, colour))
        axes.xaxis.set_major_locator(FixedLocator(sizes))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticklabels([f"{size:,}" for size in sizes])
        axes.set_xlabel("labelled sentences")
        axes.set_ylabel("accuracy per test word, %")
        label_ends(canvas, axes, ends)
        svg = to_svg(canvas)
    return Figure(
        f"{corpus.name}-learning-curve",
        svg,
        f"Learning curves on {corpus.title} (Figure 3.3). Lines are means over draws of the training set, bands run "
        "from the least to the greatest draw; the set of all labelled sentences is drawn once and has no band. Dashed: "
        "feature HMMs. The scale of labelled sentences is logarithmic.",
    )


def training_times(corpus: CorpusResults) -> Figure:
    """Wall seconds of training with the largest training set, a row a method."""
    size = corpus.sizes[-1]
    found = {method: each for (method, of), each in summarise(corpus.costs, "training_s").items() if of == size}
    methods = sorted(in_order(found), key=lambda method: found[method].mean, reverse=True)
    with drawing_look():
        canvas = new_canvas(0.8 + 0.21 * len(methods))
        axes = canvas.add_subplot()
        for row, method in enumerate(methods):
            time = found[method]
            axes.plot([time.low, time.high], [row, row], color=colour_of(method), linewidth=1.5)
            axes.plot(time.mean, row, "o", color=colour_of(method), markersize=5)
            axes.annotate(
                seconds(time.mean), (time.high, row), (6, 0), textcoords="offset points", va="center", fontsize=8
            )
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(numticks=6))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_yticks(range(len(methods)), [METHODS[method].label for method in methods])
        axes.set_ylim(-0.7, len(methods) - 0.3)
        axes.margins(x=0.12)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("wall time of training, s")
        svg = to_svg(canvas)
    return Figure(
        f"{corpus.name}-training-times",
        svg,
        f"Time of training on {corpus.title}. {size:,} labelled sentences and all raw text; points are means over "
        "draws, lines run from the fastest to the slowest, on a logarithmic scale. Tokenising and counting the raw "
        "text are left out.",
    )


def differences(corpus: CorpusResults) -> Figure:
    """Our best against each baseline: differences with intervals, a row a baseline, a panel a size."""
    panels = {size: [row for row in corpus.comparisons if size_of(row["subset"]) == size] for size in corpus.sizes}
    ours = {size: _most_compared([row["method"] for row in rows]) for size, rows in panels.items()}
    others = in_order(row["other"] for size, rows in panels.items() for row in rows if row["method"] == ours[size])
    with drawing_look():
        canvas = new_canvas(1.1 + 0.3 * len(others))
        row_axes = canvas.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
        for axes, (size, rows) in zip(row_axes, panels.items(), strict=True):
            axes.axvline(0, color=INK, linewidth=0.8)
            for place, other in enumerate(reversed(others)):
                drawn = [row for row in rows if row["method"] == ours[size] and row["other"] == other]
                for shift, row in zip(_dodge(len(drawn)), drawn, strict=True):
                    interval = [100 * row["low"], 100 * row["high"]]
                    axes.plot(interval, [place + shift] * 2, color=colour_of(ours[size]), linewidth=1.3)
                    axes.plot(100 * row["difference"], place + shift, "o", color=colour_of(ours[size]), markersize=3)
            axes.set_ylim(-0.6, len(others) - 0.4)
            axes.grid(visible=False, axis="y")
            axes.set_title(f"{size:,} labelled sentences", fontsize=9)
        row_axes[0].set_yticks(range(len(others)), [METHODS[other].label for other in reversed(others)])
        canvas.supxlabel("gain in accuracy per test word, points", fontsize=9, color=INK)
        svg = to_svg(canvas)
    named = ", ".join(f"{METHODS[method].label} ({size:,} labelled)" for size, method in ours.items())
    return Figure(
        f"{corpus.name}-differences",
        svg,
        f"What our best tagger gains over each baseline on {corpus.title}. Best on the development sentences: {named}. "
        "Each line is one draw of the training set with its 95 % interval, test sentences drawn anew.",
    )


def confusion(corpus: CorpusResults) -> Figure:
    """Mistakes of the best tagger, the smallest training sets together: gold tags in rows, given tags in columns."""
    method, size = corpus.tagged[0]["method"], size_of(corpus.tagged[0]["subset"])
    counts: defaultdict[tuple[str, str], int] = defaultdict(int)
    for row in corpus.confusion:
        if row["method"] == method and size_of(row["subset"]) == size:
            counts[row["gold"], row["predicted"]] += row["n"]
    met = {tag for pair in counts for tag in pair}
    tags = [tag for tag in UNIVERSAL_TAGS if tag in met] + sorted(met.difference(UNIVERSAL_TAGS))
    matrix = np.array([[counts[gold, given] for given in tags] for gold in tags], float)
    shares = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
    shown = np.ma.masked_where(np.eye(len(tags), dtype=bool) | (shares < SHOWN_FROM), shares)
    with drawing_look():
        canvas = new_canvas(4.9)
        axes = canvas.add_subplot()
        axes.pcolormesh(100 * shown, cmap=MISTAKES, vmin=0, vmax=30, edgecolors="face", linewidth=0.1)
        for (row, column), share in np.ndenumerate(shares):
            if row == column or share >= SHOWN_FROM:
                dark = INK if row == column else "#ffffff" if share > 0.12 else "#2b1200"
                text = f"{100 * share:.0f}" if share >= SHOWN_FROM else ""
                weight = "bold" if row == column else "normal"
                axes.text(
                    column + 0.5, row + 0.5, text, ha="center", va="center", color=dark, weight=weight, fontsize=8
                )
        axes.set_xticks(np.arange(len(tags)) + 0.5, tags, rotation=45, ha="right", rotation_mode="anchor")
        axes.set_yticks(np.arange(len(tags)) + 0.5, tags)
        axes.invert_yaxis()
        axes.grid(visible=False)
        axes.tick_params(length=0)
        axes.set_xlabel("tag given")
        axes.set_ylabel("tag the word has")
        svg = to_svg(canvas)
    return Figure(
        f"{corpus.name}-confusion",
        svg,
        f"Mistakes of {METHODS[method].label} on {corpus.title}, {size} labelled sentences. Percent of the words of "
        "each tag (row) that were given each tag (column), all draws together; on the diagonal, in bold, those given "
        "the right one; shares below half a percent are blank.",
    )


def ablations(corpus: CorpusResults) -> Figure:
    """What each component is worth: dev accuracy with one setting changed, less that of the default."""
    size = min(size_of(row["subset"]) for row in corpus.ablations)
    rows = [row for row in corpus.ablations if size_of(row["subset"]) == size]
    default = {(row["component"], row["subset"]): row["dev_accuracy"] for row in rows if row["default"]}
    changes: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
    for row in rows:
        base = default.get((row["component"], row["subset"]))
        if base is not None and not row["default"]:
            changes[row["component"], row["setting"]].append(100 * (row["dev_accuracy"] - base))
    with drawing_look():
        canvas = new_canvas(0.9 + 0.24 * len(changes))
        axes = canvas.add_subplot()
        axes.axvline(0, color=INK, linewidth=0.8)
        for place, values in enumerate(reversed(changes.values())):
            found = summary(values)
            axes.plot([found.low, found.high], [place, place], color=colour_of("anchor"), linewidth=1.5)
            axes.plot(found.mean, place, "o", color=colour_of("anchor"), markersize=5)
        labels = [f"{component}: {setting}" for component, setting in reversed(changes)]
        axes.set_yticks(range(len(labels)), labels)
        axes.set_ylim(-0.7, len(labels) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(f"change of dev accuracy, points, {size:,} labelled sentences")
        axes.annotate(
            "default",
            (0, 1),
            (3, 2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            color=GREY,
            fontsize=8,
        )
        svg = to_svg(canvas)
    return Figure(
        f"{corpus.name}-ablations",
        svg,
        f"What each choice is worth on {corpus.title}. The anchor HMM with one thing changed, less the same with "
        "everything at its default, on the development sentences; points are means over draws, lines their range.",
    )


def _most_compared(methods: list[str]) -> str:
    """The method held against most others: our best field, or our best anchor model where there is no field."""
    return max(in_order(methods), key=lambda method: (methods.count(method), METHODS[method].family == "field"))


def _dodge(count: int) -> list[float]:
    return [] if not count else [float(shift) for shift in np.linspace(0.22, -0.22, count)] if count > 1 else [0.0]
