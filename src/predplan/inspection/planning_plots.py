"""Plots of planning: costs by iteration, and the support points that grow in number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from predplan.inspection.figures import canvas, to_png
from predplan.inspection.palette import ACCENT, FAINT

Floats = NDArray[np.float64]

COSTS = (
    ("obstacle_cost", "obstacle cost"),
    ("velocity_cost", "½ mean of squared speed [rad²]"),
    ("acceleration_cost", "½ mean of squared acceleration [rad²]"),
)
"""Columns of the table of costs, and how they are called. Time is the path's own, 0 to 1, and has no unit."""


def cost_plot(costs: pa.Table, colours: Mapping[str, str]) -> bytes:
    """One panel a cost, one line a method, over iterations. Columns of costs: method, iteration and those of COSTS."""
    method, iteration = np.array(costs["method"].to_pylist()), costs["iteration"].to_numpy()
    with canvas((13.0, 4.6)) as figure:
        for axis, (column, label) in zip(figure.subplots(1, len(COSTS)), COSTS, strict=True):
            values = costs[column].to_numpy()
            for name in dict.fromkeys(method.tolist()):
                rows = np.flatnonzero(method == name)
                rows = rows[np.argsort(iteration[rows], kind="stable")]
                axis.plot(
                    iteration[rows], values[rows], color=colours.get(name, FAINT), linewidth=2, label=name, marker="o",
                    markersize=3.5,
                )  # fmt: skip
            positive = values[values > 1e-9 * values.max(initial=0.0)]  # rounding is no cost
            if len(positive) and positive.max() > 30 * positive.min():
                # Zero is what a descent aims at: it must stay on the axis.
                axis.set_yscale("symlog", linthresh=float(positive.min()))
                axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_ylim(bottom=0.0)
            axis.set(xlabel="iteration", ylabel=label)
            axis.xaxis.get_major_locator().set_params(integer=True)
            axis.grid(axis="y")
        axis.legend(frameon=False)
        return to_png(figure)


def support_plot(supports: Mapping[str, Sequence[Floats]], colours: Mapping[str, str]) -> bytes:
    """When the support points lie (t in [0, 1]) by iteration, those that are new marked; one panel a method."""
    with canvas((13.0, 4.6)) as figure:
        drawn = figure.subplots(1, len(supports), sharey=True, squeeze=False)[0]
        for axis, (name, points) in zip(drawn, supports.items(), strict=True):
            known: set[float] = set()
            for iteration, times in enumerate(points):
                fresh = np.array([time not in known for time in times.tolist()], bool)
                colour = colours.get(name, ACCENT)
                old, new = times[~fresh], times[fresh]
                axis.plot(np.full(len(old), iteration), old, "_", color=colour, alpha=0.55, markersize=7)
                axis.plot(np.full(len(new), iteration), new, "o", color=colour, markersize=5)
                known.update(times.tolist())
            axis.set_title(f"{name}: {len(points[-1])} support points", loc="left", fontweight="bold")
            axis.set(xlabel="iteration (dot: new, dash: kept)", ylim=(-0.02, 1.02))
            axis.xaxis.get_major_locator().set_params(integer=True)
            axis.grid(axis="y")
        drawn[0].set_ylabel("time along the path, 0 to 1")
        return to_png(figure)
