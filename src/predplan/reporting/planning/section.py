"""The report on planning, put together."""

from __future__ import annotations

from collections.abc import Sequence

from predplan.reporting.document import Block, Items, Section, Text
from predplan.reporting.planning import claims, figures, pictures, tables
from predplan.reporting.planning.departures import DEPARTURES
from predplan.reporting.planning.results import SuiteResults

WHAT = (
    "A trajectory is a straight line plus an element of a reproducing kernel Hilbert space, and is pushed out of "
    "obstacles by functional gradient descent. The kernel decides what a push does to the rest of the trajectory: "
    "waypoints with a smoothness metric, as in CHOMP, are one kernel among others. Here are chapter 4’s comparisons, "
    "made again on problems drawn by seed; every last trajectory is tried by a certificate in continuous time."
)
CHOICES = (
    (
        "Kernel normalisation.",
        "All kernels are conditioned on both ends and scaled to max k(t, t) = 1. Raw, they differ by five orders of "
        "magnitude, and one step for all would decide by itself which is best.",
    ),
    (
        "Steps.",
        "λ is chosen for each method on other problems of the same kind: that which leaves most of them certified "
        "free of collision, of equals the one with the least obstacle cost. β is the same share of λ for all.",
    ),
    (
        "Smoothness.",
        "Both metrics are given, velocity and acceleration, of the whole trajectory at 101 times. A kernel that "
        "bounds accelerations is smooth in one and may not be in the other.",
    ),
    (
        "Width.",
        "σ = 0.9 as in the thesis and a narrower one. On t in [0, 1], conditioned on both ends, the wide Gaussian has "
        "practically one shape: it can bend a trajectory once.",
    ),
)
NOTHING = "No suite was run: params.yaml names none under planning.suites."


def planning_section(suites: Sequence[SuiteResults], benchmark: Section | None = None) -> Section:
    """The whole report on planning; benchmark: the section on published problems, where they were run."""
    blocks: tuple[Block, ...] = (Text(WHAT),) if suites or benchmark else (Text(WHAT), Text(NOTHING))
    sections: tuple[Section, ...] = () if benchmark is None else (benchmark,)
    if suites:
        blocks += (tables.headline_table(suites), Items(CHOICES))
        judged = Section(
            "Which claims hold",
            (Items(claims.verdicts(suites)), *account(suites)),
            (Section("Every test", (claims.claims_table(suites),), folded=True),),
        )
        sections += (judged,)
    kernels = Section("Kernels", (figures.kernel_functions(),))
    sections += (kernels, *(suite_section(suite, suites) for suite in suites))
    sections += (Section("What differs from the thesis, and why", (Items(DEPARTURES),)),)
    return Section("Planning", blocks, sections)


def account(suites: Sequence[SuiteResults]) -> tuple[Block, ...]:
    """What the numbers say of time and of the maximum, in sentences."""
    said: list[Block] = []
    for suite in suites:
        if suite.kind == "planar" and {"grbf-narrow", "chomp-velocity"} <= set(suite.methods):
            early = min(5, suite.iterations)
            maximum, integral = (suite.mean(name, "integral", early)[0] for name in ("grbf-narrow", "chomp-velocity"))
            said.append(
                Text(
                    "“The integral cost decreased by only 5% when optimizing for the max” (§4.6.3): after "
                    f"{early} iterations the cost by arc length is {maximum / integral:.2g} times that of CHOMP’s "
                    "integral when four maxima are descended with the narrow Gaussian. The integral pushes the whole "
                    "body at all times at once, the maximum four points of it."
                )
            )
        if suite.kind == "kitchen-simple":
            own, other = "grbf-jj", "chomp-velocity"
            samples = suite.methods[own].samples if own in suite.methods else 0
            times = [suite.time_ms(name, samples) for name in (own, other)]
            if all(len(each) for each in times):
                first, second = (sum(each) / len(each) for each in times)
                said.append(
                    Text(
                        "“Less time per iteration” (§4.7.4): at the same number of times an iteration takes "
                        f"{first:.2g} ms with coupled joints and one maximum, {second:.2g} ms with CHOMP; see the "
                        "figure for how it grows with the number of times."
                    )
                )
    return tuple(said)


def suite_section(suite: SuiteResults, suites: Sequence[SuiteResults]) -> Section:
    """One suite: the summary, chapter 4's figures, tuning and times."""
    blocks: list[Block] = [tables.summary_table(suite)]
    if suite.kind == "maze":
        blocks += maze_figures(suite)
    elif suite.kind == "planar":
        blocks += planar_figures(suite)
    else:
        blocks += kitchen_figures(suite, suites)
    folded = [Section("Tuning", (tables.tuning_table(suite),), folded=True)] if suite.steps else []
    if suite.times:
        drawn: tuple[Block, ...] = (tables.time_table(suite),)
        if len({row["samples"] for row in suite.times}) > 2:
            drawn = (figures.iteration_times(suite), *drawn)
        folded.append(Section("Time of an iteration", drawn, folded=suite.kind != "kitchen-simple"))
    return Section(suite.title, tuple(blocks), tuple(folded))


