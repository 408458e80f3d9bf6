"""What a configuration touches: validity, clearances and the workspace cost with its gradient; compiled.

Everything is culled by spheres: a link's holding sphere is tried first, its body spheres only where that is near.
Links before chain.scene_link are tried against other links, not against the scene.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from predplan.planning.distances import anything_within, nearest
from predplan.planning.kinematics import forward, frames, to_world, world_axis
from predplan.planning.robots import Chain, FloatArray, Robot
from predplan.planning.scenes import Obstacles, Scene


@njit(cache=True, nogil=True, error_model="numpy")
def valid(chain: Chain, obstacles: Obstacles, q: FloatArray, margin: float) -> bool:
    """Whether q [D] is within limits and every body sphere keeps `margin` (m) from obstacles and from other links.

    A configuration that is not finite is not valid.
    """
    for j in range(q.shape[0]):
        if not chain.lower[j] <= q[j] <= chain.upper[j]:
            return False
    joints, spheres = q.shape[0], chain.sphere_radius.shape[0]
    rotations, positions = np.empty((joints + 1, 3, 3)), np.empty((joints + 1, 3))
    centres, link_centres = np.empty((spheres, 3)), np.empty((chain.link_frame.shape[0], 3))
    frames(chain, q, rotations, positions)
    # The outermost links first: they sweep most and meet most.
    for link in range(chain.link_frame.shape[0] - 1, -1, -1):
        f = chain.link_frame[link]
        x, y, z = to_world(rotations, positions, f, chain.link_centre, link)
        link_centres[link, 0], link_centres[link, 1], link_centres[link, 2] = x, y, z
        near = link >= chain.scene_link and anything_within(obstacles, x, y, z, chain.link_radius[link] + margin)
        for s in range(chain.link_first[link], chain.link_first[link + 1]):
            x, y, z = to_world(rotations, positions, f, chain.sphere_centre, s)
            centres[s, 0], centres[s, 1], centres[s, 2] = x, y, z
            if near and anything_within(obstacles, x, y, z, chain.sphere_radius[s] + margin):
                return False
    for pair in range(chain.link_pairs.shape[0]):
        a, b = chain.link_pairs[pair, 0], chain.link_pairs[pair, 1]
        if link_gap(chain, a, b, link_centres, centres, margin)[0] < margin:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def clearances(
    chain: Chain,
    obstacles: Obstacles,
    q: FloatArray,
    ceiling: float,
    sphere_clearance: FloatArray,
    pair_clearance: FloatArray,
) -> None:
    """Signed clearances (m) at q [D], none above `ceiling`: fills sphere_clearance [S] and pair_clearance [P]."""
    centres, link_centres, _, _ = placed(chain, q)
    first = chain.link_first[chain.scene_link]
    sphere_clearance[:first] = ceiling
    for s in range(first, centres.shape[0]):
        radius = chain.sphere_radius[s]
        sphere_clearance[s] = (
            nearest(obstacles, centres[s, 0], centres[s, 1], centres[s, 2], ceiling + radius)[0] - radius
        )
    for pair in range(chain.link_pairs.shape[0]):
        a, b = chain.link_pairs[pair, 0], chain.link_pairs[pair, 1]
        pair_clearance[pair] = link_gap(chain, a, b, link_centres, centres, ceiling)[0]


@njit(cache=True, nogil=True, error_model="numpy")
def workspace_cost(clearance: float, epsilon: float) -> tuple[float, float]:
    """CHOMP's cost of a clearance (m) and its slope: 0 from epsilon on, quadratic down to contact, then linear."""
    if clearance >= epsilon:
        return 0.0, 0.0
    if clearance < 0.0:
        return 0.5 * epsilon - clearance, -1.0
    short = clearance - epsilon
    return 0.5 * short * short / epsilon, short / epsilon


