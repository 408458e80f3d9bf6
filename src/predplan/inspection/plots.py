"""Plots of labelling's tables: frequencies by rank, anchors by frequency, residuals, wrong tags."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from predplan.inspection.figures import canvas, drawable, plain_numbers, to_png
from predplan.inspection.palette import ACCENT, FAINT, SEQUENTIAL, TEXT, WARNING

Floats = NDArray[np.float64]

RESIDUAL_LIMIT = 1e-8


def zipf_plot(words: Sequence[str], count: NDArray[np.int64]) -> bytes:
    """Counts by rank on two logarithmic axes, some words named, beside Zipf's law. count [n] falls."""
    ranks = np.arange(1, len(count) + 1)
    kept = np.unique(np.geomspace(1, len(count), 400).astype(int)) - 1
    named = [rank - 1 for rank in (1, 3, 10, 30, 100, 300, 1000, 3000, 10000, 30000, 100000) if rank <= len(count)]
    with canvas((6.2, 4.8)) as figure:
        axis = figure.subplots()
        axis.loglog(
            ranks[kept], count[0] / ranks[kept], color=FAINT, linestyle="--", label="Zipf's law: count ∝ 1 / rank"
        )
        axis.loglog(ranks[kept], count[kept], color=ACCENT, linewidth=2, label="this text")
        axis.loglog(ranks[named], count[named], "o", color=ACCENT, markersize=5)
        for rank in named:
            place = (ranks[rank], count[rank])
            axis.annotate(drawable(words[rank]), place, (6, 4), textcoords="offset points")
        axis.set_xlabel("rank of the word")
        axis.set_ylabel("occurrences")
        axis.set_ylim(bottom=0.7 * float(count[-1]))
        plain_numbers(axis.xaxis)
        plain_numbers(axis.yaxis)
        axis.grid(visible=True)
        axis.legend(frameon=False)
        return to_png(figure)


def anchor_plot(anchors: pa.Table, title: str) -> bytes:
    """For each tag its anchors by raw count, coloured by purity and the most frequent named, and how many they are."""
    tags = pc.unique(anchors["tag"]).to_pylist()
    place = {tag: row for row, tag in enumerate(tags)}
    rows = np.array([place[tag] for tag in anchors["tag"].to_pylist()])
    count, purity = anchors["count"].to_numpy().astype(float), anchors["purity"].to_numpy()
    least, words = anchors["least_count"].to_numpy(), anchors["word"].to_pylist()
    with canvas((12.6, 9.6)) as figure:
        strip, bars = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
        shown = np.maximum(count, 1)
        dots = strip.scatter(
            shown, rows + 0.1, c=purity, cmap=SEQUENTIAL, vmin=0, vmax=1, s=46, edgecolors=FAINT, linewidths=0.5
        )
        for row in range(len(tags)):
            of_tag = np.flatnonzero(rows == row)
            limit = max(float(least[of_tag[0]]), 1.0)
            strip.plot([limit, limit], [row - 0.4, row + 0.4], color=WARNING, linewidth=1.5)
            last = np.inf
            for anchor in of_tag[np.argsort(-count[of_tag], kind="stable")]:
                if shown[anchor] * 1.22 < last:
                    strip.text(
                        shown[anchor],
                        row - 0.12,
                        drawable(words[anchor]),
                        ha="center",
                        va="bottom",
                        fontsize=9,
                        in_layout=False,
                    )
                    last = shown[anchor] / 1.22
        strip.set(xscale="log", xlabel="occurrences in raw text (line: least allowed)", ylabel="tag")
        strip.set_yticks(range(len(tags)), tags)
        plain_numbers(strip.xaxis)
        strip.invert_yaxis()
        strip.grid(axis="x")
        strip.set_title(title, loc="left", fontweight="bold")
        drawn = bars.barh(range(len(tags)), np.bincount(rows, minlength=len(tags)), color=ACCENT, height=0.6)
        bars.bar_label(drawn, padding=3, color=TEXT)
        bars.margins(x=0.15)
        bars.set_xlabel("anchors")
        bars.spines["bottom"].set_visible(False)
        bars.set_xticks([])
        bars.tick_params(length=0)
        bars.spines["left"].set_visible(False)
        bar = figure.colorbar(dots, ax=bars, label="purity of labels", shrink=0.7)
        cast(Any, bar.outline).set_visible(False)
        return to_png(figure)


def residual_plot(residual: Floats) -> bytes:
    """Histogram of KKT residuals by power of ten, with the limit that none may pass."""
    exponents = np.log10(np.maximum(residual, 1e-17))
    edges = np.arange(-17, max(int(np.ceil(exponents.max(initial=-8))), -7) + 1)
    with canvas((6.2, 4.8)) as figure:
        axis = figure.subplots()
        axis.hist(exponents, bins=[float(edge) for edge in edges], color=ACCENT, rwidth=0.9)
        axis.axvline(np.log10(RESIDUAL_LIMIT), color=WARNING, label="limit 1e-8")
        axis.set(xlabel="log10 of the KKT residual (1e-17: smaller, or zero)", ylabel="words", yscale="log")
        plain_numbers(axis.yaxis)
        axis.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0))
        axis.grid(axis="y")
        return to_png(figure)