def maze_figures(suite: SuiteResults) -> list[Block]:
    """Figs. 4.4 and 4.9."""
    early, late = min(5, suite.iterations), min(25, suite.iterations)
    return [
        Text(
            "One maze; the problems differ only in the heights of start and goal, by 3 cm. Their tests say how sure a "
            "difference is in this maze, not in others."
        ),
        pictures.maze_panels(
            suite,
            [
                (name, 1)
                for name in (
                    "grbf-narrow",
                    "b-spline-narrow",
                    "laplacian-narrow",
                    "waypoints-velocity",
                    "waypoints-acceleration",
                    "grbf",
                )
            ],
            f"{suite.name}-one-step",
            "After one step from the straight line (Figure 4.4). Five maxima, one of each fifth of the trajectory. "
            "Dashed: the straight line; grey: the cost field.",
        ),
        pictures.maze_panels(
            suite,
            [
                ("grbf-narrow-large", early),
                ("waypoints-velocity-large", early),
                ("waypoints-acceleration-large", early),
                ("grbf-narrow", early),
                ("waypoints-velocity", late),
                ("waypoints-acceleration", late),
            ],
            f"{suite.name}-steps",
            "Large and tuned steps (Figure 4.9). Above: all with twice the step that is best after five iterations of "
            "the narrow Gaussian; below: the narrow Gaussian with that step, and waypoints with their own.",
        ),
        figures.cost_curves(
            suite,
            ("grbf", "grbf-narrow", "waypoints-velocity", "waypoints-acceleration", "waypoints-few"),
            "the quantities of Figure 4.9",
        ),
    ]


def planar_figures(suite: SuiteResults) -> list[Block]:
    """Figs. 4.6, 4.7, 4.8 and 4.16."""
    last, early = suite.iterations, min(5, suite.iterations)
    return [
        pictures.arm_panels(
            suite,
            ("grbf", "grbf-narrow", "b-spline", "laplacian", "waypoints-velocity", "waypoints-acceleration"),
            f"{suite.name}-arms",
            f"The arm after {last} iterations in the first scene (Figure 4.7). Coloured: the end effector’s way; "
            "black: start and goal; grey: the arm between them, and the cost field.",
        ),
        figures.cost_curves(
            suite,
            ("grbf", "grbf-narrow", "b-spline", "laplacian", "waypoints-velocity", "waypoints-acceleration"),
            "Figure 4.8",
        ),
        figures.dots(
            suite,
            [
                ("grbf", early),
                ("grbf-narrow", early),
                ("chomp-velocity", early),
                ("chomp-path", early),
                ("grbf", last),
                ("grbf-quadrature", last),
                ("grbf-narrow", last),
                ("grbf-narrow-quadrature", last),
            ],
            "integral",
            f"{suite.name}-integral",
            "Maximum or integral (Figure 4.6). Obstacle cost by arc length when the maximum is descended, and when an "
            "integral is. Means over the problems, lines one standard error either side.",
        ),
        tables.integral_table(suite),
        pictures.arm_panels(
            suite,
            ("waypoints-velocity", "grbf-waypoints", "grbf", "chomp-velocity", "grbf-narrow-waypoints", "grbf-narrow"),
            f"{suite.name}-points",
            "Norm or points (Figure 4.16). The end effector’s way with waypoints, with the Gaussian at twenty equally "
            "spaced times, and with the Gaussian at four maxima; below with CHOMP’s integral and the narrow Gaussian.",
            arms=False,
        ),
    ]


def kitchen_figures(suite: SuiteResults, suites: Sequence[SuiteResults]) -> list[Block]:
    """Figs. 4.10, 4.12 to 4.15, 4.17 and 4.18."""
    traced, drawn, shown = {
        "kitchen-simple": ("Figure 4.10", "the quantities of Figure 4.10", (10, suite.iterations)),
        "kitchen-cluttered": ("Figure 4.12", "Figure 4.13", (6, suite.iterations)),
        "kitchen-constrained": ("Figure 4.14", "Figure 4.15", (suite.iterations,)),
    }[suite.kind]
    if suite.borrowed:
        traced, drawn = "Figure 4.17", "Figure 4.18"
    names = ("grbf", "grbf-der", "grbf-jj", "grbf-body", "chomp-velocity", "chomp-acceleration")
    shown = tuple(dict.fromkeys(min(iteration, suite.iterations) for iteration in shown))
    blocks: list[Block] = [pictures.tool_traces(suite, names, shown, traced), figures.cost_curves(suite, names, drawn)]
    if suite.borrowed:
        tuned = [each for each in suites if each.kind == suite.kind and not each.borrowed]
        blocks += [tables.sensitivity_table(each, suite) for each in tuned]
    return blocks
