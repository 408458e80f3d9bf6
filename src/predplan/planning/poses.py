"""Rotations from the ways in which robot and scene files write them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from predplan.planning.robots import FloatArray


class Pose(NamedTuple):
    """A frame in another: rotation [3, 3] and translation [3] m."""

    rotation: FloatArray
    translation: FloatArray

    def then(self, inner: Pose) -> Pose:
        """A pose in this frame, in the frame that this one is given in."""
        return Pose(self.rotation @ inner.rotation, self.rotation @ inner.translation + self.translation)


def identity() -> Pose:
    """The frame itself."""
    return Pose(np.eye(3), np.zeros(3))


def from_quaternion(w: float, x: float, y: float, z: float) -> FloatArray:
    """The rotation [3, 3] of a quaternion, which need not have length one but not zero."""
    w, x, y, z = np.array([w, x, y, z]) / np.sqrt(w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """URDF's roll, pitch, yaw (rad) about the fixed axes x, y, z: Rz Ry Rx."""
    return about([0, 0, 1], yaw) @ about([0, 1, 0], pitch) @ about([1, 0, 0], roll)


def about(axis: Sequence[float] | FloatArray, angle: float) -> FloatArray:
    """Rotation [3, 3] by an angle (rad) about an axis of any length but zero."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross))


def along(direction: FloatArray) -> FloatArray:
    """Some rotation [3, 3] whose third column is the direction, of any length but zero."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
