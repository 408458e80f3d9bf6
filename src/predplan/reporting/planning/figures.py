"""Figures of costs and times in the report on planning, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from predplan.palette import colour_of
from predplan.planning.methods import MIDDLE, NARROW, WIDE, KernelKey, build_kernel
from predplan.reporting.document import Figure
from predplan.reporting.drawing import drawing_look, label_ends, new_canvas, to_svg
from predplan.reporting.planning.results import SuiteResults

SHOWN = {
    "maximum": "largest obstacle cost, m",
    "integral": "obstacle cost along the body’s way, m²",
    "velocity": "velocity cost",
    "acceleration": "acceleration cost",
}
NAMES = {
    "maximum": "largest obstacle\ncost, m",
    "integral": "obstacle cost along\nthe body’s way, m²",
    "velocity": "velocity cost",
    "acceleration": "acceleration cost",
}
"""On axes one above another."""
KERNELS = (
    (f"Gaussian σ={WIDE}", "grbf", KernelKey("gaussian", WIDE, 0)),
    (f"Gaussian σ={NARROW}", "grbf-narrow", KernelKey("gaussian", NARROW, 0)),
    (f"Gaussian + derivative σ={WIDE}", "grbf-der", KernelKey("gaussian-derivative", WIDE, 0)),
    (f"B-spline h={MIDDLE}", "b-spline", KernelKey("b-spline", MIDDLE, 0)),
    (f"Laplacian σ={WIDE}", "laplacian", KernelKey("laplacian", WIDE, 0)),
    ("waypoints, velocity", "waypoints-velocity", KernelKey("waypoints-velocity", 0.0, 48)),
    ("waypoints, acceleration", "waypoints-acceleration", KernelKey("waypoints-acceleration", 0.0, 48)),
)
CENTRES = (0.2, 0.5, 0.8)


def kernel_functions() -> Figure:
    """Figure 4.5: what one support point does to a trajectory, by kernel."""
    t = np.linspace(0.0, 1.0, 201)
    with drawing_look():
        canvas = new_canvas(3.6)
        panels = canvas.subplots(2, 4, sharex=True, sharey=True).ravel()
        for axes, (label, name, key) in zip(panels, KERNELS, strict=False):
            kernel = build_kernel(key)
            for values in kernel.gram(np.array(CENTRES), t):
                axes.plot(t, values, color=colour_of(name), linewidth=1.5)
            axes.plot(CENTRES, np.zeros(len(CENTRES)), "o", color=colour_of(name), markersize=3, clip_on=False)
            axes.set_title(label, fontsize=8)
            axes.set_xticks([0.0, 0.5, 1.0])
        panels[-1].set_visible(False)
        panels[3].tick_params(labelbottom=True)
        canvas.supxlabel("normalised time t", fontsize=9)
        canvas.supylabel("k(t, tᵢ)", fontsize=9)
        svg = to_svg(canvas)
    return Figure(
        "kernel-functions",
        svg,
        "What one support point does to a trajectory (Figure 4.5). Kernel functions of three support points (dots), "
        "conditioned on both ends and normalised to max k(t, t) = 1, as in every comparison. The wide Gaussian has "
        "practically one shape, whatever its support point.",
    )


def cost_curves(suite: SuiteResults, methods: Sequence[str], figure: str) -> Figure:
    """Obstacle, velocity and acceleration cost by iteration: a panel each."""
    measures = ("maximum", "integral", "velocity", "acceleration")
    with drawing_look():
        canvas = new_canvas(2.1 * len(measures) + 0.4)
        panels = canvas.subplots(len(measures), 1, sharex=True)
        for axes, measure in zip(panels, measures, strict=True):
            ends = []
            logarithmic = measure in ("velocity", "acceleration")
            floor = 0.0
            if logarithmic:
                axes.set_yscale("log")
                axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
                axes.yaxis.set_minor_locator(NullLocator())
                axes.yaxis.set_major_formatter("{x:g}")
                known = np.concatenate([suite.curve(method, measure)[0][1:] for method in methods])
                floor = 0.5 * float(known[known > 1e-9].min())
            for method in methods:
                mean, error = suite.curve(method, measure)
                x, colour = np.arange(len(mean)), colour_of(method)
                low, high = np.maximum(mean - error, floor), np.maximum(mean + error, floor)
                axes.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
                axes.plot(x, np.maximum(mean, floor), color=colour, linewidth=1.5)
                label = suite.methods[method].label
                ends.append((float(x[-1]), float(max(mean[-1], floor)), label, colour))
            axes.set_ylabel(NAMES[measure])
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            axes.margins(x=0.01)
            label_ends(canvas, axes, ends, gap_points=11.5 * len(measures))
        panels[-1].set_xlabel("iterations")
        svg = to_svg(canvas)
    return Figure(
        f"{suite.name}-costs",
        svg,
        f"Costs by iteration: {suite.title} ({figure}). Means over {suite.problems} problems; bands are one standard "
        "error either side. Velocity and acceleration costs are half the mean square over t in [0, 1], on logarithmic "
        "scales; the straight line, iteration 0, has no acceleration.",
    )


def dots(suite: SuiteResults, groups: Sequence[tuple[str, int]], measure: str, name: str, caption: str) -> Figure:
    """A measure of several methods, each after its own number of iterations, with standard errors."""
    with drawing_look():
        canvas = new_canvas(0.8 + 0.24 * len(groups))
        axes = canvas.add_subplot()
        for row, (method, iteration) in enumerate(reversed(groups)):
            mean, error = suite.mean(method, measure, iteration)
            axes.plot([mean - error, mean + error], [row, row], color=colour_of(method), linewidth=1.5)
            axes.plot(mean, row, "o", color=colour_of(method), markersize=5)
            axes.annotate(
                f"{mean:.3g}", (mean + error, row), (6, 0), textcoords="offset points", va="center", fontsize=8
            )
        labels = [f"{suite.methods[method].label}, {iteration} it." for method, iteration in reversed(groups)]
        axes.set_yticks(range(len(groups)), labels)
        axes.set_ylim(-0.7, len(groups) - 0.3)
        axes.set_xlim(left=0.0)
        axes.margins(x=0.12)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(SHOWN[measure])
        svg = to_svg(canvas)
    return Figure(name, svg, caption)


def iteration_times(suite: SuiteResults) -> Figure:
    """Figure 4.11: milliseconds an iteration by how many times the arm is looked at."""
    sampled = sorted({row["samples"] for row in suite.times})
    with drawing_look():
        canvas = new_canvas(3.6)
        axes = canvas.add_subplot()
        ends = []
        for method in suite.methods:
            own = [samples for samples in sampled if len(suite.time_ms(method, samples))]
            times = [suite.time_ms(method, samples) for samples in own]
            colour = colour_of(method)
            middle = [float(np.median(each)) for each in times]
            low, high = ([float(np.quantile(each, q)) for each in times] for q in (0.25, 0.75))
            axes.fill_between(own, low, high, color=colour, alpha=0.2, lw=0)
            axes.plot(own, middle, color=colour, linewidth=1.5, marker="o", markersize=3)
            ends.append((float(own[-1]), middle[-1], suite.methods[method].label, colour))
        axes.set_xticks(sampled)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("times at which the arm is looked at in an iteration")
        axes.set_ylabel("time of an iteration, ms")
        label_ends(canvas, axes, ends)
        svg = to_svg(canvas)
    descents = len(suite.time_ms(next(iter(suite.methods)), sampled[0]))
    return Figure(
        f"{suite.name}-times",
        svg,
        f"Time of an iteration: {suite.title} (Figure 4.11). Medians over {descents} descents in one process on one "
        "core, the methods taking turns; bands run from the first to the third quartile.",
    )
