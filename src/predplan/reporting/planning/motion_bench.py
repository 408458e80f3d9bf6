"""MotionBenchMaker in the report: our planner and its peers on the same problems. Rows in, tables and figures out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from predplan.palette import BLUE, DEEP_BLUE, DEEP_GREEN, GREEN, GREY, ORANGE, ROSE, SKY, SLATE, VERMILLION, YELLOW
from predplan.planning.peers import PEERS, REFERENCE
from predplan.reporting.document import Cell, Figure, Section, Table, Text
from predplan.reporting.drawing import drawing_look, label_ends, new_canvas, to_svg

Rows = Sequence[Mapping[str, Any]]

LABELS = {peer.name: peer.label for peer in PEERS}
COLOURS = {
    "cascade": VERMILLION,
    "kernel": ROSE,
    "thesis": ORANGE,
    "chomp": BLUE,
    "rrt-connect": GREY,
    "ompl-rrt-connect": GREEN,
    "ompl-rrt-connect-motions": DEEP_GREEN,
    "ompl-rrt-connect-shortcuts": SLATE,
    "ompl-bitstar": YELLOW,
    "drake": DEEP_BLUE,
    "vamp": SKY,
}
OWN = "cascade"
HOW = (
    "MotionBenchMaker’s problems for the Franka Panda (Chamzas et al. 2022), as published with VAMP: a body of 59 "
    "spheres; cylinders are taken as capsules, in the set “box” as boxes. All planners run one after the other on one "
    "core, warm; reading the scene and bringing it into a planner’s form are told apart. Whatever a planner returns "
    "becomes a path of ours, polyline or spline, and is judged alike: the certificate proves the whole path, between "
    "all samples. Velocity and acceleration costs are over the path’s own parameter, for polylines at constant speed; "
    "durations are from rest to rest within the arm’s velocity limits and 10 rad/s², and a polyline stops at its "
    "corners. "
    "Ours are drawn tight once they are certified: the least detour from the line, made by joints that have time to "
    "spare; that is part of their time. Kernel starts alone have half a second. "
    "Our planner’s settings were chosen on the seventy given problems, so there its figures are not of unseen ones."
)


def motion_bench_section(plans: Rows, summary: Rows) -> Section:
    """The whole section from the rows of the tables PLANS and SUMMARY (planning.benchmark_tables)."""
    folded = Section("Sets", (families_table(plans),), folded=True)
    blocks = (
        Text(HOW),
        planners_table(summary),
        certified_figure(plans),
        ratios_table(plans, summary),
        floor(plans),
        missing(summary),
    )
    return Section("MotionBenchMaker", blocks, (folded,))


def planners_table(summary: Rows) -> Table:
    """Every planner: success, times and paths."""
    best = max(row["certified"] for row in summary)
    rows = tuple(
        (
            LABELS[row["planner"]],
            f"{100 * row['solved']:.1f}",
            Cell(f"{100 * row['certified']:.1f}", best=row["certified"] == best > 0.0),
            _number(1e3 * row["time_s"]),
            _number(1e3 * row["time_p95_s"]),
            _number(1e3 * row["cpu_s"]),
            _number(1e3 * (row["preparation_s"] + row["conversion_s"])),
            _number(row["length_rad"]),
            _number(row["velocity_cost"]),
            _number(row["acceleration_cost"]),
            _number(1e3 * row["clearance_m"]),
            _number(row["duration_s"]),
        )
        for row in summary
    )
    header = (
        "Planner",
        "Solved, %",
        "Certified, %",
        "Time, ms",
        "95%, ms",
        "CPU, ms",
        "Conversion, ms",
        "Length, rad",
        "Velocity, rad²",
        "Acceleration, rad²",
        "Clearance, mm",
        "Duration, s",
    )
    return Table(
        header,
        rows,
        f"{max(row['runs'] for row in summary)} runs a planner. Solved: the planner says so. Certified: proved free of "
        "collision in continuous time and within joint limits. Times, lengths, costs, clearances and durations are "
        "medians over what the planner solved, the second time the 95th percentile; optimising planners use all of "
        "their second. Conversion: reading the scene and bringing it into the planner’s form, not part of the time.",
    )


def ratios_table(plans: Rows, summary: Rows) -> Table:
    """Lengths, accelerations and durations over those of RRT-Connect with simplification; times over that and ours."""
    slower = _times_over(plans, OWN)
    rows = tuple(
        (
            LABELS[row["planner"]],
            str(row["both"]),
            _number(row["length_ratio"]),
            _number(row["acceleration_ratio"]),
            _number(row["duration_ratio"]),
            _number(row["time_ratio"]),
            _number(slower.get(row["planner"], float("nan"))),
        )
        for row in summary
    )
    return Table(
        ("Planner", "Both solve", "Length", "Acceleration cost", "Duration", "Times faster", "Time over ours"),
        rows,
        f"Against {LABELS[REFERENCE]} on the problems that both solve: medians of the ratios, problem by problem. "
        f"Times faster: its median time over the planner’s. Time over ours: against {LABELS[OWN]}, on the problems "
        "that this and the planner solve, the median of the ratios.",
    )


def _times_over(plans: Rows, reference: str) -> dict[str, float]:
    """Of each planner, the median ratio of its time to the reference's on what both solve."""
    named = {
        (row["planner"], row["family"], row["number"], row["seed"]): row["time_s"] for row in plans if row["solved"]
    }
    ratios: dict[str, list[float]] = {}
    for (planner, *problem), time_s in named.items():
        if (other := named.get((reference, *problem))) is not None:
            ratios.setdefault(planner, []).append(time_s / other)
    return {planner: float(np.median(found)) for planner, found in ratios.items()}


