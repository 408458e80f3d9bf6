"""Pictures with named axes, which the viewer's own plots lack, drawn on its background."""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from predplan.inspection.palette import BACKGROUND, FAINT, SEQUENTIAL, TEXT

Floats = NDArray[np.float64]

_DOTS_PER_INCH = 100
_STYLE = {
    "text.parse_math": False,
    "font.size": 11.0,
    "text.color": TEXT,
    "axes.labelcolor": TEXT,
    "axes.edgecolor": FAINT,
    "axes.facecolor": BACKGROUND,
    "axes.titlesize": 13.0,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": TEXT,
    "ytick.color": TEXT,
    "figure.facecolor": BACKGROUND,
    "grid.color": "#2a2d31",
}


@dataclass(frozen=True)
class Panel:
    """One heat map: values [R, C] under a title."""

    title: str
    values: Floats


@dataclass(frozen=True)
class Scale:
    """How values become colours, and what the colour bar says; without limits, those of the values."""

    label: str
    colours: str | Sequence[tuple[float, str]] = SEQUENTIAL
    limits: tuple[float, float] | None = (0.0, 1.0)


def heat_maps(
    panels: Sequence[Panel],
    rows: Sequence[str],
    columns: Sequence[str],
    axes: tuple[str, str],
    scale: Scale,
    size: tuple[float, float],
    written: Callable[[float], str] | None = None,
    groups: Sequence[tuple[int, str]] = (),
) -> bytes:
    """A PNG of heat maps side by side over the same rows and columns, a NaN left dark.

    axes names rows and columns; size in inches; written gives the text in a cell; groups are rows before which a
    line is drawn, and what stands beside it.
    """
    with canvas(size) as figure:
        drawn = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        low, high = scale.limits or _limits(panels)
        colours = _colour_map(scale)
        for axis, panel in zip(drawn, panels, strict=True):
            image = axis.imshow(panel.values, cmap=colours, vmin=low, vmax=high, aspect="auto", interpolation="nearest")
            _name_cells(axis, columns, panel.title, axes[1])
            if written is not None:
                _write_cells(axis, panel.values, written, image)
            for row, _ in groups:
                axis.axhline(row - 0.5, color=TEXT, linewidth=1.2)
        for row, name in groups:
            place = drawn[-1].get_yaxis_transform()
            drawn[-1].text(1.015, row - 0.4, name, transform=place, rotation=270, va="top", color=FAINT)
        drawn[0].set_yticks(range(len(rows)), [drawable(name) for name in rows])
        drawn[0].set_ylabel(axes[0])
        bar = figure.colorbar(image, ax=list(drawn), shrink=0.6, aspect=30, pad=0.015, label=scale.label)
        cast(Any, bar.outline).set_visible(False)
        return to_png(figure)


@contextmanager
def canvas(size: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure of so many inches in the pages' style, for as long as the block lasts."""
    with mpl.rc_context(cast(Any, _STYLE)):
        yield Figure(figsize=size, dpi=_DOTS_PER_INCH, layout="constrained")


def plain_numbers(axis: Axis) -> None:
    """Ticks of a logarithmic axis as numbers with commas, without those between."""
    axis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    axis.set_minor_formatter(NullFormatter())


def to_png(figure: Figure) -> bytes:
    """The figure as a PNG that names no software."""
    buffer = io.BytesIO()
    # savefig would draw twice, and these figures are mostly text, which is slow to draw.
    cast(Any, FigureCanvasAgg(figure)).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def drawable(text: str) -> str:
    """Text with what the font lacks, or cannot draw alone, replaced by a box, and cut to 16 characters."""
    known = _known_characters()
    shown = "".join(character if ord(character) in known else "□" for character in text)
    if unicodedata.combining(shown[:1] or "x") or shown.startswith("\ufe0f"):
        shown = f"□{shown[1:]}"
    return shown if len(shown) <= 16 else f"{shown[:15]}…"


@cache
def _known_characters() -> frozenset[int]:
    return frozenset(get_font(findfont(FontProperties())).get_charmap())


def _name_cells(axis: Axes, columns: Sequence[str], title: str, name: str) -> None:
    axis.set_title(title, loc="left", fontweight="bold", pad=12)
    axis.xaxis.tick_top()
    axis.xaxis.set_label_position("top")
    axis.set_xticks(range(len(columns)), [drawable(column) for column in columns], rotation=90)
    axis.set_xlabel(name)
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)


def _write_cells(axis: Axes, values: Floats, written: Callable[[float], str], image: Any) -> None:
    luminance = image.to_rgba(values)[..., :3] @ np.array([0.299, 0.587, 0.114])
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value) and (text := written(value)):
            colour = "black" if luminance[row, column] > 0.5 else "#c8ccd0"
            axis.text(column, row, text, ha="center", va="center", color=colour, fontsize=9, in_layout=False)


def _colour_map(scale: Scale) -> Colormap:
    chosen = scale.colours
    colours = mpl.colormaps[chosen] if isinstance(chosen, str) else LinearSegmentedColormap.from_list("", list(chosen))
    return colours.with_extremes(bad="#1b1d20")


def _limits(panels: Sequence[Panel]) -> tuple[float, float]:
    """Least and greatest of the finite values; symmetric about zero where some are below it."""
    values = np.concatenate([panel.values[np.isfinite(panel.values)] for panel in panels])
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if low < 0:
        high = max(-low, high)
        low = -high
    return low, high if high > low else low + 1.0
