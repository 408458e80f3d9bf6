"""Views of what moves along: a camera that follows the robot, and plots that slide with time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.recordings import WORLD, Solid, Transforms
from predplan.inspection.bodies import TIME
from predplan.inspection.markdown import viewable
from predplan.inspection.palette import BACKGROUND, rgb
from predplan.inspection.surfaces import surface_of

Floats = NDArray[np.float64]
IntArray = NDArray[np.int64]

FOLLOWED = f"/{WORLD}/followed"
BEHIND, AHEAD = 120, 30
"""Steps that a sliding plot shows before and after now."""
SMOOTHED = 100
"""Steps over which the camera's way is a mean, so that it does not shake."""
LOOKED_AT = 40
"""Moments whose robots the camera is to hold."""
OPENING = 0.95
"""Distance of the camera over the size of what it is to hold."""
FAR = 1.5
"""A camera follows a robot that goes further than so many times its own size."""


@dataclass(frozen=True)
class Series:
    """How a curve looks: its name, colour and width, or the marker of its points."""

    name: str
    colour: str
    width: float
    marker: Literal["circle", "cross"] | None = None


def log_series(recording: rr.RecordingStream, path: str, times: Floats, values: Floats, *looks: Series) -> None:
    """Curves [n] or [n, K], or points of one kind, of one entity over time."""
    colours, names = [rgb(look.colour) for look in looks], [viewable(look.name) for look in looks]
    sizes = [look.width for look in looks]
    markers = [look.marker for look in looks if look.marker is not None]
    if markers:
        recording.log(
            path, rr.SeriesPoints(colors=colours, names=names, markers=markers, marker_sizes=sizes), static=True
        )
    else:
        recording.log(path, rr.SeriesLines(colors=colours, names=names, widths=sizes), static=True)
    table = np.ascontiguousarray(values.reshape(len(times), -1))
    recording.send_columns(path, [rr.TimeColumn(TIME, duration=times)], rr.Scalars.columns(scalars=table))


def sliding_plot(origin: str, name: str, step: float, legend: bool = True) -> rrb.TimeSeriesView:
    """A plot of the steps around now."""
    shown = rrb.VisibleTimeRange(
        TIME,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-BEHIND * step),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=AHEAD * step),
    )
    return rrb.TimeSeriesView(
        origin=origin,
        name=viewable(name),
        plot_legend=rrb.PlotLegend("LeftTop", visible=legend),
        axis_x=rrb.TimeAxis(view_range=shown.range),
    )


def whole_plot(origin: str, name: str, legend: bool = True) -> rrb.TimeSeriesView:
    """A plot of all time."""
    return rrb.TimeSeriesView(origin=origin, name=viewable(name), plot_legend=rrb.PlotLegend("LeftTop", visible=legend))


def robot_view(
    recording: rr.RecordingStream,
    name: str,
    frames: Transforms,
    solids: Sequence[Solid],
    first: IntArray,
    ground: float | None,
) -> rrb.Spatial3DView:
    """The robot from the side that shows its motion best. Where it goes far, the camera follows.

    first [E + 1]: rows where episodes begin, and the end; ground: its height in m.
    """
    rows = np.unique(np.linspace(0, len(frames.times) - 1, LOOKED_AT).astype(int))
    points = _surface_points(frames, solids, rows)
    way = _way(frames, first)
    follows = np.ptp(way, axis=0).max() > FAR * np.ptp(points, axis=1).max()
    if follows:
        points = points - (way[rows] - way[0])[:, None]
        recording.log(FOLLOWED, rr.Points3D([[0.0, 0.0, 0.0]], radii=[1e-4], colors=[rgb(BACKGROUND)]), static=True)
        recording.send_columns(
            FOLLOWED, [rr.TimeColumn(TIME, duration=frames.times)], rr.Transform3D.columns(translation=way)
        )
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    target = way[0] if follows else (low + high) / 2.0
    eye = target + OPENING * float(np.linalg.norm(high - low)) * _direction(points)
    grid = rrb.LineGrid3D(
        visible=True,
        spacing=0.5,
        stroke_width=1.0,
        color=[*rgb("#2a2f36"), 255],
        plane=rr.components.Plane3D.XY.with_distance(ground or 0.0),
    )
    return rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name=viewable(name),
        background=[*rgb(BACKGROUND), 255],
        line_grid=grid,
        eye_controls=rrb.EyeControls3D(
            position=eye,
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=FOLLOWED if follows else None,
        ),
    )


def _way(frames: Transforms, first: IntArray) -> Floats:
    """Where the robot is [n, 3] m: the middle of its frames, smoothed within episodes, at its mean height."""
    middle = frames.translation.mean(axis=1)
    way = np.concatenate([_smoothed(middle[a:b]) for a, b in itertools.pairwise(first)])
    way[:, 2] = middle[:, 2].mean()
    return way


def _surface_points(frames: Transforms, solids: Sequence[Solid], rows: IntArray) -> Floats:
    """Points [len(rows), V, 3] m of what moves, in the world."""
    parts = []
    for solid in solids:
        if solid.frame == WORLD:
            continue
        k = frames.children.index(solid.frame)
        vertices = surface_of([solid]).vertices
        axis, w = frames.quaternion[rows, k, None, :3], frames.quaternion[rows, k, None, 3:]
        twist = 2.0 * np.cross(axis, vertices[None])
        parts.append(vertices + w * twist + np.cross(axis, twist) + frames.translation[rows, k, None])
    return np.concatenate(parts, axis=1)


def _direction(points: Floats) -> Floats:
    """From the robot to the camera: across the plane that it moves in."""
    spread = np.ptp(points, axis=(0, 1))
    if spread[2] < 0.3 * spread[:2].max():
        seen_from = np.array([-0.2, -0.8, 1.0])
    elif spread[1] < 0.3 * spread.max():
        seen_from = np.array([0.3, -1.0, 0.2])
    else:
        seen_from = np.array([0.8, -1.0, 0.5])
    direction: Floats = seen_from / np.linalg.norm(seen_from)
    return direction


def _smoothed(values: Floats) -> Floats:
    """Mean [n, 3] over rows on both sides; before and after all rows the same motion is taken to go on."""
    half = min(SMOOTHED // 2, len(values) - 1)
    padded = np.pad(values, ((half, half), (0, 0)), "reflect", reflect_type="odd")
    kernel = np.full(2 * half + 1, 1.0 / (2 * half + 1))
    return np.stack([np.convolve(one, kernel, "valid") for one in padded.T], axis=1)
