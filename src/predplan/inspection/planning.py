"""The page of planned motions: the arm in its scene, clearance and joints over time, how the methods got there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.mcap import read_provenance
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import Curves, JointStates, Solid, Transforms
from predplan.inspection.bodies import TIME, body_view, log_frames, log_solids, log_trace
from predplan.inspection.markdown import about, escape, markdown_table, viewable
from predplan.inspection.palette import ACCENT, FAINT, WARNING, rgb
from predplan.inspection.planning_plots import cost_plot, support_plot
from predplan.inspection.recording import Page, log_picture, picture_view
from predplan.palette import colour_of
from predplan.planning.plan_files import TO_ITSELF, TO_SCENE, read_plan
from predplan.planning.visuals import TOOL

Floats = NDArray[np.float64]

JOINT_COLOURS = ("#e69f00", "#3b9ede", "#12a37a", "#d55e00", "#cc79a7", "#7cc0ea", "#f0e442", "#a6a6a6")
ORDERS = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s²"))


@dataclass(frozen=True)
class Limits:
    """Of the joints, in the order of their names [D]."""

    lower: Floats  # rad or m
    upper: Floats
    velocity: Floats  # rad/s or m/s
    acceleration: Floats  # rad/s² or m/s²


@dataclass(frozen=True)
class Motion:
    """One method's trajectory."""

    method: str
    states: JointStates
    tool: Floats  # [n, 3] m: where the end effector is at the states' times
    clearance: Curves  # m, to the scene and between links
    colour: str = ""  # "#rrggbb"; by default the method's

    @property
    def shown_colour(self) -> str:
        """The colour of the method's trace and curves."""
        return self.colour or colour_of(self.method)


@dataclass(frozen=True)
class Plans:
    """What a page shows: one problem, and how one or several methods solve it; the arm moves by the first."""

    title: str
    text: str  # Markdown: what the problem is
    solids: Sequence[Solid]
    frames: Transforms  # of the first motion
    motions: Sequence[Motion]
    limits: Limits
    costs: pa.Table | None = None  # columns method, iteration, obstacle_cost, velocity_cost, acceleration_cost
    supports: Mapping[str, Sequence[Floats]] = field(default_factory=dict)  # method -> times in [0, 1], by iteration


def draw_plan(recording: rr.RecordingStream, artifact: Path) -> Page:
    """The page of a plan's recording, from what it carries. Raises InputError as `read_plan` does."""
    plan = read_plan(artifact)
    method = str(plan.facts.get("method", "motion"))
    tool = plan.frames.translation[:, plan.frames.children.index(TOOL)]
    limits = Limits(*(np.array(plan.facts["limits"][name]) for name in ("lower", "upper", "velocity", "acceleration")))
    plans = Plans(
        f"{artifact.stem}: {_who_and_where(plan.facts)}",
        _certificate(plan.facts),
        plan.solids,
        plan.frames,
        [Motion(method, plan.states, tool, plan.clearance, ACCENT)],
        limits,
    )
    return draw_plans(recording, plans, read_provenance(artifact))


def draw_plans(recording: rr.RecordingStream, plans: Plans, provenance: Provenance | None) -> Page:
    """The arm along its motion, above plots of clearance and joints; costs and support points beside it, if given."""
    parents = log_frames(recording, plans.frames)
    log_solids(recording, plans.solids, parents)
    for motion in plans.motions:
        log_trace(recording, motion.method, motion.shown_colour, motion.states.times, motion.tool)
    _log_clearance(recording, plans.motions)
    first = plans.motions[0].states
    _log_joints(recording, first, plans.limits)
    seen: list[rrb.View] = [
        body_view("Motion", plans.solids, plans.frames, np.concatenate([motion.tool for motion in plans.motions]))
    ]
    colours = {motion.method: motion.shown_colour for motion in plans.motions}
    if plans.costs is not None:
        log_picture(recording, "costs", cost_plot(plans.costs, colours))
        seen.append(picture_view("costs", "Costs by iteration"))
    if plans.supports:
        log_picture(recording, "supports", support_plot(plans.supports, colours))
        seen.append(picture_view("supports", "Support points"))
    shares = [
        _plot(f"share/{kind}", f"{kind.capitalize()} / limit", (-1.1, 1.1))
        for kind, _ in ORDERS
        if getattr(first, kind) is not None
    ]
    body = rrb.Vertical(
        rrb.Tabs(*seen) if len(seen) > 1 else seen[0],
        rrb.Horizontal(
            _plot("clearance", "Clearance [m]", _clearance_range(plans.motions)),
            rrb.Tabs(*shares, _plot("joints", "Positions [rad]", None)),
        ),
        row_shares=[2.2, 1.0],
    )
    return Page(
        plans.title,
        about(plans.title, plans.text, provenance, _summary(plans), _legend(first)),
        body,
        timeline=TIME,
        shares=(1.0, 3.2),
        playing=True,
    )


