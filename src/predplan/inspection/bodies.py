"""Bodies in space: solids in the frames that carry them, frames over time, traces, and where to look from."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.recordings import WORLD, Colour, Solid, Transforms
from predplan.inspection.markdown import viewable
from predplan.inspection.palette import BACKGROUND, rgb
from predplan.inspection.surfaces import Surface, surface_of

Floats = NDArray[np.float64]

TIME = "time"
TRACES = "traces"
VAST = 10.0
"""m: a solid with a longer edge is ground or wall; the view is not made to hold it."""
_OPENING = 1.55
"""Distance from which a ball of radius 1 fills the view."""


def log_solids(recording: rr.RecordingStream, solids: Sequence[Solid], parents: Mapping[str, str]) -> None:
    """Solids for all times, one entity for those of one frame, name and colour; parents is what `log_frames` gave."""
    alike = sorted(range(len(solids)), key=lambda i: (solids[i].frame, solids[i].name, solids[i].colour))
    for (frame, name, colour), group in itertools.groupby(
        alike, key=lambda i: (solids[i].frame, solids[i].name, solids[i].colour)
    ):
        surface = surface_of([solids[i] for i in group])
        path = f"{frame_path(frame, parents)}/{rr.new_entity_path([*name.split('/'), _hexadecimal(colour)])[1:]}"
        recording.log(path, _drawn(surface, colour), static=True)


def log_frames(recording: rr.RecordingStream, frames: Transforms) -> dict[str, str]:
    """Where frames are over time; returns their parents by name, which `log_solids` takes."""
    parents = dict(zip(frames.children, frames.parents, strict=True))
    for k, child in enumerate(frames.children):
        recording.send_columns(
            frame_path(child, parents),
            [rr.TimeColumn(TIME, duration=frames.times)],
            rr.Transform3D.columns(translation=frames.translation[:, k], quaternion=frames.quaternion[:, k]),
        )
    return parents


def log_trace(recording: rr.RecordingStream, name: str, colour: str, times: Floats, points: Floats) -> None:
    """A path in space [n, 3] m for all times, its name beside it, and a ball that moves along it."""
    path = rr.new_entity_path([WORLD, TRACES, name])
    recording.log(
        path,
        rr.LineStrips3D([points], colors=[rgb(colour)], radii=[0.004], labels=[viewable(name)], show_labels=False),
        static=True,
    )
    ends = rr.Points3D(points[[0, -1]], colors=[rgb(colour)] * 2, radii=[0.012] * 2)
    recording.log(f"{path}/ends", ends, static=True)
    recording.log(f"{path}/now", rr.Points3D.from_fields(colors=[rgb(colour)], radii=[0.018]), static=True)
    recording.send_columns(f"{path}/now", [rr.TimeColumn(TIME, duration=times)], rr.Points3D.columns(positions=points))


def body_view(name: str, solids: Sequence[Solid], frames: Transforms, points: Floats) -> rrb.Spatial3DView:
    """The view of all that was logged, from where the motion is well seen. points [n, 3] m are to be in view."""
    position, target = viewpoint(solids, frames, points)
    return rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name=viewable(name),
        background=[*rgb(BACKGROUND), 255],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.25, stroke_width=1.0, color=[*rgb("#1f2328"), 255]),
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def viewpoint(solids: Sequence[Solid], frames: Transforms, points: Floats) -> tuple[Floats, Floats]:
    """Where to look from and at (m), so that the robot's whole motion and the scene near it are in view.

    Of the directions around, the one from which least of the motion is hidden; of such, the one nearest to half behind
    the robot's base and half to its side.
    """
    moving = np.concatenate([frames.translation.reshape(-1, 3), points])
    low, high = moving.min(axis=0), moving.max(axis=0)
    reach, middle = max(float(np.linalg.norm(high - low)) / 2.0, 0.1), (low + high) / 2.0
    standing = [_bounds(solid) for solid in solids if solid.frame == WORLD]
    for least, most in standing:
        if (most - least).max() < VAST and np.linalg.norm((least + most) / 2.0 - middle) < 2.0 * reach:
            low = np.minimum(low, np.maximum(least, middle - 1.5 * reach))
            high = np.maximum(high, np.minimum(most, middle + 1.5 * reach))
    centre, distance = (low + high) / 2.0, _OPENING * float(np.linalg.norm(high - low)) / 2.0
    base = frames.translation[0, 0]
    ahead = np.mean(points, axis=0) - base
    heading = np.arctan2(ahead[1], ahead[0]) if np.hypot(*ahead[:2]) > 0.05 else 0.0
    turns = np.radians([235.0, 125.0, 215.0, 145.0, 255.0, 105.0, 180.0, 280.0, 80.0, 305.0, 55.0, 0.0])
    angles = heading + np.tile(turns, 2)
    rise = np.repeat([0.35, 0.75], len(turns))
    directions = np.stack([np.cos(angles), np.sin(angles), rise], axis=1)
    positions = centre + distance * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    sample = moving[:: max(1, len(moving) // 200)]
    hidden = [_hidden(position, sample, standing) for position in positions]
    best = int(np.argmin(np.round(hidden, 1)))
    return positions[best], centre


def _bounds(solid: Solid) -> tuple[Floats, Floats]:
    vertices = surface_of([solid]).vertices
    return vertices.min(axis=0), vertices.max(axis=0)


def _hidden(eye: Floats, points: Floats, boxes: Sequence[tuple[Floats, Floats]]) -> float:
    """Share of points [n, 3] that some axis-aligned box stands before, seen from the eye [3]."""
    behind = np.zeros(len(points), bool)
    along = points - eye
    along = np.where(np.abs(along) < 1e-9, 1e-9, along)
    for low, high in boxes:
        a, b = (low - eye) / along, (high - eye) / along
        enters, leaves = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        # What encloses the point itself, as a ground or a wall's box may, does not hide it more than its own surface.
        behind |= (enters < leaves) & (leaves > 0.0) & (enters < 0.98)
    return float(behind.mean())


def frame_path(frame: str, parents: Mapping[str, str]) -> str:
    """The entity of a frame, below those of its parents."""
    names = [frame]
    while names[0] in parents:
        names.insert(0, parents[names[0]])
    return rr.new_entity_path(names if names[0] == WORLD else [WORLD, *names])


def _drawn(surface: Surface, colour: Colour) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=surface.vertices.astype(np.float32),
        vertex_normals=surface.normals.astype(np.float32),
        triangle_indices=surface.triangles.astype(np.uint32),
        albedo_factor=_bytes(colour),
    )


def _bytes(colour: Colour) -> list[int]:
    return [round(255 * part) for part in colour]


def _hexadecimal(colour: Colour) -> str:
    return "".join(f"{part:02x}" for part in _bytes(colour))
