"""Trajectories as pictures: over the cost field in the plane, and the end effector's traces in the kitchen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from predplan.palette import GREY, colour_of
from predplan.reporting.document import Figure
from predplan.reporting.drawing import INK, drawing_look, new_canvas, to_svg
from predplan.reporting.planning.results import SuiteResults

FIELD = LinearSegmentedColormap.from_list("field", ["#9aa0a600", "#7b828aff"])
"""From nothing where obstacles cost nothing, to grey in their midst."""
LEVELS = 8
POSES = 6
"""Configurations of the arm that are drawn between start and goal."""


def maze_panels(suite: SuiteResults, shown: Sequence[tuple[str, int]], name: str, caption: str) -> Figure:
    """Trajectories of the first problem over the cost field, a panel for each method and iteration."""
    with drawing_look():
        canvas = new_canvas(1.75 * ((len(shown) + 2) // 3) + 0.3)
        panels = canvas.subplots((len(shown) + 2) // 3, min(3, len(shown)), sharex=True, sharey=True, squeeze=False)
        for axes, (method, iteration) in zip(panels.ravel(), shown, strict=False):
            _field(axes, suite)
            way, line = suite.trajectory(method, iteration), suite.trajectory(method, 0)
            axes.plot(line[:, 0], line[:, 1], color=GREY, linewidth=0.8, linestyle=(0, (3, 2)))
            axes.plot(way[:, 0], way[:, 1], color=colour_of(method), linewidth=1.7)
            axes.plot(way[[0, -1], 0], way[[0, -1], 1], "o", color=INK, markersize=3)
            axes.set_title(f"{suite.methods[method].label}, {iteration} it.", fontsize=8)
            axes.set_ylim(0.15, 0.85)
        for axes in panels.ravel()[len(shown) :]:
            axes.set_visible(False)
        canvas.supxlabel("x, m", fontsize=9)
        canvas.supylabel("y, m", fontsize=9)
        svg = to_svg(canvas)
    return Figure(name, svg, caption)


def arm_panels(suite: SuiteResults, methods: Sequence[str], name: str, caption: str, arms: bool = True) -> Figure:
    """The end effector's way in the first scene, with the arm at some times, a panel a method."""
    columns = 2 if arms else min(3, len(methods))
    rows = -(-len(methods) // columns)
    with drawing_look():
        canvas = new_canvas((1.9 if arms else 1.45) * rows + 0.3)
        panels = canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes, method in zip(panels.ravel(), methods, strict=False):
            _field(axes, suite)
            way = suite.trajectory(method, suite.iterations)
            if arms:
                _arms(axes, suite.trajectory(method, suite.iterations, "body"))
            axes.plot(way[:, 0], way[:, 1], color=colour_of(method), linewidth=1.8)
            axes.set_title(suite.methods[method].label, fontsize=8)
            axes.set_xlim(-1.3, 1.4)
            axes.set_ylim(-0.35, 1.3)
        for axes in panels.ravel()[len(methods) :]:
            axes.set_visible(False)
        canvas.supxlabel("x, m", fontsize=9)
        canvas.supylabel("y, m", fontsize=9)
        svg = to_svg(canvas)
    return Figure(name, svg, caption)


def tool_traces(suite: SuiteResults, methods: Sequence[str], iterations: Sequence[int], figure: str) -> Figure:
    """The end effector's ways in the first problem, from the front and from above: a row an iteration."""
    with drawing_look():
        canvas = new_canvas(2.7 * len(iterations) + 0.6)
        panels = canvas.subplots(len(iterations), 2, squeeze=False)
        for (front, above), iteration in zip(panels, iterations, strict=True):
            for method in methods:
                way = suite.trajectory(method, iteration)
                colour = colour_of(method)
                front.plot(way[:, 0], way[:, 2], color=colour, linewidth=1.5, label=suite.methods[method].label)
                above.plot(way[:, 0], way[:, 1], color=colour, linewidth=1.5)
            for axes, k in ((front, 2), (above, 1)):
                way = suite.trajectory(methods[0], iteration)
                axes.plot(way[[0, -1], 0], way[[0, -1], k], "o", color=INK, markersize=4)
                axes.annotate("start", (way[0, 0], way[0, k]), (4, 4), textcoords="offset points", fontsize=8)
                axes.annotate("goal", (way[-1, 0], way[-1, k]), (4, 4), textcoords="offset points", fontsize=8)
                axes.set_aspect("equal", adjustable="datalim")
                axes.set_xlabel("x, m")
            front.set_ylabel("z, m (from the front)")
            above.set_ylabel("y, m (from above)")
            front.set_title(f"{iteration} iterations", fontsize=9)
        lines, names = panels[0, 0].get_legend_handles_labels()
        canvas.legend(lines, names, loc="outside lower center", ncols=2, frameon=False, labelcolor="linecolor")
        svg = to_svg(canvas)
    return Figure(
        f"{suite.name}-traces",
        svg,
        f"The end effector’s way in the first problem: {suite.title} ({figure}). The recordings show the arm and the "
        "kitchen in three dimensions.",
    )


def _field(axes: Axes, suite: SuiteResults) -> None:
    xs, ys, cost = suite.field_grid
    top = float(cost.max())
    axes.contourf(xs, ys, cost, levels=np.linspace(1e-6, top, LEVELS), cmap=FIELD, zorder=0)
    axes.set_aspect("equal")
    axes.grid(visible=False)


def _arms(axes: Axes, body: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    """The arm at equal steps; start and goal in ink."""
    shown = np.linspace(0, len(body) - 1, POSES + 2).round().astype(int)
    for k in shown:
        points = body[k].reshape(-1, 2)
        end = k in (shown[0], shown[-1])
        axes.plot(
            points[:, 0],
            points[:, 1],
            color=INK if end else GREY,
            linewidth=1.4 if end else 0.7,
            alpha=1.0 if end else 0.7,
        )
