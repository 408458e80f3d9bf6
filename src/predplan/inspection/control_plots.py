"""Plots of control's tables: curves of learning, means over training, errors of prediction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from predplan.control.curves import Condition, Curve
from predplan.control.tables import Row
from predplan.inspection.figures import canvas, to_png
from predplan.inspection.palette import FAINT, TEXT
from predplan.palette import colour_of

COLUMNS = 3
WIDTH, LEAST_HEIGHT, PANEL_HEIGHT = 13.0, 7.0, 3.5
"""Inches."""


def named(condition: Condition) -> str:
    """A condition in a few words."""
    task, noise, drop = condition
    parts = [f"σ = {noise:g}"] if noise else []
    parts += [f"{100 * drop:g} % lost"] if drop else []
    return f"{task}, {', '.join(parts)}" if parts else task


def curve_plot(curves: Mapping[Condition, Mapping[str, Curve]], label: str, logarithmic: bool = False) -> bytes:
    """A panel for each condition: means over runs by environment steps, bands of one standard error."""
    with _panels(len(curves)) as (figure, panels):
        for axes, (condition, methods) in zip(panels, curves.items(), strict=False):
            for method, curve in methods.items():
                colour = colour_of(method)
                low, high = curve.mean - curve.error, curve.mean + curve.error
                floor = 0.1 * curve.mean.min() if logarithmic else -np.inf
                axes.fill_between(curve.steps, np.maximum(low, floor), high, color=colour, alpha=0.25, linewidth=0)
                axes.plot(curve.steps, curve.mean, color=colour, linewidth=2, label=f"{method} ({curve.seeds})")
            if logarithmic:
                axes.set_yscale("log")
                _plain_decades(axes.yaxis)
            axes.xaxis.set_major_formatter(_thousands)
            _dress(axes, named(condition))
            axes.legend(frameon=False, fontsize=8.5, loc="best")
        figure.supxlabel("environment steps, exploration included", color=TEXT, fontsize=11)
        figure.supylabel(label, color=TEXT, fontsize=11)
        return to_png(figure)


def mean_plot(summary: Sequence[Row]) -> bytes:
    """A panel for each condition: mean return over training of each method, and its standard error."""
    grouped: dict[Condition, list[Row]] = {}
    for row in summary:
        grouped.setdefault((row["task"], row["noise"], row["drop"]), []).append(row)
    with _panels(len(grouped)) as (figure, panels):
        for axes, (condition, rows) in zip(panels, grouped.items(), strict=False):
            for place, row in enumerate(reversed(rows)):
                colour, error = colour_of(row["method"]), row["standard_error"] or 0.0
                axes.errorbar(row["mean_return"], place, xerr=error, color=colour, fmt="o", markersize=7, linewidth=2)
                axes.annotate(
                    f"{row['mean_return']:.4g}", (row["mean_return"], place), (0, 8), textcoords="offset points",
                    ha="center", fontsize=9,
                )  # fmt: skip
            axes.set_yticks(range(len(rows)), [f"{row['method']} ({row['seeds']})" for row in reversed(rows)])
            axes.set_ylim(-0.6, len(rows) - 0.3)
            axes.margins(x=0.12)
            _dress(axes, named(condition))
        figure.supxlabel("mean return over training; bars: one standard error", color=TEXT, fontsize=11)
        return to_png(figure)


def error_plot(rows: Sequence[Row]) -> bytes:
    """A panel for each condition: the error one step ahead of each predictor, means over seeds, every seed a dot."""
    grouped: dict[Condition, dict[str, list[float]]] = {}
    for row in rows:
        if row["steps"] == 1:
            condition = (row["task"], row["noise"], row["drop"])
            grouped.setdefault(condition, {}).setdefault(row["predictor"], []).append(row["error"])
    with _panels(len(grouped)) as (figure, panels):
        for axes, (condition, predictors) in zip(panels, grouped.items(), strict=False):
            floor = 0.5 * min(min(errors) for errors in predictors.values())
            for place, (name, errors) in enumerate(reversed(predictors.items())):
                mean = float(np.mean(errors))
                axes.barh(place, mean - floor, left=floor, color=colour_of(name), height=0.6)
                axes.plot(errors, np.full(len(errors), place), "|", color=TEXT, markersize=8)
                axes.annotate(f"{mean:.2g}", (max(errors), place), (5, -3), textcoords="offset points", fontsize=9)
            axes.set_xscale("log")
            _plain_decades(axes.xaxis)
            axes.set_xlim(left=floor)
            axes.margins(x=0.2)
            axes.set_yticks(range(len(predictors)), list(reversed(predictors)))
            _dress(axes, named(condition))
        figure.supxlabel("error one step ahead, share of the exploration's variance", color=TEXT, fontsize=11)
        return to_png(figure)


def ahead_plot(rows: Sequence[Row]) -> bytes:
    """A panel for each condition: errors by steps ahead, means over seeds."""
    grouped: dict[Condition, dict[str, dict[int, list[float]]]] = {}
    for row in rows:
        condition = (row["task"], row["noise"], row["drop"])
        own = grouped.setdefault(condition, {}).setdefault(row["predictor"], {})
        own.setdefault(row["steps"], []).append(row["error"])
    with _panels(len(grouped)) as (figure, panels):
        for axes, (condition, predictors) in zip(panels, grouped.items(), strict=False):
            for name, errors in predictors.items():
                if len(errors) > 1:
                    ahead = sorted(errors)
                    means = [float(np.mean(errors[k])) for k in ahead]
                    axes.plot(ahead, means, "o-", color=colour_of(name), linewidth=2, markersize=4, label=name)
            axes.set_yscale("log")
            _plain_decades(axes.yaxis)
            _dress(axes, named(condition))
            axes.legend(frameon=False, fontsize=8.5)
        figure.supxlabel("steps ahead", color=TEXT, fontsize=11)
        figure.supylabel("error, share of the exploration's variance", color=TEXT, fontsize=11)
        return to_png(figure)


@contextmanager
def _panels(count: int) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of so many panels in rows."""
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    with canvas((WIDTH, max(LEAST_HEIGHT, PANEL_HEIGHT * rows))) as figure:
        panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
        for axes in panels[count:]:
            axes.set_visible(False)
        yield figure, panels


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontweight="bold", fontsize=11)
    axes.grid(visible=True)
    axes.tick_params(color=FAINT)


def _plain_decades(axis: Axis) -> None:
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())


def _thousands(value: float, _: object) -> str:
    return f"{value / 1000:g}k" if value else "0"