@njit(cache=True, nogil=True, error_model="numpy")
def body_cost(
    chain: Chain, obstacles: Obstacles, q: FloatArray, epsilon: float, self_epsilon: float, gradient: FloatArray
) -> tuple[float, float]:
    """Workspace cost of all body spheres and, link pair by link pair, of their nearest spheres, at q [D].

    Fills gradient [D]; returns the cost and the smallest clearance (m) seen: inf where no sphere is within epsilon
    of an obstacle and no link pair within self_epsilon. epsilon and self_epsilon are the clearances that cost nothing.
    """
    centres, link_centres, rotations, positions = placed(chain, q)
    wrench = np.zeros((rotations.shape[0], 6))
    cost, least = 0.0, np.inf
    for link in range(chain.scene_link, chain.link_frame.shape[0]):
        f = chain.link_frame[link]
        x, y, z = link_centres[link, 0], link_centres[link, 1], link_centres[link, 2]
        if not anything_within(obstacles, x, y, z, chain.link_radius[link] + epsilon):
            continue
        for s in range(chain.link_first[link], chain.link_first[link + 1]):
            x, y, z, radius = centres[s, 0], centres[s, 1], centres[s, 2], chain.sphere_radius[s]
            distance, nx, ny, nz, obstacle = nearest(obstacles, x, y, z, radius + epsilon)
            if obstacle >= 0:
                value, slope = workspace_cost(distance - radius, epsilon)
                cost += value
                least = min(least, distance - radius)
                _push(wrench, f, x, y, z, slope * nx, slope * ny, slope * nz)
    for pair in range(chain.link_pairs.shape[0]):
        a, b = chain.link_pairs[pair, 0], chain.link_pairs[pair, 1]
        gap, i, k = link_gap(chain, a, b, link_centres, centres, self_epsilon)
        if i >= 0:
            value, slope = workspace_cost(gap, self_epsilon)
            cost += value
            least = min(least, gap)
            nx, ny, nz = centres[i, 0] - centres[k, 0], centres[i, 1] - centres[k, 1], centres[i, 2] - centres[k, 2]
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            scale = slope / length if length > 0.0 else 0.0
            fx, fy, fz = scale * nx, scale * ny, scale * nz
            _push(wrench, chain.link_frame[a], centres[i, 0], centres[i, 1], centres[i, 2], fx, fy, fz)
            _push(wrench, chain.link_frame[b], centres[k, 0], centres[k, 1], centres[k, 2], -fx, -fy, -fz)
    _sweep(chain, rotations, positions, wrench, gradient)
    return cost, least


@njit(cache=True, nogil=True, error_model="numpy")
def worst_cost(
    chain: Chain, obstacles: Obstacles, q: FloatArray, epsilon: float, gradient: FloatArray
) -> tuple[float, float]:
    """Workspace cost of the one body sphere nearest to an obstacle (the thesis's singleton maximum); no self-collision.

    Fills gradient [D]; returns the cost and the sphere's clearance (m), inf where no sphere is within epsilon.
    """
    centres, link_centres, rotations, positions = placed(chain, q)
    wrench = np.zeros((rotations.shape[0], 6))
    least, worst, wx, wy, wz = epsilon, -1, 0.0, 0.0, 0.0
    for link in range(chain.scene_link, chain.link_frame.shape[0]):
        x, y, z = link_centres[link, 0], link_centres[link, 1], link_centres[link, 2]
        if not anything_within(obstacles, x, y, z, chain.link_radius[link] + least):
            continue
        for s in range(chain.link_first[link], chain.link_first[link + 1]):
            radius = chain.sphere_radius[s]
            distance, nx, ny, nz, obstacle = nearest(
                obstacles, centres[s, 0], centres[s, 1], centres[s, 2], radius + least
            )
            if obstacle >= 0 and distance - radius < least:
                least, worst, wx, wy, wz = distance - radius, s, nx, ny, nz
    if worst < 0:
        gradient[:] = 0.0
        return 0.0, np.inf
    cost, slope = workspace_cost(least, epsilon)
    _push(
        wrench,
        chain.sphere_frame[worst],
        centres[worst, 0],
        centres[worst, 1],
        centres[worst, 2],
        slope * wx,
        slope * wy,
        slope * wz,
    )
    _sweep(chain, rotations, positions, wrench, gradient)
    return cost, least


@njit(cache=True, nogil=True, error_model="numpy")
def point_costs(chain: Chain, obstacles: Obstacles, q: FloatArray, epsilon: float, costs: FloatArray) -> None:
    """Workspace cost of each body sphere at q [D]: fills costs [S]."""
    centres, _, _, _ = placed(chain, q)
    first = chain.link_first[chain.scene_link]
    costs[:first] = 0.0
    for s in range(first, centres.shape[0]):
        radius = chain.sphere_radius[s]
        distance = nearest(obstacles, centres[s, 0], centres[s, 1], centres[s, 2], radius + epsilon)[0]
        costs[s] = workspace_cost(distance - radius, epsilon)[0]


@njit(cache=True, nogil=True, error_model="numpy")
def link_gap(
    chain: Chain, a: int, b: int, link_centres: FloatArray, centres: FloatArray, ceiling: float
) -> tuple[float, int, int]:
    """Signed gap (m) between links a and b, and the spheres it is between; (ceiling, -1, -1) where none is nearer."""
    reach = chain.link_radius[a] + chain.link_radius[b] + ceiling
    if reach <= 0.0 or _squared(link_centres, a, link_centres, b) >= reach * reach:
        return ceiling, -1, -1
    best, first, second = ceiling, -1, -1
    for i in range(chain.link_first[a], chain.link_first[a + 1]):
        reach = chain.sphere_radius[i] + chain.link_radius[b] + best
        if reach <= 0.0 or _squared(centres, i, link_centres, b) >= reach * reach:
            continue
        for k in range(chain.link_first[b], chain.link_first[b + 1]):
            radii = chain.sphere_radius[i] + chain.sphere_radius[k]
            squared = _squared(centres, i, centres, k)
            if radii + best > 0.0 and squared < (radii + best) * (radii + best):
                best, first, second = math.sqrt(squared) - radii, i, k
    return best, first, second


