"""Robots: joints in a tree, and a body of spheres that they carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from predplan.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

DEFAULT_VELOCITY = 2.0
"""rad/s or m/s, where a model states no limit: about what arms of 1 m reach allow."""
DEFAULT_ACCELERATION = 10.0
"""rad/s² or m/s²; no robot format states one. The Franka Panda's own limits are 7.5 to 20."""


class Chain(NamedTuple):
    """A robot as compiled code takes it: D joints, D + 1 frames, S spheres on L links, P pairs of links.

    Frame 0 is the world, frame j + 1 is fixed to what joint j moves. Spheres are sorted by link, links by frame.
    """

    parent: IntArray  # [D] the frame in which joint j's own frame is fixed; parent[j] <= j
    rotation: FloatArray  # [D, 3, 3] of the joint's frame in the parent frame at q = 0
    translation: FloatArray  # [D, 3] m, likewise
    axis: FloatArray  # [D, 3] unit vector in the joint's frame
    prismatic: BoolArray  # [D]
    lower: FloatArray  # [D] rad or m; a joint without limits has -2π to 2π
    upper: FloatArray  # [D]
    sphere_frame: IntArray  # [S] the frame that carries the sphere
    sphere_centre: FloatArray  # [S, 3] m, in that frame
    sphere_radius: FloatArray  # [S] m
    sphere_link: IntArray  # [S]
    link_frame: IntArray  # [L]
    link_first: IntArray  # [L + 1] link l has the spheres link_first[l] .. link_first[l + 1]
    link_centre: FloatArray  # [L, 3] m, of a sphere that holds the link's spheres, in its frame
    link_radius: FloatArray  # [L] m
    link_pairs: IntArray  # [P, 2] links a < b in different frames that must not touch
    moves: BoolArray  # [D + 1, D] joint j moves frame f
    tool_frame: int
    tool_position: FloatArray  # [3] m, in that frame
    scene_link: int  # links from this one on must not touch the scene; those before it stand in it and do not move


@dataclass(frozen=True)
class Robot:
    """A robot whose body is spheres.

    sphere_bound: the spheres cover the collision geometry that the robot was read with, and no point of theirs is
    farther than this from it; 0 where the model itself is spheres.
    """

    name: str
    joints: tuple[str, ...]
    links: tuple[str, ...]  # in the chain's order
    velocity_limit: FloatArray  # [D] rad/s or m/s
    acceleration_limit: FloatArray  # [D] rad/s² or m/s²
    chain: Chain
    fixed: Mapping[str, float] = field(default_factory=dict)  # joints not planned, and where they are held
    source: str = ""  # the file, "" if made in code
    sphere_bound: float = 0.0  # m


class Mount(NamedTuple):
    """Where a joint sits: its frame in the parent frame (0 the world, i + 1 what joint i moves) at q = 0."""

    parent: int
    rotation: FloatArray  # [3, 3]
    translation: FloatArray  # [3] m
    axis: FloatArray  # [3]
    prismatic: bool
    lower: float
    upper: float


class Link(NamedTuple):
    """Spheres on a frame: centres [n, 3] m in that frame, radii [n] m."""

    name: str
    frame: int
    centres: FloatArray
    radii: FloatArray


def make_chain(
    mounts: Sequence[Mount],
    links: Sequence[Link],
    pairs: Sequence[tuple[int, int]],
    tool: tuple[int, FloatArray] | None = None,
    stands: bool = False,
) -> Chain:
    """A chain of mounts and of links sorted by frame.

    pairs: of numbers of links; tool: its frame and place there, by default the last frame's origin; stands: whether
    links of frame 0 are part of the scene and not tried against it.
    """
    joints = len(mounts)
    moves = np.zeros((joints + 1, joints), np.bool_)
    for j, mount in enumerate(mounts):
        moves[j + 1] = moves[mount.parent]
        moves[j + 1, j] = True
    bounds = [enclosing_sphere(link.centres, link.radii) for link in links]
    tool_frame, tool_position = tool if tool is not None else (joints, np.zeros(3))
    link_of = np.repeat(np.arange(len(links)), [len(link.radii) for link in links])
    link_frame = _integers([link.frame for link in links])
    return Chain(
        parent=_integers([mount.parent for mount in mounts]),
        rotation=_floats([mount.rotation for mount in mounts], 3, 3),
        translation=_floats([mount.translation for mount in mounts], 3),
        axis=_floats([mount.axis / np.linalg.norm(mount.axis) for mount in mounts], 3),
        prismatic=np.array([mount.prismatic for mount in mounts], np.bool_),
        lower=_floats([mount.lower for mount in mounts]),
        upper=_floats([mount.upper for mount in mounts]),
        sphere_frame=link_frame[link_of],
        sphere_centre=_floats([centre for link in links for centre in link.centres], 3),
        sphere_radius=_floats([radius for link in links for radius in link.radii]),
        sphere_link=_integers(link_of),
        link_frame=link_frame,
        link_first=_integers(np.concatenate([[0], np.cumsum([len(link.radii) for link in links])])),
        link_centre=_floats([centre for centre, _ in bounds], 3),
        link_radius=_floats([radius for _, radius in bounds]),
        link_pairs=_integers(sorted({(min(pair), max(pair)) for pair in pairs})).reshape(-1, 2),
        moves=moves,
        tool_frame=int(tool_frame),
        tool_position=_floats(tool_position),
        scene_link=int(np.count_nonzero(link_frame == 0)) if stands else 0,
    )


