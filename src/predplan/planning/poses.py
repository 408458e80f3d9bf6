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


def to_quaternion(rotation: FloatArray) -> FloatArray:
    """Quaternions x y z w [..., 4] of rotations [..., 3, 3], from the largest of their squares (Shepperd 1978)."""
    diagonal = np.diagonal(rotation, axis1=-2, axis2=-1)
    trace = diagonal.sum(axis=-1, keepdims=True)
    # 4 q qᵀ; its column with the largest diagonal is the quaternion, up to length.
    product = np.empty((*rotation.shape[:-2], 4, 4))
    product[..., :3, :3] = rotation + np.swapaxes(rotation, -1, -2)
    for k in range(3):
        product[..., k, k] = 1.0 - trace[..., 0] + 2.0 * diagonal[..., k]
        i, j = (k + 1) % 3, (k + 2) % 3
        product[..., k, 3] = product[..., 3, k] = rotation[..., j, i] - rotation[..., i, j]
    product[..., 3, 3] = 1.0 + trace[..., 0]
    largest = np.argmax(np.diagonal(product, axis1=-2, axis2=-1), axis=-1)
    columns = np.take_along_axis(product, largest[..., None, None], axis=-1)[..., 0]
    return np.asarray(columns / np.linalg.norm(columns, axis=-1, keepdims=True))


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