def nearest_names(robot: Robot, scene: Scene, q: FloatArray) -> list[tuple[str, str, float]]:
    """What touches what at q [D], and how deep (m), deepest first: ("panda_link5", "shelf_top", 0.012).

    A link and an obstacle, or two links; each pair once, with its deepest sphere.
    """
    chain = robot.chain
    q = np.ascontiguousarray(q, dtype=np.float64)
    rotations, positions = np.empty((len(q) + 1, 3, 3)), np.empty((len(q) + 1, 3))
    centres = np.empty_like(chain.sphere_centre)
    forward(chain, q, rotations, positions, centres)
    depths: dict[tuple[str, str], float] = {}
    for s in range(chain.link_first[chain.scene_link], len(centres)):
        x, y, z = centres[s]
        radius = float(chain.sphere_radius[s])
        distance, _, _, _, obstacle = nearest(scene.obstacles, x, y, z, radius)
        if obstacle >= 0:
            names = robot.links[chain.sphere_link[s]], scene.names[obstacle]
            depths[names] = max(depths.get(names, 0.0), radius - distance)
    apart = np.empty(len(chain.link_pairs))
    clearances(chain, scene.obstacles, q, 0.0, np.empty(len(centres)), apart)
    for (a, b), gap in zip(chain.link_pairs.tolist(), apart.tolist(), strict=True):
        if gap < 0.0:
            depths[robot.links[a], robot.links[b]] = -gap
    found = [(first, second, float(depth)) for (first, second), depth in depths.items()]
    return sorted(found, key=lambda touch: -touch[2])


@njit(cache=True, nogil=True, error_model="numpy")
def placed(chain: Chain, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Centres [S, 3], link centres [L, 3], rotations [D + 1, 3, 3] and positions [D + 1, 3] in the world at q."""
    rotations, positions = np.empty((q.shape[0] + 1, 3, 3)), np.empty((q.shape[0] + 1, 3))
    centres = np.empty((chain.sphere_radius.shape[0], 3))
    link_centres = np.empty((chain.link_frame.shape[0], 3))
    forward(chain, q, rotations, positions, centres)
    for link in range(link_centres.shape[0]):
        x, y, z = to_world(rotations, positions, chain.link_frame[link], chain.link_centre, link)
        link_centres[link, 0], link_centres[link, 1], link_centres[link, 2] = x, y, z
    return centres, link_centres, rotations, positions


@njit(cache=True, nogil=True, error_model="numpy")
def _push(wrench: FloatArray, frame: int, x: float, y: float, z: float, fx: float, fy: float, fz: float) -> None:
    """Add a force f at the point p to the frame's force and to its moment p x f about the world's origin."""
    wrench[frame, 0] += fx
    wrench[frame, 1] += fy
    wrench[frame, 2] += fz
    wrench[frame, 3] += y * fz - z * fy
    wrench[frame, 4] += z * fx - x * fz
    wrench[frame, 5] += x * fy - y * fx


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep(
    chain: Chain, rotations: FloatArray, positions: FloatArray, wrench: FloatArray, gradient: FloatArray
) -> None:
    """J'f of all forces: each joint takes what its axis feels of its frame's wrench and hands it on to the parent."""
    for j in range(gradient.shape[0] - 1, -1, -1):
        f, p = j + 1, chain.parent[j]
        fx, fy, fz = wrench[f, 0], wrench[f, 1], wrench[f, 2]
        ax, ay, az = world_axis(chain, rotations, j)
        if chain.prismatic[j]:
            gradient[j] = ax * fx + ay * fy + az * fz
        else:
            x, y, z = positions[f, 0], positions[f, 1], positions[f, 2]
            gradient[j] = (
                ax * (wrench[f, 3] - (y * fz - z * fy))
                + ay * (wrench[f, 4] - (z * fx - x * fz))
                + az * (wrench[f, 5] - (x * fy - y * fx))
            )
        for i in range(6):
            wrench[p, i] += wrench[f, i]


@njit(cache=True, nogil=True, error_model="numpy")
def _squared(a: FloatArray, i: int, b: FloatArray, k: int) -> float:
    x, y, z = a[i, 0] - b[k, 0], a[i, 1] - b[k, 1], a[i, 2] - b[k, 2]
    return float(x * x + y * y + z * z)
