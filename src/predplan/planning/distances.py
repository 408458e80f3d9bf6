"""Signed distances from a point to convex obstacles, and the directions in which they grow; compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Obstacles

Signed = tuple[float, float, float, float]  # m, and the unit vector along which it grows


@njit(cache=True, nogil=True, error_model="numpy")
def count(obstacles: Obstacles) -> int:
    """How many obstacles there are: boxes, capsules, cylinders, hulls."""
    boxes, capsules = obstacles.box_centre.shape[0], obstacles.capsule_radius.shape[0]
    cylinders, hulls = obstacles.cylinder_radius.shape[0], obstacles.hull_radius.shape[0]
    return int(boxes + capsules + cylinders + hulls)


@njit(cache=True, nogil=True, error_model="numpy")
def nearest(
    obstacles: Obstacles, x: float, y: float, z: float, ceiling: float
) -> tuple[float, float, float, float, int]:
    """Signed distance (m, negative inside) of a point to the nearest obstacle, its gradient, and the obstacle's number.

    (ceiling, 0, 0, 0, -1) where none is nearer than `ceiling`.
    """
    best, bx, by, bz, which = ceiling, 0.0, 0.0, 0.0, -1
    first = 0
    for i in range(obstacles.box_centre.shape[0]):
        if box_beyond(obstacles, i, x, y, z, best):
            continue
        d, nx, ny, nz = box_distance(obstacles, i, x, y, z)
        if d < best:
            best, bx, by, bz, which = d, nx, ny, nz, i
    first += obstacles.box_centre.shape[0]
    for i in range(obstacles.capsule_radius.shape[0]):
        if capsule_beyond(obstacles, i, x, y, z, best):
            continue
        d, nx, ny, nz = capsule_distance(obstacles, i, x, y, z)
        if d < best:
            best, bx, by, bz, which = d, nx, ny, nz, first + i
    first += obstacles.capsule_radius.shape[0]
    for i in range(obstacles.cylinder_radius.shape[0]):
        d, nx, ny, nz = cylinder_distance(obstacles, i, x, y, z)
        if d < best:
            best, bx, by, bz, which = d, nx, ny, nz, first + i
    first += obstacles.cylinder_radius.shape[0]
    for i in range(obstacles.hull_radius.shape[0]):
        if hull_beyond(obstacles, i, x, y, z, best):
            continue
        d, nx, ny, nz = hull_distance(obstacles, i, x, y, z)
        if d < best:
            best, bx, by, bz, which = d, nx, ny, nz, first + i
    return best, bx, by, bz, which


@njit(cache=True, nogil=True, error_model="numpy")
def anything_within(obstacles: Obstacles, x: float, y: float, z: float, reach: float) -> bool:
    """Whether some obstacle is nearer than `reach` (m) to a point: `nearest` without naming it, so faster."""
    for i in range(obstacles.box_centre.shape[0]):
        if not box_beyond(obstacles, i, x, y, z, reach) and (
            reach > 0.0 or box_distance(obstacles, i, x, y, z)[0] < reach
        ):
            return True
    for i in range(obstacles.capsule_radius.shape[0]):
        if not capsule_beyond(obstacles, i, x, y, z, reach):
            return True
    for i in range(obstacles.cylinder_radius.shape[0]):
        if cylinder_distance(obstacles, i, x, y, z)[0] < reach:
            return True
    for i in range(obstacles.hull_radius.shape[0]):
        if not hull_beyond(obstacles, i, x, y, z, reach) and hull_distance(obstacles, i, x, y, z)[0] < reach:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def box_beyond(obstacles: Obstacles, i: int, x: float, y: float, z: float, reach: float) -> bool:
    """True only if box i is at least `reach` away; exact, and without a root, where reach > 0."""
    if reach <= 0.0:
        return False
    u, v, w = local(obstacles.box_rotation, obstacles.box_centre, i, x, y, z)
    u = max(abs(u) - obstacles.box_half[i, 0], 0.0)
    v = max(abs(v) - obstacles.box_half[i, 1], 0.0)
    w = max(abs(w) - obstacles.box_half[i, 2], 0.0)
    return bool(u * u + v * v + w * w >= reach * reach)


@njit(cache=True, nogil=True, error_model="numpy")
def box_distance(obstacles: Obstacles, i: int, x: float, y: float, z: float) -> Signed:
    """To box i; inside, to the nearest face."""
    u, v, w = local(obstacles.box_rotation, obstacles.box_centre, i, x, y, z)
    su, sv, sw = math.copysign(1.0, u), math.copysign(1.0, v), math.copysign(1.0, w)
    ou = abs(u) - obstacles.box_half[i, 0]
    ov = abs(v) - obstacles.box_half[i, 1]
    ow = abs(w) - obstacles.box_half[i, 2]
    if ou <= 0.0 and ov <= 0.0 and ow <= 0.0:
        if ou >= ov and ou >= ow:
            d, gu, gv, gw = ou, su, 0.0, 0.0
        elif ov >= ow:
            d, gu, gv, gw = ov, 0.0, sv, 0.0
        else:
            d, gu, gv, gw = ow, 0.0, 0.0, sw
    else:
        ou, ov, ow = max(ou, 0.0), max(ov, 0.0), max(ow, 0.0)
        d = math.sqrt(ou * ou + ov * ov + ow * ow)
        gu, gv, gw = su * ou / d, sv * ov / d, sw * ow / d
    nx, ny, nz = outward(obstacles.box_rotation, i, gu, gv, gw)
    return d, nx, ny, nz


@njit(cache=True, nogil=True, error_model="numpy")
def capsule_offset(obstacles: Obstacles, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """From the nearest point of capsule i's segment to the point."""
    ax, ay, az = obstacles.capsule_a[i, 0], obstacles.capsule_a[i, 1], obstacles.capsule_a[i, 2]
    dx, dy, dz = (
        obstacles.capsule_b[i, 0] - ax,
        obstacles.capsule_b[i, 1] - ay,
        obstacles.capsule_b[i, 2] - az,
    )
    x, y, z = x - ax, y - ay, z - az
    squared = dx * dx + dy * dy + dz * dz
    t = min(max((x * dx + y * dy + z * dz) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return x - t * dx, y - t * dy, z - t * dz


@njit(cache=True, nogil=True, error_model="numpy")
def capsule_beyond(obstacles: Obstacles, i: int, x: float, y: float, z: float, reach: float) -> bool:
    """Whether capsule i is at least `reach` away."""
    ox, oy, oz = capsule_offset(obstacles, i, x, y, z)
    full = reach + obstacles.capsule_radius[i]
    return bool(full <= 0.0 or ox * ox + oy * oy + oz * oz >= full * full)


@njit(cache=True, nogil=True, error_model="numpy")
def capsule_distance(obstacles: Obstacles, i: int, x: float, y: float, z: float) -> Signed:
    """To capsule i; on its segment the direction is taken as z, any being as good."""
    ox, oy, oz = capsule_offset(obstacles, i, x, y, z)
    d = math.sqrt(ox * ox + oy * oy + oz * oz)
    if d < 1e-12:
        return -obstacles.capsule_radius[i], 0.0, 0.0, 1.0
    return d - obstacles.capsule_radius[i], ox / d, oy / d, oz / d


@njit(cache=True, nogil=True, error_model="numpy")
def cylinder_distance(obstacles: Obstacles, i: int, x: float, y: float, z: float) -> Signed:
    """To cylinder i; inside, to its wall or nearer end. On its axis the direction is taken as its first column."""
    u, v, w = local(obstacles.cylinder_rotation, obstacles.cylinder_centre, i, x, y, z)
    across = math.sqrt(u * u + v * v)
    cu, cv = (u / across, v / across) if across > 1e-12 else (1.0, 0.0)
    wall, end = across - obstacles.cylinder_radius[i], abs(w) - obstacles.cylinder_half[i]
    side = math.copysign(1.0, w)
    if wall > 0.0 and end > 0.0:
        d = math.sqrt(wall * wall + end * end)
        gr, gw = wall / d, side * end / d
    elif wall > end:
        d, gr, gw = wall, 1.0, 0.0
    else:
        d, gr, gw = end, 0.0, side
    nx, ny, nz = outward(obstacles.cylinder_rotation, i, gr * cu, gr * cv, gw)
    return d, nx, ny, nz


@njit(cache=True, nogil=True, error_model="numpy")
def hull_beyond(obstacles: Obstacles, i: int, x: float, y: float, z: float, reach: float) -> bool:
    """True only if hull i is at least `reach` away: its sphere or one of its planes shows it."""
    cx, cy, cz = (
        x - obstacles.hull_centre[i, 0],
        y - obstacles.hull_centre[i, 1],
        z - obstacles.hull_centre[i, 2],
    )
    full = reach + obstacles.hull_radius[i]
    if full <= 0.0 or cx * cx + cy * cy + cz * cz >= full * full:
        return True
    plane = obstacles.plane
    for k in range(obstacles.hull_first[i], obstacles.hull_first[i + 1]):
        if plane[k, 0] * x + plane[k, 1] * y + plane[k, 2] * z + plane[k, 3] >= reach:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def hull_distance(obstacles: Obstacles, i: int, x: float, y: float, z: float) -> Signed:
    """To hull i: inside, to the nearest plane; outside, to the nearest triangle that faces the point."""
    plane, triangle = obstacles.plane, obstacles.triangle
    most, face = -np.inf, -1
    nearest_squared, cx, cy, cz = np.inf, 0.0, 0.0, 0.0
    for k in range(obstacles.hull_first[i], obstacles.hull_first[i + 1]):
        above = plane[k, 0] * x + plane[k, 1] * y + plane[k, 2] * z + plane[k, 3]
        if above > most:
            most, face = above, k
        if above > 0.0 and above * above < nearest_squared:
            px, py, pz = triangle_offset(triangle, k, x, y, z)
            squared = px * px + py * py + pz * pz
            if squared < nearest_squared:
                nearest_squared, cx, cy, cz = squared, px, py, pz
    if most > 0.0 and nearest_squared > 1e-24:
        d = math.sqrt(nearest_squared)
        return d, cx / d, cy / d, cz / d
    return most, plane[face, 0], plane[face, 1], plane[face, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def triangle_offset(triangle: FloatArray, k: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """From the nearest point of triangle k to the point (Ericson 2005, 5.1.5): by corner, edge, then inside."""
    ax, ay, az = x - triangle[k, 0, 0], y - triangle[k, 0, 1], z - triangle[k, 0, 2]
    ux = triangle[k, 1, 0] - triangle[k, 0, 0]
    uy = triangle[k, 1, 1] - triangle[k, 0, 1]
    uz = triangle[k, 1, 2] - triangle[k, 0, 2]
    vx = triangle[k, 2, 0] - triangle[k, 0, 0]
    vy = triangle[k, 2, 1] - triangle[k, 0, 1]
    vz = triangle[k, 2, 2] - triangle[k, 0, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    # Products of the edges u = b - a and v = c - a with the point seen from corners a, b and c.
    au, av = ux * ax + uy * ay + uz * az, vx * ax + vy * ay + vz * az
    bu, bv, cu, cv = au - uu, av - uv, au - uv, av - vv
    if au <= 0.0 and av <= 0.0:
        s, t = 0.0, 0.0
    elif bu >= 0.0 and bv <= bu:
        s, t = 1.0, 0.0
    elif cv >= 0.0 and cu <= cv:
        s, t = 0.0, 1.0
    else:
        beyond_ab, beyond_ac, beyond_bc = au * bv - bu * av, cu * av - au * cv, bu * cv - cu * bv
        if beyond_ab <= 0.0 and au >= 0.0 and bu <= 0.0:
            s, t = au / (au - bu), 0.0
        elif beyond_ac <= 0.0 and av >= 0.0 and cv <= 0.0:
            s, t = 0.0, av / (av - cv)
        elif beyond_bc <= 0.0 and bv - bu >= 0.0 and cu - cv >= 0.0:
            t = (bv - bu) / ((bv - bu) + (cu - cv))
            s = 1.0 - t
        else:
            whole = beyond_ab + beyond_ac + beyond_bc
            s, t = beyond_ac / whole, beyond_ab / whole
    return ax - s * ux - t * vx, ay - s * uy - t * vy, az - s * uz - t * vz


@njit(cache=True, nogil=True, error_model="numpy")
def local(rotation: FloatArray, centre: FloatArray, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point of the world seen from obstacle i: R'(p - c)."""
    x, y, z = x - centre[i, 0], y - centre[i, 1], z - centre[i, 2]
    return (
        rotation[i, 0, 0] * x + rotation[i, 1, 0] * y + rotation[i, 2, 0] * z,
        rotation[i, 0, 1] * x + rotation[i, 1, 1] * y + rotation[i, 2, 1] * z,
        rotation[i, 0, 2] * x + rotation[i, 1, 2] * y + rotation[i, 2, 2] * z,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def outward(rotation: FloatArray, i: int, u: float, v: float, w: float) -> tuple[float, float, float]:
    """A direction seen from obstacle i in the world: R g."""
    return (
        rotation[i, 0, 0] * u + rotation[i, 0, 1] * v + rotation[i, 0, 2] * w,
        rotation[i, 1, 0] * u + rotation[i, 1, 1] * v + rotation[i, 1, 2] * w,
        rotation[i, 2, 0] * u + rotation[i, 2, 1] * v + rotation[i, 2, 2] * w,
    )
