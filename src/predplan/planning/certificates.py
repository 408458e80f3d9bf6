"""A proof that a whole path, not a sample of it, is free of collision and within joint limits.

By bisection. Over a piece of path each joint stays within Δⱼ of the middle's value: the farthest Bernstein
coefficient, which bounds the polynomial. Turned one after the other from the outermost joint inwards, each joint swings
a body sphere around its axis, where the middle's kinematics put it, by at most Δⱼ times the sphere's distance from the
axis: its distance in the middle and what the joints farther out have moved it. So a sphere whose clearance in the
middle is larger than the sum is free over the whole piece. Spheres that are free are dropped, the piece is halved for
the others. What is proved does not depend on how the path is sampled or timed.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from predplan.planning.collisions import link_gap
from predplan.planning.distances import anything_within, nearest
from predplan.planning.kinematics import forward, to_world, world_axis
from predplan.planning.paths import Path
from predplan.planning.robots import Chain, FloatArray, Robot
from predplan.planning.scenes import Obstacles, Scene

FREE, COLLISION, SELF_COLLISION, LIMIT, UNDECIDED = range(5)
DEEPEST = 30
"""Halvings of a piece; a path that still touches within the margin after them is called undecided, never free."""
MOST = 1_000_000
"""Configurations looked at before a path is called undecided."""


@dataclass(frozen=True)
class Certificate:
    """What was proved of a path."""

    free: bool
    margin: float  # m: every body sphere keeps at least this from obstacles, links from each other
    configurations: int  # how many configurations were looked at
    reason: str  # empty if free; else what was found, where
    s: float  # where along the path, in [0, 1]; nan if free


class Verdict(NamedTuple):
    """The compiled part's answer."""

    kind: int  # FREE, COLLISION, ...
    s: float
    first: int  # sphere, link pair or joint
    second: int  # obstacle
    depth: float  # m
    configurations: int


def certify(robot: Robot, scene: Scene, path: Path, margin: float = 0.0) -> Certificate:
    """Prove that the path keeps `margin` (m) and the joint limits, or say where it does not."""
    breaks, coefficients = np.ascontiguousarray(path.breaks), np.ascontiguousarray(path.coefficients)
    verdict = prove(robot.chain, scene.obstacles, breaks, coefficients, margin, MOST)
    return stated(robot, scene, verdict, margin)


def stated(robot: Robot, scene: Scene, verdict: Verdict, margin: float) -> Certificate:
    """A verdict in the names of the robot and the scene."""
    reason = "" if verdict.kind == FREE else _reason(robot, scene, verdict)
    return Certificate(not reason, margin, verdict.configurations, reason, float("nan") if not reason else verdict.s)


def _reason(robot: Robot, scene: Scene, verdict: Verdict) -> str:
    chain, where = robot.chain, f"at s = {verdict.s:.4f}"
    if verdict.kind == LIMIT:
        return f"{robot.joints[verdict.first]} leaves its limits {where}"
    if verdict.kind == SELF_COLLISION:
        first, second = (robot.links[link] for link in chain.link_pairs[verdict.first])
        return f"{first} meets {second} {where}"
    if verdict.kind == COLLISION:
        link = robot.links[chain.sphere_link[verdict.first]]
        return f"{link} meets {scene.names[verdict.second]} {where}"
    return f"touches within {verdict.depth:.1e} m {where}: neither free nor in collision could be proved"