def floor(plans: Rows) -> Text:
    """How short a duration could be at all, beside the reference's: next to nothing is faster than the line."""
    shares = [row["line_s"] / row["duration_s"] for row in plans if row["planner"] == REFERENCE and row["solved"]]
    ours = [row["duration_s"] / row["line_s"] for row in plans if row["planner"] == OWN and row["solved"]]
    said = []
    if shares:
        said.append(
            f"**What is left to gain.** A straight line from start to goal, through whatever is in the way, takes "
            f"{_number(float(np.median(shares)))} of the duration of {LABELS[REFERENCE]} (median of what that solves), "
            "and no motion within the limits takes much less: no planner’s ratio of durations can be far below that."
        )
    if ours:
        said.append(
            f"Ours take {_number(float(np.median(ours)))} times as long as the line in the median, "
            f"{_number(float(np.mean(ours)))} times on average."
        )
    return Text(" ".join(said))


def families_table(plans: Rows) -> Table:
    """Share certified, set by set."""
    families = sorted({str(row["family"]) for row in plans})
    rows = []
    for planner in dict.fromkeys(str(row["planner"]) for row in plans):
        shares = [
            np.mean([row["certified"] for row in plans if row["planner"] == planner and row["family"] == family])
            for family in families
        ]
        rows.append((LABELS[planner], *(f"{100 * share:.0f}" for share in shares)))
    return Table(("Planner", *families), tuple(rows), "Share certified, %, by set.")


def certified_figure(plans: Rows) -> Figure:
    """How many problems are solved and certified within a time."""
    planners = list(dict.fromkeys(str(row["planner"]) for row in plans))
    with drawing_look():
        canvas = new_canvas(3.8)
        axes = canvas.add_subplot()
        ends = []
        longest = max([1e3 * row["time_s"] for row in plans if row["certified"]], default=1.0)
        for planner in planners:
            mine = [row for row in plans if row["planner"] == planner]
            times = np.sort([1e3 * row["time_s"] for row in mine if row["certified"]])
            if len(times):
                shares = 100 * np.arange(1, len(times) + 1) / len(mine)
                x, y = np.append(times, longest), np.append(shares, shares[-1])
                axes.step(x, y, where="post", color=COLOURS.get(planner, GREY), linewidth=1.4)
                ends.append((longest, float(shares[-1]), LABELS[planner].split(":")[0], COLOURS.get(planner, GREY)))
        axes.set_xscale("log")
        axes.set_ylim(0, 103)
        axes.set_xlabel("time, ms")
        axes.set_ylabel("certified within that time, %")
        label_ends(canvas, axes, ends)
        svg = to_svg(canvas)
    return Figure("motion-bench-certified", svg, "Share of problems with a certified path, by the time it took.")


def missing(summary: Rows) -> Text:
    """Which planners of the comparison were not run, and what they need."""
    ran = {row["planner"] for row in summary}
    absent = [f"{peer.label} (package {peer.package or 'none'})" for peer in PEERS if peer.name not in ran]
    return Text(f"Not run here: {'; '.join(absent)}." if absent else "All planners of the comparison were run.")


def _number(value: float) -> str:
    if np.isnan(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