def enclosing_sphere(centres: FloatArray, radii: FloatArray, steps: int = 200) -> tuple[FloatArray, float]:
    """A nearly smallest sphere that holds spheres (centres [n, 3], radii [n]), by Bădoiu and Clarkson's iteration."""
    if not len(radii):
        return np.zeros(3), 0.0
    centre = np.asarray((centres.min(axis=0) + centres.max(axis=0)) / 2)
    best, least = centre, np.inf
    for step in range(1, steps):
        offsets = centres - centre
        distances = np.linalg.norm(offsets, axis=1)
        reach = distances + radii
        far = int(np.argmax(reach))
        if reach[far] < least:
            best, least = centre, float(reach[far])
        if distances[far] == 0.0:
            break
        # Towards the farthest point of the farthest sphere, which lies its radius beyond its centre.
        centre = centre + offsets[far] * (reach[far] / distances[far] / (step + 1))
    return best, least


def planar_arm(
    lengths: Sequence[float], radius: float = 0.05, limit: float = np.pi, base: Sequence[float] = (0.0, 0.0)
) -> Robot:
    """An arm in the plane z = 0 from `base` (x, y in m): a joint about z for each link, `limit` rad both ways.

    A link (m) is a row of spheres of `radius` (m), no farther apart than that. Links that share a joint may touch.
    """
    sizes = [float(length) for length in lengths]
    if not sizes or min(sizes) <= 0 or radius <= 0 or limit <= 0:
        raise InputError(f"planar arm: found lengths {sizes}, radius {radius}, limit {limit}; expected positive ones")
    mounts, links = [], []
    for j, length in enumerate(sizes):
        start = np.array([sizes[j - 1], 0.0, 0.0]) if j else np.array([base[0], base[1], 0.0])
        mounts.append(Mount(j, np.eye(3), start, np.array([0.0, 0.0, 1.0]), False, -limit, limit))
        along = np.linspace(0.0, length, int(np.ceil(length / radius)) + 1)
        centres = np.stack([along, np.zeros_like(along), np.zeros_like(along)], axis=1)
        links.append(Link(f"link{j + 1}", j + 1, centres, np.full(len(along), radius)))
    pairs = [(a, b) for b in range(len(sizes)) for a in range(b - 1)]
    tool = len(sizes), np.array([sizes[-1], 0.0, 0.0])
    joints = tuple(f"joint{j + 1}" for j in range(len(sizes)))
    return _made("planar_arm", joints, links, make_chain(mounts, links, pairs, tool))


def point_robot(radius: float, lower: ArrayLike = 0.0, upper: ArrayLike = 1.0) -> Robot:
    """A disc of `radius` (m) in the plane z = 0: it slides along x and y from `lower` to `upper` (m, one or two)."""
    low, high = (np.broadcast_to(np.asarray(end, dtype=np.float64), (2,)) for end in (lower, upper))
    if radius < 0 or not np.all(low < high):
        raise InputError(f"point robot: found radius {radius}, limits {low} to {high}; expected limits that rise")
    mounts = [Mount(j, np.eye(3), np.zeros(3), np.eye(3)[j], True, float(low[j]), float(high[j])) for j in range(2)]
    links = [Link("point", 2, np.zeros((1, 3)), np.array([float(radius)]))]
    return _made("point_robot", ("x", "y"), links, make_chain(mounts, links, []))


def _made(name: str, joints: tuple[str, ...], links: Sequence[Link], chain: Chain) -> Robot:
    return Robot(
        name=name,
        joints=joints,
        links=tuple(link.name for link in links),
        velocity_limit=np.full(len(joints), DEFAULT_VELOCITY),
        acceleration_limit=np.full(len(joints), DEFAULT_ACCELERATION),
        chain=chain,
    )


def _floats(values: ArrayLike | Sequence[FloatArray], *shape: int) -> FloatArray:
    return np.ascontiguousarray(np.asarray(values, dtype=np.float64).reshape(-1, *shape))


def _integers(values: ArrayLike) -> IntArray:
    return np.ascontiguousarray(np.asarray(values, dtype=np.int64))
