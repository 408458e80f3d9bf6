"""Figures of the report on control, as SVG: one panel a condition, one colour a method, bands of one standard error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from predplan.control.curves import Condition
from predplan.palette import colour_of
from predplan.reporting.control.labels import MAIN, label_of, observed, predictor_label, task_title, titled
from predplan.reporting.control.results import ControlResults
from predplan.reporting.document import Figure
from predplan.reporting.drawing import drawing_look, label_ends, new_canvas, to_svg

PANEL_IN = 2.0
GAP_POINTS = 11.5
DRAWN = ("last", "order 2", "order 10", "gru", "kernel", "innovation", "innovation refined", "innovation corrected")
"""Predictors whose errors are drawn."""


def learning_figure(
    results: ControlResults, conditions: Sequence[Condition], methods: Sequence[str], name: str, caption: str
) -> Figure | None:
    """Returns by steps, where a method was run that this figure alone shows; None where none was."""
    own = set(methods).difference(MAIN) or set(methods)
    shown = [c for c in conditions if own & results.curves.get(c, {}).keys()]
    if not shown:
        return None
    with drawing_look():
        canvas = new_canvas(PANEL_IN * len(shown) + 0.4)
        panels = canvas.subplots(len(shown), 1, squeeze=False)[:, 0]
        for axes, condition in zip(panels, shown, strict=True):
            ends = []
            for method in methods:
                curve = results.curves[condition].get(method)
                if curve is None:
                    continue
                colour = colour_of(method)
                axes.fill_between(
                    curve.steps, curve.mean - curve.error, curve.mean + curve.error, color=colour, alpha=0.2, lw=0
                )
                axes.plot(curve.steps, curve.mean, color=colour, linewidth=1.5)
                ends.append((float(curve.steps[-1]), float(curve.mean[-1]), label_of(method), colour))
            _dress(axes, titled(condition))
            axes.set_ylabel("mean return")
            axes.margins(x=0.01)
            axes.xaxis.set_major_formatter(lambda value, _: f"{value / 1000:g}k" if value else "0")
            label_ends(canvas, axes, ends, gap_points=GAP_POINTS * len(shown))
        panels[-1].set_xlabel("environment steps, exploration included")
        svg = to_svg(canvas)
    text = f"{caption}. Means over {_seeds(results, shown, methods)}; bands are one standard error."
    rows = [row for c in shown for method in methods if (row := results.summary(c, method))]
    if any(row["diverged"] for row in rows):
        text += " A run that diverged counts from there on with its first return, that of the exploration."
    return Figure(name, svg, text)


def degradation_figure(results: ControlResults, methods: Sequence[str], drop: bool) -> Figure | None:
    """Mean return over training by noise, or by the share of observations lost; None where neither was varied."""
    vary, still = (2, 1) if drop else (1, 2)
    levels: dict[str, list[Condition]] = {}
    for condition in results.conditions:
        if condition[still] == 0.0:
            levels.setdefault(condition[0], []).append(condition)
    tasks = {task: own for task, own in levels.items() if len({condition[vary] for condition in own}) > 1}
    if not tasks:
        return None
    with drawing_look():
        canvas = new_canvas(PANEL_IN * len(tasks) + 0.4)
        panels = canvas.subplots(len(tasks), 1, squeeze=False)[:, 0]
        for axes, (task, own) in zip(panels, tasks.items(), strict=True):
            ends = []
            for method in methods:
                rows = [(condition[vary], row) for condition in own if (row := results.summary(condition, method))]
                if not rows:
                    continue
                x, mean = (np.array(one) for one in zip(*((at, row["mean_return"]) for at, row in rows), strict=True))
                error = np.array([row["standard_error"] or 0.0 for _, row in rows])
                colour = colour_of(method)
                axes.errorbar(x, mean, yerr=error, color=colour, linewidth=1.5, marker="o", markersize=3.5)
                ends.append((float(x[-1]), float(mean[-1]), label_of(method), colour))
            _dress(axes, task_title(task))
            axes.set_ylabel("mean return")
            axes.set_xticks(sorted({condition[vary] for condition in own}))
            label_ends(canvas, axes, ends, gap_points=GAP_POINTS * len(tasks))
        panels[-1].set_xlabel("share of observations lost" if drop else "observation noise σ, in each one’s spread")
        svg = to_svg(canvas)
    shown = [condition for own in tasks.values() for condition in own]
    what = "Lost observations" if drop else "Observation noise (what Figure 5.9 asks)"
    return Figure(
        "dropped" if drop else "noise",
        svg,
        f"{what}. Mean return over training, means over {_seeds(results, shown, methods)}; bars are one standard "
        "error.",
    )


def prediction_figure(results: ControlResults) -> Figure | None:
    """Errors by steps ahead, a row of panels a task; None where all are one step ahead."""
    several: dict[str, dict[Condition, dict[str, dict[int, float]]]] = {}
    for condition, own in results.errors.items():
        drawn = {
            name: {k: mean for k, (mean, _, _) in own[name].items()}
            for name in DRAWN
            if name in own and len(own[name]) > 1
        }
        if drawn:
            several.setdefault(condition[0], {})[condition] = drawn
    if not several:
        return None
    columns = max(len(conditions) for conditions in several.values())
    with drawing_look():
        canvas = new_canvas(PANEL_IN * len(several) * 0.8 + 0.8)
        panels = canvas.subplots(len(several), columns, squeeze=False, sharex=True, sharey="row")
        lines: dict[str, Line2D] = {}
        for row, (task, conditions) in zip(panels, several.items(), strict=True):
            row[0].set_yscale("log")
            row[0].yaxis.set_minor_locator(NullLocator())
            row[0].yaxis.set_major_formatter("{x:g}")
            row[0].set_ylabel(f"{task_title(task)}: error")
            for axes in row[len(conditions) :]:
                axes.set_visible(False)
            for axes, (condition, drawn) in zip(row, conditions.items(), strict=False):
                axes.set_title(observed(condition), fontsize=8, loc="left")
                for name, errors in drawn.items():
                    ahead, mean = sorted(errors), [errors[k] for k in sorted(errors)]
                    [line] = axes.plot(ahead, mean, color=colour_of(name), linewidth=1.5, marker="o", markersize=3)
                    lines.setdefault(predictor_label(name), line)
                axes.set_xticks(sorted({k for errors in drawn.values() for k in errors}))
        panels[-1, 0].set_xlabel("steps ahead")
        canvas.legend(
            [*lines.values()], [*lines], loc="outside lower center", ncols=2, frameon=False, labelcolor="linecolor"
        )
        svg = to_svg(canvas)
    return Figure(
        "prediction",
        svg,
        "Errors of prediction by steps ahead, on logarithmic scales: means over seeds. The error is the mean square "
        "difference to what a perfect sensor would have seen, each coordinate over its variance while exploring. The "
        "tables hold the other orders of autoregression too.",
    )


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=9, loc="left")


def _seeds(results: ControlResults, conditions: Sequence[Condition], methods: Sequence[str]) -> str:
    """How many runs the means of a figure are over."""
    counts = {row["seeds"] for c in conditions for name in methods if (row := results.summary(c, name))}
    low, high = min(counts, default=0), max(counts, default=0)
    if high == 1:
        return "one run of each"
    return f"{low} runs" if low == high else f"{low} to {high} runs"
