"""How every figure looks: a drawing becomes an SVG with the same bytes each time that is readable by day and by night.

Ink is drawn in two stand-in colours that the SVG's own style sheet then sets, so that one file suits a light and a dark
page; text stays text. Lines carry their names at their ends.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

Floats = NDArray[np.float64]

INK, GRID = "#010203", "#040506"
WIDTH_IN = 6.2
LABELS_IN = 0.22
"""From the end of the longest line to the names."""
_STYLE = """<style>
 svg.drawing{--ink:#20252b;--grid:#d9dde1;background:#fff}
 @media (prefers-color-scheme:dark){svg.drawing{--ink:#e2e6ea;--grid:#3c434b;background:#15191e}}
</style>"""
_LOOK = {
    "svg.fonttype": "none",
    "svg.hashsalt": "predplan",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.6,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "figure.facecolor": "none",
}


@contextmanager
def drawing_look() -> Iterator[None]:
    """Within it, figures are made and turned into SVG with our look."""
    with style.context(_LOOK):
        yield


def new_canvas(height_in: float, width_in: float = WIDTH_IN) -> Canvas:
    """An empty figure, laid out so that nothing overlaps."""
    return Canvas(figsize=(width_in, height_in), layout="constrained")


def to_svg(canvas: Canvas) -> str:
    """The figure as an SVG document without dates, paths of the machine or fonts."""
    buffer = io.StringIO()
    canvas.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = re.sub(r"<metadata>.*?</metadata>", "", buffer.getvalue(), flags=re.DOTALL)
    svg = svg.replace(INK, "var(--ink)").replace(GRID, "var(--grid)")
    svg = re.sub(r"'DejaVu Sans'(, [^;\"]*?)?(?=[;\"])", "system-ui, 'Helvetica Neue', Arial, sans-serif", svg)
    return re.sub(r"<svg ([^>]*)>", rf'<svg class="drawing" \1>{_STYLE}', svg, count=1)


def inlined(svg: str) -> str:
    """The SVG as an element of an HTML page, which sets the colours of ink itself."""
    return svg[svg.index("<svg ") :].replace(_STYLE, "").rstrip()


def label_ends(
    canvas: Canvas, axes: Axes, ends: Sequence[tuple[float, float, str, str]], gap_points: float = 11.5
) -> None:
    """Names of lines to the right of their ends (x, y, name, colour), moved up or down until none overlap."""
    if not ends:
        return
    order = sorted(range(len(ends)), key=lambda index: (ends[index][1], index))
    scale = axes.yaxis.get_transform()  # on a logarithmic axis names keep apart by their logarithms
    low, high = scale.transform(np.array(axes.get_ylim())).tolist()
    # Constrained layout has not run yet; axes take about .82 of the figure's height.
    gap = gap_points / 72 / (canvas.get_figheight() * 0.82) * (high - low)
    targets = scale.transform(np.array([ends[index][1] for index in order]))
    places = scale.inverted().transform(spread_out(targets, gap, low, high))
    right = max(x for x, *_ in ends)
    for place, index in zip(places.tolist(), order, strict=True):
        x, y, name, colour = ends[index]
        axes.annotate(
            name,
            xy=(x, y),
            xytext=(right, place),
            textcoords=axes.transData + ScaledTranslation(LABELS_IN, 0, canvas.dpi_scale_trans),
            color=colour,
            va="center",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "linewidth": 0.6,
                "shrinkA": 1,
                "shrinkB": 3,
                "relpos": (0, 0.5),
            },
        )


def spread_out(values: Floats, gap: float, low: float, high: float) -> Floats:
    """Places at least `gap` apart within low to high, in the order of the rising `values`, nearest them by squares."""
    # Less their ideal spacing, places need only not fall: that is an isotonic regression, by pooling neighbours.
    target = values - gap * np.arange(len(values))
    pools: list[list[float]] = []
    for value in target.tolist():
        pools.append([value])
        while len(pools) > 1 and np.mean(pools[-2]) > np.mean(pools[-1]):
            pools[-2:] = [pools[-2] + pools[-1]]
    level = np.concatenate([np.full(len(pool), np.mean(pool)) for pool in pools])
    within: Floats = np.clip(level, low, high - gap * (len(values) - 1))
    return within + gap * np.arange(len(values))
