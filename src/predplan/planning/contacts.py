"""What is near at a configuration, each with how its clearance changes with the joints; compiled."""

from typing import NamedTuple

import numpy as np
from numba import njit

from predplan.planning.collisions import link_gap, placed
from predplan.planning.distances import anything_within, nearest
from predplan.planning.kinematics import world_axis
from predplan.planning.robots import Chain, FloatArray, IntArray
from predplan.planning.scenes import Obstacles


class Contacts(NamedTuple):
    """Body spheres near obstacles, and links near each other, at several configurations."""

    at: IntArray  # [C] which configuration
    clearance: FloatArray  # [C] m, negative in collision
    gradient: FloatArray  # [C, D] of the clearance by the joints, m/rad


@njit(cache=True, nogil=True, error_model="numpy")
def contacts(chain: Chain, obstacles: Obstacles, q: FloatArray, reach: float, self_reach: float, most: int) -> Contacts:
    """The first `most` contacts at q [n, D]: clearances below `reach` (m) to the scene, `self_reach` between links."""
    joints = q.shape[1]
    at, clearance, gradient = np.empty(most, np.int64), np.empty(most), np.zeros((most, joints))
    count = 0
    for i in range(len(q)):
        centres, link_centres, rotations, positions = placed(chain, q[i])
        for link in range(chain.scene_link, len(chain.link_frame)):
            f = chain.link_frame[link]
            x, y, z = link_centres[link, 0], link_centres[link, 1], link_centres[link, 2]
            if not anything_within(obstacles, x, y, z, chain.link_radius[link] + reach):
                continue
            for s in range(chain.link_first[link], chain.link_first[link + 1]):
                if count == most:
                    break
                x, y, z, radius = centres[s, 0], centres[s, 1], centres[s, 2], chain.sphere_radius[s]
                distance, nx, ny, nz, obstacle = nearest(obstacles, x, y, z, radius + reach)
                if obstacle >= 0:
                    at[count], clearance[count] = i, distance - radius
                    _add_motion(chain, rotations, positions, f, centres[s], nx, ny, nz, gradient[count])
                    count += 1
        for pair in range(len(chain.link_pairs)):
            a, b = chain.link_pairs[pair, 0], chain.link_pairs[pair, 1]
            gap, s, k = link_gap(chain, a, b, link_centres, centres, self_reach)
            if s < 0 or count == most:
                continue
            nx, ny, nz = centres[s, 0] - centres[k, 0], centres[s, 1] - centres[k, 1], centres[s, 2] - centres[k, 2]
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if length > 0.0:
                nx, ny, nz = nx / length, ny / length, nz / length
                at[count], clearance[count] = i, gap
                _add_motion(chain, rotations, positions, chain.link_frame[a], centres[s], nx, ny, nz, gradient[count])
                _add_motion(
                    chain, rotations, positions, chain.link_frame[b], centres[k], -nx, -ny, -nz, gradient[count]
                )
                count += 1
    return Contacts(at[:count], clearance[:count], gradient[:count])


@njit(cache=True, nogil=True, error_model="numpy")
def _add_motion(
    chain: Chain,
    rotations: FloatArray,
    positions: FloatArray,
    frame: int,
    point: FloatArray,
    nx: float,
    ny: float,
    nz: float,
    row: FloatArray,
) -> None:
    """Add to row [D] how fast a point of the frame moves along n by unit motion of each joint."""
    for j in range(len(row)):
        if not chain.moves[frame, j]:
            continue
        ax, ay, az = world_axis(chain, rotations, j)
        if chain.prismatic[j]:
            row[j] += ax * nx + ay * ny + az * nz
        else:
            x, y, z = point[0] - positions[j + 1, 0], point[1] - positions[j + 1, 1], point[2] - positions[j + 1, 2]
            row[j] += (ay * z - az * y) * nx + (az * x - ax * z) * ny + (ax * y - ay * x) * nz
