"""What a recording holds: joint states, poses, solids, curves, log lines and steps, as arrays over one clock.

Times are seconds on the simulation's clock, which starts at 0 and never runs back; all lengths are metres. A file keeps
times as whole nanoseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Colour: TypeAlias = tuple[float, float, float, float]
"""Red, green, blue and opacity, each 0 to 1."""

Level = Literal["unknown", "debug", "info", "warning", "error", "fatal"]

WORLD = "world"
"""The frame that does not move."""


@dataclass(frozen=True)
class JointStates:
    """Where joints were, and how fast."""

    times: FloatArray  # [n] s
    names: tuple[str, ...]
    position: FloatArray  # [n, D] rad or m
    velocity: FloatArray | None = None  # [n, D] rad/s or m/s
    acceleration: FloatArray | None = None  # [n, D] rad/s² or m/s²

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "acceleration"):
            _expect(self, name, (len(self.times), len(self.names)))


@dataclass(frozen=True)
class Transforms:
    """Poses of frames in their parents'."""

    times: FloatArray  # [n] s
    parents: tuple[str, ...]  # F names
    children: tuple[str, ...]  # F names
    translation: FloatArray  # [n, F, 3] m
    quaternion: FloatArray  # [n, F, 4], x y z w, of length 1

    def __post_init__(self) -> None:
        for name, size in (("translation", 3), ("quaternion", 4)):
            _expect(self, name, (len(self.times), len(self.children), size))


@dataclass(frozen=True)
class Curves:
    """Named numbers over time; the name says the unit, as in clearance_m."""

    times: FloatArray  # [n] s
    names: tuple[str, ...]
    values: FloatArray  # [n, K]

    def __post_init__(self) -> None:
        _expect(self, "values", (len(self.times), len(self.names)))


@dataclass(frozen=True)
class Steps:
    """Rollouts, one row a step: what was observed, what was done upon it, and what came of that.

    Episodes follow one another on one clock. Arrays of no columns stand for what was not kept.
    """

    times: FloatArray  # [n] s
    episode: IntArray  # [n], from 0
    observation: FloatArray  # [n, O]
    action: FloatArray  # [n, A]
    reward: FloatArray  # [n]
    terminated: BoolArray  # [n]
    truncated: BoolArray  # [n]
    state: FloatArray  # [n, S] predictive state
    prediction: FloatArray  # [n, P] what was predicted of the observations to come

    def __post_init__(self) -> None:
        for name in ("episode", "reward", "terminated", "truncated"):
            _expect(self, name, (len(self.times),))
        for name in ("observation", "action", "state", "prediction"):
            _expect(self, name, (len(self.times), -1))


@dataclass(frozen=True)
class Primitive:
    """A box, ellipsoid or cylinder (about z) fixed to a frame."""

    name: str
    kind: Literal["cube", "sphere", "cylinder"]
    centre: FloatArray  # [3] m, in the frame
    quaternion: FloatArray  # [4], x y z w, of length 1
    size: FloatArray  # [3] m, whole lengths along its own x, y, z
    colour: Colour
    frame: str = WORLD


@dataclass(frozen=True)
class Mesh:
    """A surface of triangles fixed to a frame, turned outwards."""

    name: str
    vertices: FloatArray  # [V, 3] m, in the frame
    triangles: IntArray  # [T, 3]
    colour: Colour
    frame: str = WORLD


Solid: TypeAlias = Primitive | Mesh


@dataclass(frozen=True)
class LogLine:
    """Something said at a time (s)."""

    time: float
    message: str
    name: str = ""  # who says it
    level: Level = "info"


def to_nanoseconds(times: FloatArray) -> IntArray:
    """Whole nanoseconds [n] of times [n] s. Raises ValueError where they are below 0, run back or are not finite."""
    if not np.all(np.isfinite(times)) or np.any(np.diff(times, prepend=0.0) < 0):
        raise ValueError("times must be finite, from 0 on, and never run back")
    return np.round(times * 1e9).astype(np.int64)


def to_seconds(nanoseconds: IntArray) -> FloatArray:
    """Times [n] s of whole nanoseconds [n]."""
    return nanoseconds / 1e9


def _expect(content: object, name: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError where a field that is there has another shape; -1 stands for any size."""
    values = getattr(content, name)
    if values is None:
        return
    found = np.shape(values)
    if len(found) != len(shape) or any(size not in (-1, got) for size, got in zip(shape, found, strict=True)):
        wanted = ", ".join("any" if size < 0 else str(size) for size in shape)
        raise ValueError(f"{type(content).__name__}.{name} has shape {found}; expected ({wanted})")