@njit(cache=True, error_model="numpy")
def prove(
    chain: Chain, obstacles: Obstacles, breaks: FloatArray, coefficients: FloatArray, margin: float, most: int
) -> Verdict:
    """Bisect every piece of the path until each sphere and link pair is proved free, or a fault is found."""
    pieces, order, joints = coefficients.shape
    spheres, pairs = len(chain.sphere_radius), len(chain.link_pairs)
    frames = joints + 1
    rotations, positions = np.empty((frames, 3, 3)), np.empty((frames, 3))
    centres, link_centres = np.empty((spheres, 3)), np.empty((len(chain.link_frame), 3))
    controls = np.empty((DEEPEST + 2, order, joints))
    left, width = np.empty(DEEPEST + 2), np.empty(DEEPEST + 2)
    open_spheres = np.empty((DEEPEST + 2, spheres), np.int64)
    open_pairs = np.empty((DEEPEST + 2, pairs), np.int64)
    counts = np.empty((DEEPEST + 2, 2), np.int64)
    middle, reach, axes = np.empty(joints), np.empty(joints), np.empty((joints, 3))
    points = np.empty((order, joints))
    looked = 0
    for piece in range(pieces):
        top = 0
        controls[0], left[0], width[0] = coefficients[piece], breaks[piece], breaks[piece + 1] - breaks[piece]
        # What stands in the scene is not tried against it (see Chain.scene_link).
        first = chain.link_first[chain.scene_link]
        open_spheres[0, : spheres - first], open_pairs[0] = np.arange(first, spheres), np.arange(pairs)
        counts[0, 0], counts[0, 1] = spheres - first, pairs
        while top >= 0:
            looked += 1
            s = left[top] + 0.5 * width[top]
            points[:] = controls[top]
            # De Casteljau at one half: `points` shrink to the middle, the halves' coefficients are the sides.
            first_half, second_half = np.empty((order, joints)), np.empty((order, joints))
            for level in range(order):
                first_half[level] = points[0]
                second_half[order - 1 - level] = points[order - 1 - level]
                for k in range(order - 1 - level):
                    for j in range(joints):
                        points[k, j] = 0.5 * (points[k, j] + points[k + 1, j])
            for j in range(joints):
                middle[j] = points[0, j]
                reach[j] = 0.0
                for k in range(order):
                    reach[j] = max(reach[j], abs(controls[top, k, j] - middle[j]))
                if middle[j] < chain.lower[j] - 1e-9 or middle[j] > chain.upper[j] + 1e-9:
                    return Verdict(LIMIT, s, j, -1, 0.0, looked)
            undecided = False
            for j in range(joints):
                for k in range(order):
                    if controls[top, k, j] < chain.lower[j] - 1e-9 or controls[top, k, j] > chain.upper[j] + 1e-9:
                        undecided = True
            forward(chain, middle, rotations, positions, centres)
            for link in range(len(link_centres)):
                x, y, z = to_world(rotations, positions, chain.link_frame[link], chain.link_centre, link)
                link_centres[link, 0], link_centres[link, 1], link_centres[link, 2] = x, y, z
            for j in range(joints):
                axes[j, 0], axes[j, 1], axes[j, 2] = world_axis(chain, rotations, j)
            remaining, near = 0, np.inf
            link, clear = -1, False
            for i in range(counts[top, 0]):
                sphere = open_spheres[top, i]
                if chain.sphere_link[sphere] != link:  # a link whose whole ball is free needs no look at its spheres
                    link = chain.sphere_link[sphere]
                    x, y, z = link_centres[link, 0], link_centres[link, 1], link_centres[link, 2]
                    moved = _displacement(
                        chain, chain.link_frame[link], 0, x, y, z, chain.link_radius[link], reach, axes, positions
                    )
                    clear = not anything_within(obstacles, x, y, z, chain.link_radius[link] + margin + moved)
                if clear:
                    continue
                radius = chain.sphere_radius[sphere] + margin
                x, y, z = centres[sphere, 0], centres[sphere, 1], centres[sphere, 2]
                moved = _displacement(chain, chain.sphere_frame[sphere], 0, x, y, z, 0.0, reach, axes, positions)
                distance, _, _, _, obstacle = nearest(obstacles, x, y, z, radius + moved)
                if distance < radius:
                    return Verdict(COLLISION, s, sphere, obstacle, radius - distance, looked)
                if obstacle >= 0:
                    near = min(near, distance - radius)
                    open_spheres[top + 1, remaining] = sphere
                    remaining += 1
            remaining_pairs = 0
            for i in range(counts[top, 1]):
                pair = open_pairs[top, i]
                a, b = chain.link_pairs[pair, 0], chain.link_pairs[pair, 1]
                moved = 0.0
                for one, other in ((a, b), (b, a)):
                    x, y, z = link_centres[one, 0], link_centres[one, 1], link_centres[one, 2]
                    frame, against = chain.link_frame[one], chain.link_frame[other]
                    moved += _displacement(
                        chain, frame, against, x, y, z, chain.link_radius[one], reach, axes, positions
                    )
                gap = link_gap(chain, a, b, link_centres, centres, moved + margin)[0]
                if gap < margin:
                    return Verdict(SELF_COLLISION, s, pair, -1, margin - gap, looked)
                if gap < margin + moved:
                    near = min(near, gap - margin)
                    open_pairs[top + 1, remaining_pairs] = pair
                    remaining_pairs += 1
            if remaining + remaining_pairs == 0 and not undecided:
                top -= 1
                continue
            if looked >= most or width[top] * 2.0**DEEPEST <= breaks[piece + 1] - breaks[piece]:
                return Verdict(UNDECIDED, s, -1, -1, near, looked)
            half = 0.5 * width[top]
            start = left[top]
            # The second half waits in this slot, the first is looked at next.
            open_spheres[top, :remaining] = open_spheres[top + 1, :remaining]
            open_pairs[top, :remaining_pairs] = open_pairs[top + 1, :remaining_pairs]
            controls[top], left[top], width[top] = second_half, start + half, half
            controls[top + 1], left[top + 1], width[top + 1] = first_half, start, half
            counts[top, 0], counts[top, 1] = remaining, remaining_pairs
            counts[top + 1, 0], counts[top + 1, 1] = remaining, remaining_pairs
            top += 1
    return Verdict(FREE, np.nan, -1, -1, 0.0, looked)


@njit(cache=True, error_model="numpy")
def _displacement(
    chain: Chain,
    frame: int,
    against: int,
    x: float,
    y: float,
    z: float,
    radius: float,
    reach: FloatArray,
    axes: FloatArray,
    positions: FloatArray,
) -> float:
    """How far (m) any point within `radius` of a point of a frame can move, seen from the frame `against`."""
    moved = 1e-9  # covers the rounding of the kinematics
    for j in range(len(reach) - 1, -1, -1):
        if not chain.moves[frame, j] or chain.moves[against, j]:
            continue
        if chain.prismatic[j]:
            moved += reach[j]
        else:
            dx, dy, dz = x - positions[j + 1, 0], y - positions[j + 1, 1], z - positions[j + 1, 2]
            ax, ay, az = axes[j, 0], axes[j, 1], axes[j, 2]
            u, v, w = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
            moved += (np.sqrt(u * u + v * v + w * w) + radius + moved) * reach[j]
    return moved
