"""Forward kinematics, compiled: where a configuration puts the frames and the spheres of the body."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from predplan.planning.robots import Chain, FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def forward(chain: Chain, q: FloatArray, rotations: FloatArray, positions: FloatArray, centres: FloatArray) -> None:
    """Frames and spheres in the world at q [D].

    Fills rotations [D + 1, 3, 3], positions [D + 1, 3] m and centres [S, 3] m.
    """
    frames(chain, q, rotations, positions)
    for s in range(chain.sphere_frame.shape[0]):
        x, y, z = to_world(rotations, positions, chain.sphere_frame[s], chain.sphere_centre, s)
        centres[s, 0], centres[s, 1], centres[s, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def frames(chain: Chain, q: FloatArray, rotations: FloatArray, positions: FloatArray) -> None:
    """The frames alone: fills rotations [D + 1, 3, 3] and positions [D + 1, 3] m."""
    for i in range(3):
        positions[0, i] = 0.0
        for k in range(3):
            rotations[0, i, k] = 1.0 if i == k else 0.0
    for j in range(q.shape[0]):
        f, p = j + 1, chain.parent[j]
        ax, ay, az = chain.axis[j, 0], chain.axis[j, 1], chain.axis[j, 2]
        tx, ty, tz = chain.translation[j, 0], chain.translation[j, 1], chain.translation[j, 2]
        for i in range(3):
            a, b, c = rotations[p, i, 0], rotations[p, i, 1], rotations[p, i, 2]
            positions[f, i] = positions[p, i] + a * tx + b * ty + c * tz
            for k in range(3):
                rotations[f, i, k] = (
                    a * chain.rotation[j, 0, k] + b * chain.rotation[j, 1, k] + c * chain.rotation[j, 2, k]
                )
        if chain.prismatic[j]:
            for i in range(3):
                positions[f, i] += q[j] * (rotations[f, i, 0] * ax + rotations[f, i, 1] * ay + rotations[f, i, 2] * az)
        else:
            # Rodrigues: R(q) = cos q I + sin q [a]x + (1 - cos q) a a', one row of the frame at a time.
            cosine, sine = math.cos(q[j]), math.sin(q[j])
            for i in range(3):
                a, b, c = rotations[f, i, 0], rotations[f, i, 1], rotations[f, i, 2]
                along = (1.0 - cosine) * (a * ax + b * ay + c * az)
                rotations[f, i, 0] = cosine * a + sine * (b * az - c * ay) + along * ax
                rotations[f, i, 1] = cosine * b + sine * (c * ax - a * az) + along * ay
                rotations[f, i, 2] = cosine * c + sine * (a * ay - b * ax) + along * az


@njit(cache=True, nogil=True, error_model="numpy")
def to_world(
    rotations: FloatArray, positions: FloatArray, frame: int, points: FloatArray, row: int
) -> tuple[float, float, float]:
    """The point points[row] of a frame, in the world."""
    x, y, z = points[row, 0], points[row, 1], points[row, 2]
    return (
        positions[frame, 0] + rotations[frame, 0, 0] * x + rotations[frame, 0, 1] * y + rotations[frame, 0, 2] * z,
        positions[frame, 1] + rotations[frame, 1, 0] * x + rotations[frame, 1, 1] * y + rotations[frame, 1, 2] * z,
        positions[frame, 2] + rotations[frame, 2, 0] * x + rotations[frame, 2, 1] * y + rotations[frame, 2, 2] * z,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def world_axis(chain: Chain, rotations: FloatArray, joint: int) -> tuple[float, float, float]:
    """The joint's axis in the world; its own turn leaves it where it is, so the moved frame gives it."""
    x, y, z = chain.axis[joint, 0], chain.axis[joint, 1], chain.axis[joint, 2]
    f = joint + 1
    return (
        rotations[f, 0, 0] * x + rotations[f, 0, 1] * y + rotations[f, 0, 2] * z,
        rotations[f, 1, 0] * x + rotations[f, 1, 1] * y + rotations[f, 1, 2] * z,
        rotations[f, 2, 0] * x + rotations[f, 2, 1] * y + rotations[f, 2, 2] * z,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def tool_position(chain: Chain, rotations: FloatArray, positions: FloatArray, point: FloatArray) -> None:
    """The tool's place in the world: fills point [3] m."""
    f = chain.tool_frame
    for i in range(3):
        point[i] = positions[f, i]
        for k in range(3):
            point[i] += rotations[f, i, k] * chain.tool_position[k]


@njit(cache=True, nogil=True, error_model="numpy")
def point_jacobian(
    chain: Chain, rotations: FloatArray, positions: FloatArray, frame: int, point: FloatArray, jacobian: FloatArray
) -> None:
    """How a point [3] m of the world that a frame carries moves with each joint: fills jacobian [3, D]."""
    for j in range(jacobian.shape[1]):
        ax, ay, az = world_axis(chain, rotations, j)
        if not chain.moves[frame, j]:
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = 0.0, 0.0, 0.0
        elif chain.prismatic[j]:
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = ax, ay, az
        else:
            f = j + 1
            x, y, z = point[0] - positions[f, 0], point[1] - positions[f, 1], point[2] - positions[f, 2]
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x


def poses(chain: Chain, configurations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Frames at configurations [n, D]: rotations [n, D + 1, 3, 3] and positions [n, D + 1, 3] m."""
    count, joints = configurations.shape
    rotations, positions = np.empty((count, joints + 1, 3, 3)), np.empty((count, joints + 1, 3))
    for i, q in enumerate(np.ascontiguousarray(configurations, dtype=np.float64)):
        frames(chain, q, rotations[i], positions[i])
    return rotations, positions


def tool_trace(chain: Chain, configurations: FloatArray) -> FloatArray:
    """Where the tool is, in the world, at configurations [n, D] -> [n, 3] m."""
    rotations, positions = poses(chain, configurations)
    return np.asarray(positions[:, chain.tool_frame] + rotations[:, chain.tool_frame] @ chain.tool_position)
