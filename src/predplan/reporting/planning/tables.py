"""Tables of the report on planning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from predplan.reporting.document import Cell, Table
from predplan.reporting.planning.results import SuiteResults

REPRESENTATION = {
    "point": "worst point",
    "body": "body at the worst time",
    "integral": "integral over time",
    "path-integral": "integral by arc length",
}


def summary_table(suite: SuiteResults) -> Table:
    """Every method after the last iteration."""
    measures = ("maximum", "integral", "velocity", "acceleration")
    least = {measure: min(suite.mean(method, measure)[0] for method in suite.methods) for measure in measures}
    most = max(suite.free(method) for method in suite.methods)
    rows: list[tuple[str | Cell, ...]] = []
    for name, method in suite.methods.items():
        sections = f", {method.sections} sections" if method.reduce in ("point", "body") else ""
        cells: list[str | Cell] = [
            method.label,
            f"{REPRESENTATION[method.reduce]}{sections}",
            f"{suite.inverse_step(name):g}",
            Cell(f"{100 * suite.free(name):.0f}", best=suite.free(name) == most),
        ]
        for measure in measures:
            mean, error = suite.mean(name, measure)
            cells.append(Cell(f"{mean:.3g}", f"± {error:.1g}", best=mean == least[measure]))
        rows.append(tuple(cells))
    return Table(
        (
            "Method",
            "Cost that is descended",
            "λ",
            "Certified, %",
            "Largest, m",
            "By arc length, m²",
            "Velocity",
            "Acceleration",
        ),
        tuple(rows),
        f"{suite.title}: after {suite.iterations} iterations, {suite.problems} problems. Means and standard errors; "
        "the best of each column stands out. Certified: the whole trajectory is proved free of collision, with the "
        "scene and with itself, and within joint limits. Largest and by arc length: obstacle cost of the worst body "
        "sphere at the worst time, and along the way of all body spheres.",
    )


def tuning_table(suite: SuiteResults) -> Table:
    """What was found on the tuning problems, step by step."""
    steps = sorted({row["inverse_step"] for row in suite.steps})
    methods = list(dict.fromkeys(row["method"] for row in suite.steps))
    found = {(row["method"], row["inverse_step"]): row for row in suite.steps}
    rows: list[tuple[str | Cell, ...]] = []
    for name in methods:
        cells: list[str | Cell] = [suite.methods[name].label if name in suite.methods else name]
        for step in steps:
            row = found.get((name, step))
            value = "-" if row is None else f"{100 * row['free']:.0f}"
            cells.append(Cell(value, best=row is not None and row["chosen"]))
        rows.append(tuple(cells))
    return Table(
        ("Method", *(f"λ={step:g}" for step in steps)),
        tuple(rows),
        f"Steps tried on {suite.tuning} other problems: share certified free of collision, %. The chosen λ stands out: "
        "most are free; of equals the one with the least obstacle cost by arc length.",
    )


def time_table(suite: SuiteResults) -> Table:
    """Milliseconds of an iteration."""
    sampled = sorted({row["samples"] for row in suite.times})
    rows: list[tuple[str | Cell, ...]] = []
    for name, method in suite.methods.items():
        cells: list[str | Cell] = [method.label]
        for samples in sampled:
            times = suite.time_ms(name, samples)
            cells.append(f"{np.median(times):.2g}" if len(times) else "-")
        rows.append(tuple(cells))
    return Table(
        ("Method", *(f"{samples} times" for samples in sampled)),
        tuple(rows),
        "Time of an iteration, ms, by how many times the arm is looked at: medians, one process, one core.",
    )


def integral_table(suite: SuiteResults) -> Table:
    """Fig. 4.6: the integral of cost that is left when something else is descended."""
    pairs = (
        ("maximum instead of the integral, 5 iterations", "grbf", "chomp-velocity", 5, "5 % lower"),
        ("the same, σ narrow", "grbf-narrow", "chomp-velocity", 5, ""),
        ("maximum instead of quadrature, last iteration", "grbf", "grbf-quadrature", suite.iterations, "8 % lower"),
        ("the same, σ narrow", "grbf-narrow", "grbf-narrow-quadrature", suite.iterations, ""),
    )
    rows: list[tuple[str | Cell, ...]] = []
    for text, method, other, iteration, published in pairs:
        if method not in suite.methods or other not in suite.methods or iteration > suite.iterations:
            continue
        own, reference = (suite.mean(name, "integral", iteration)[0] for name in (method, other))
        test = suite.compared(method, other, "integral", iteration)
        tested = "-" if test is None else f"t = {test['t']:+.2f}"
        rows.append(
            (
                text,
                f"{own:.3g}",
                f"{reference:.3g}",
                Cell(f"{100 * (own / reference - 1):+.0f} %", published=published),
                tested,
            )
        )
    return Table(
        ("Descended", "Cost, m²", "Cost of the other, m²", "Change", "Test"),
        tuple(rows),
        "Obstacle cost by arc length when the maximum is descended, against an integral (Figure 4.6).",
    )


def sensitivity_table(tuned: SuiteResults, untuned: SuiteResults) -> Table:
    """Figs. 4.17 and 4.18: the same problems with steps tuned on them and with another suite's."""
    rows: list[tuple[str | Cell, ...]] = []
    for name, method in tuned.methods.items():
        if name not in untuned.methods:
            continue
        cells: list[str | Cell] = [method.label]
        for suite in (tuned, untuned):
            cells += [f"{suite.inverse_step(name):g}", f"{100 * suite.free(name):.0f}"]
            cells += [f"{suite.mean(name, measure)[0]:.3g}" for measure in ("integral", "acceleration")]
        rows.append(tuple(cells))
    header = [
        f"{when}: {what}"
        for when in ("tuned", "not tuned")
        for what in ("λ", "certified, %", "by arc length, m²", "acceleration")
    ]
    return Table(
        ("Method", *header),
        tuple(rows),
        f"What tuning is worth (Figures 4.17 and 4.18): {tuned.title}, with its own steps and with those of "
        f"{untuned.steps_of}.",
    )


def headline_table(suites: Sequence[SuiteResults]) -> Table:
    """The share of certified trajectories of the main methods, a row a suite."""
    columns = (
        ("Gaussian σ=0.9", ("grbf",)),
        ("narrower Gaussian", ("grbf-narrow", "grbf-middle")),
        ("waypoints, velocity, maximum", ("waypoints-velocity",)),
        ("CHOMP, velocity", ("chomp-velocity",)),
        ("CHOMP, acceleration", ("chomp-acceleration",)),
    )
    rows: list[tuple[str | Cell, ...]] = []
    for suite in suites:
        shown = [next((name for name in names if name in suite.methods), None) for _, names in columns]
        shares = [None if name is None else suite.free(name) for name in shown]
        best = max((share for share in shares if share is not None), default=None)
        cells = ["-" if s is None else Cell(f"{100 * s:.0f}", best=s == best) for s in shares]
        rows.append((suite.title, *cells))
    return Table(
        ("Suite", *(name for name, _ in columns)),
        tuple(rows),
        "Trajectories certified free of collision after a suite’s last iteration, %, from the straight line, one "
        "descent each. The planner, which tries many starts, does better: see the benchmark.",
    )
