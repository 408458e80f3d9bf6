"""The page of planning in the plane: the obstacles' cost as a picture, and how each method's path moves over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import matplotlib as mpl
import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.provenance import Provenance
from predplan.inspection.markdown import about, escape, markdown_table
from predplan.inspection.palette import BACKGROUND, SEQUENTIAL, TEXT, rgb
from predplan.inspection.planning_plots import cost_plot, support_plot
from predplan.inspection.recording import Page, log_picture, picture_view
from predplan.palette import colour_of

Floats = NDArray[np.float64]

FIELD, ITERATION = "field", "iteration"


@dataclass(frozen=True)
class CostField:
    """Cost over the plane: values [H, W] at the middles of cells, rows from the lowest y, columns from the lowest x."""

    values: Floats
    x: tuple[float, float]  # m: the field's edges
    y: tuple[float, float]

    def pixels(self, points: Floats) -> Floats:
        """Where points [..., 2] m lie in the field's picture, whose first row is its highest y."""
        rows, columns = self.values.shape
        low, high = np.array([self.x[0], self.y[0]]), np.array([self.x[1], self.y[1]])
        share = (points - low) / (high - low)
        return np.stack([share[..., 0] * columns, (1.0 - share[..., 1]) * rows], axis=-1)


@dataclass(frozen=True)
class Course:
    """How one method's path moved: points [I, n, 2] m by iteration, at n equal steps of time in [0, 1]."""

    method: str
    points: Floats
    supports: Sequence[Floats] = ()  # times in [0, 1], by iteration
    colour: str = ""  # "#rrggbb"; by default the method's

    @property
    def shown_colour(self) -> str:
        """The colour of the method's path and curves."""
        return self.colour or colour_of(self.method)


@dataclass(frozen=True)
class PlanarPlans:
    """What the page shows: a field, and how one or several methods cross it."""

    title: str
    text: str  # Markdown
    cost: CostField
    courses: Sequence[Course]
    costs: pa.Table | None = None  # columns method, iteration, obstacle_cost, velocity_cost, acceleration_cost
    bodies: Sequence[Floats] = field(default_factory=tuple)  # [J, 2] m each: an arm at some times, drawn as a thin line


def draw_field(recording: rr.RecordingStream, plans: PlanarPlans, provenance: Provenance | None) -> Page:
    """The field with the paths of the shown iteration above it; costs and support points below, if given."""
    cost = plans.cost
    recording.log(f"{FIELD}/cost", rr.Image(_picture(cost.values), draw_order=-10.0), static=True)
    if plans.bodies:
        strips = [cost.pixels(body) for body in plans.bodies]
        lines = rr.LineStrips2D(strips, colors=[rgb(TEXT)], radii=rr.Radius.ui_points(0.8), draw_order=-1.0)
        recording.log(f"{FIELD}/bodies", lines, static=True)
    for course in plans.courses:
        _log_course(recording, course, cost)
    colours = {course.method: course.shown_colour for course in plans.courses}
    below: list[rrb.View] = []
    if plans.costs is not None:
        log_picture(recording, "costs", cost_plot(plans.costs, colours))
        below.append(picture_view("costs", "Costs by iteration"))
    supports = {course.method: course.supports for course in plans.courses if course.supports}
    if supports:
        log_picture(recording, "supports", support_plot(supports, colours))
        below.append(picture_view("supports", "Support points"))
    rows, columns = cost.values.shape
    view = rrb.Spatial2DView(
        origin=FIELD,
        name="Paths over the obstacles' cost",
        background=[*rgb(BACKGROUND), 255],
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, columns), y_range=(0.0, rows)),
    )
    body = rrb.Vertical(view, rrb.Tabs(*below), row_shares=[2.0, 1.0]) if below else view
    return Page(
        plans.title,
        about(plans.title, plans.text, provenance, _explanation(cost), _methods(plans.courses)),
        body,
        timeline=ITERATION,
        shares=(1.0, 2.6),
    )


def _picture(values: Floats) -> NDArray[np.uint8]:
    """The field in colours, dark where nothing is in the way, its highest y first."""
    high = max(float(np.nanmax(values)), 1e-12)
    shades = mpl.colormaps[SEQUENTIAL](0.08 + 0.84 * np.clip(values[::-1] / high, 0.0, 1.0))
    return np.round(255.0 * np.asarray(shades)[..., :3]).astype(np.uint8)


def _log_course(recording: rr.RecordingStream, course: Course, cost: CostField) -> None:
    path, colour = rr.new_entity_path([FIELD, "paths", course.method]), rgb(course.shown_colour)
    steps = [rr.TimeColumn(ITERATION, sequence=np.arange(len(course.points)))]
    lines = rr.LineStrips2D.from_fields(
        colors=[colour], radii=rr.Radius.ui_points(2.0), labels=[course.method], show_labels=False
    )
    recording.log(path, lines, static=True)
    final = rr.LineStrips2D(
        [cost.pixels(course.points[-1])], colors=[(*colour, 110)], radii=rr.Radius.ui_points(1.0), draw_order=-2.0
    )
    recording.log(f"{path}/final", final, static=True)
    strips = [[strip] for strip in cost.pixels(course.points)]
    recording.send_columns(path, steps, rr.LineStrips2D.columns(strips=strips))
    ends = rr.Points2D(cost.pixels(course.points[-1, [0, -1]]), colors=[rgb(TEXT)] * 2, radii=rr.Radius.ui_points(5.0))
    recording.log(f"{path}/ends", ends, static=True)
    if not course.supports:
        return
    style = rr.Points2D.from_fields(colors=[rgb(TEXT)], radii=rr.Radius.ui_points(3.0))
    recording.log(f"{path}/supports", style, static=True)
    times = np.linspace(0.0, 1.0, course.points.shape[1])
    last = len(course.points) - 1
    places = [
        np.stack([np.interp(at, times, course.points[min(i, last), :, k]) for k in range(2)], axis=-1)
        for i, at in enumerate(course.supports)
    ]
    recording.send_columns(
        f"{path}/supports",
        [rr.TimeColumn(ITERATION, sequence=np.arange(len(places)))],
        rr.Points2D.columns(positions=cost.pixels(np.concatenate(places))).partition([len(at) for at in places]),
    )


def _explanation(cost: CostField) -> str:
    return (
        f"The plane from x = {cost.x[0]:g} to {cost.x[1]:g} m and y = {cost.y[0]:g} to {cost.y[1]:g} m, bright where "
        "obstacles cost. Move along the iterations to see the paths move towards their ends, the thin lines; small "
        "dots are support points."
    )


def _methods(courses: Sequence[Course]) -> str:
    rows = [
        (
            escape(course.method),
            f"{len(course.points) - 1}",
            f"{np.linalg.norm(np.diff(course.points[-1], axis=0), axis=1).sum():.2f}",
            f"{len(course.supports[-1])}" if course.supports else "–",
        )
        for course in courses
    ]
    header = ("method", "iterations", "length \\[m\\]", "support points")
    return markdown_table(header, rows, header[1:])