def _log_clearance(recording: rr.RecordingStream, motions: Sequence[Motion]) -> None:
    """Each method's clearance to the scene; that between links for a method alone, where it can be told apart."""
    alone = len(motions) == 1
    for motion in motions:
        kinds = [(TO_SCENE, "to the scene" if alone else motion.method, motion.shown_colour)]
        if alone:
            kinds.append((TO_ITSELF, "between links", FAINT))
        for name, called, colour in kinds:
            values = motion.clearance.values[:, motion.clearance.names.index(name)]
            path = rr.new_entity_path(["clearance", motion.method, name])
            _log_curves(recording, path, motion.clearance.times, values[:, None], [called], [colour], 2.0)
    end = max(motion.clearance.times[-1] for motion in motions)
    _log_curves(recording, "clearance/contact", np.array([0.0, end]), np.zeros((2, 1)), ["contact"], [WARNING], 1.5)


def _log_joints(recording: rr.RecordingStream, states: JointStates, limits: Limits) -> None:
    """Positions as they are, and all orders as shares of their limits, whose own lines are at -1 and 1."""
    colours = [JOINT_COLOURS[j % len(JOINT_COLOURS)] for j in range(len(states.names))]
    _log_curves(recording, "joints/position", states.times, states.position, states.names, colours, 1.8)
    middle, half = (limits.upper + limits.lower) / 2.0, (limits.upper - limits.lower) / 2.0
    ends = states.times[[0, -1]]
    for (kind, _), centre, reach in zip(
        ORDERS, (middle, 0.0, 0.0), (half, limits.velocity, limits.acceleration), strict=True
    ):
        values = getattr(states, kind)
        if values is None:
            continue
        _log_curves(
            recording, f"share/{kind}/joints", states.times, (values - centre) / reach, states.names, colours, 1.8
        )
        sides = np.array([[-1.0, 1.0], [-1.0, 1.0]])
        _log_curves(recording, f"share/{kind}/limits", ends, sides, ["lower limit", "upper limit"], [WARNING] * 2, 1.5)


def _log_curves(
    recording: rr.RecordingStream,
    path: str,
    times: Floats,
    values: Floats,
    names: Sequence[str],
    colours: Sequence[str],
    width: float,
) -> None:
    """Curves [n, K] of one entity over time."""
    lines = rr.SeriesLines(
        colors=[rgb(colour) for colour in colours],
        names=[viewable(name) for name in names],
        widths=[width] * len(names),
    )
    recording.log(path, lines, static=True)
    recording.send_columns(
        path, [rr.TimeColumn(TIME, duration=times)], rr.Scalars.columns(scalars=np.ascontiguousarray(values))
    )


def _plot(origin: str, name: str, limits: tuple[float, float] | None) -> rrb.TimeSeriesView:
    axis = None if limits is None else rrb.ScalarAxis(range=limits)
    legend = rrb.PlotLegend("RightTop", visible=limits is None or origin == "clearance")
    return rrb.TimeSeriesView(origin=origin, name=viewable(name), axis_y=axis, plot_legend=legend)


def _clearance_range(motions: Sequence[Motion]) -> tuple[float, float]:
    """From contact, or the deepest overlap, to the largest clearance, with some room."""
    values = np.concatenate([motion.clearance.values.ravel() for motion in motions])
    low, high = min(0.0, float(values.min())), max(0.05, float(values.max()))
    room = 0.06 * (high - low)
    return low - room, high + room


def _summary(plans: Plans) -> str:
    rows = []
    for motion in plans.motions:
        states, clearance = motion.states, motion.clearance
        least = {name: f"{1000.0 * clearance.values[:, k].min():.1f}" for k, name in enumerate(clearance.names)}
        length = np.linalg.norm(np.diff(states.position, axis=0), axis=1).sum()
        rows.append(
            (
                escape(motion.method),
                f"{states.times[-1]:.2f}",
                f"{length:.2f}",
                least.get(TO_SCENE, "–"),
                least.get(TO_ITSELF, "–"),
            )
        )
    header = ("method", "time \\[s\\]", "length \\[rad\\]", "clearance \\[mm\\]", "to itself \\[mm\\]")
    return markdown_table(header, rows, header[1:])


def _legend(states: JointStates) -> str:
    return (
        f"Space plays and pauses. The curves of the {len(states.names)} joints are shares of their limits, the lines "
        "at -1 and 1; another tab has them in rad."
    )


def _certificate(facts: Mapping[str, Any]) -> str:
    """What was proved of the path, in a sentence."""
    proof = facts.get("certificate")
    start = f"The motion of {escape(_who_and_where(facts))}."
    if not proof:
        return f"{start} Nothing was proved of this motion."
    if proof["free"]:
        margin = f" by at least {1000.0 * proof['margin']:g} mm" if proof["margin"] else ""
        return (
            f"{start} **Certified**: the whole path, not only what is sampled here, stays clear of the scene and of "
            f"itself{margin}, and within joint limits."
        )
    return f"{start} **Not certified**: {escape(str(proof['reason']))}."


def _who_and_where(facts: Mapping[str, Any]) -> str:
    """Robot and scene; one file may hold both."""
    robot, scene = str(facts["robot"]), str(facts["scene"])
    return robot if robot == scene else f"{robot} in {scene}"
