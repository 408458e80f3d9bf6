"""A robot as files describe it, a tree of links and joints, made into a Robot: some joints planned, the others held."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from predplan.errors import InputError
from predplan.planning.collisions import clearances
from predplan.planning.poses import Pose, about, identity
from predplan.planning.robots import (
    DEFAULT_ACCELERATION,
    DEFAULT_VELOCITY,
    FloatArray,
    Link,
    Mount,
    Robot,
    make_chain,
)
from predplan.planning.scenes import Shape, make_scene
from predplan.planning.spheres import Spheres, fit_spheres

HAND_WORDS = ("finger", "gripper", "knuckle")
"""Joints so called belong to a hand and are planned only when named."""
CONTACT_SAMPLES, CONTACT_SHARE = 1000, 0.95


@dataclass(frozen=True)
class TreeJoint:
    """A joint that moves its node along or about `axis` [3] through the node's origin."""

    name: str
    axis: FloatArray
    prismatic: bool
    lower: float  # rad or m; infinite where a slide has no range
    upper: float
    velocity: float = np.nan  # rad/s or m/s; nan where the file has none
    rest: float = 0.0  # where it is held if not planned and no value is given
    mimic: tuple[str, float, float] | None = None  # other joint, multiplier, offset


@dataclass(frozen=True)
class Node:
    """A frame in its parent's; `name` is the link's, "" for a place between two joints of one body."""

    name: str
    parent: int  # -1: the world
    pose: Pose  # in the parent at rest
    joint: TreeJoint | None = None  # None: rigidly attached
    shapes: tuple[Shape, ...] = ()  # collision geometry in this frame


@dataclass(frozen=True)
class RobotTree:
    """Nodes, parents first, and the pairs of links whose contact is allowed.

    complete: `allowed` is the whole list, so that beside it only links with a joint between them are left out;
    otherwise links of two rigid groups that share a joint are left out, and links that always touch: at the centre of
    the joints' ranges and at 95% of 1000 configurations drawn evenly.
    stands: links rigid with the world were modelled in the scene and are not tried against it.
    """

    name: str
    nodes: tuple[Node, ...]
    source: str
    allowed: frozenset[frozenset[str]] = frozenset()
    complete: bool = False
    stands: bool = False


class Held(NamedTuple):
    """Where a node ends up once joints that are not planned are held: its chain frame and its pose there."""

    frame: int
    pose: Pose


def build_robot(
    tree: RobotTree,
    joints: Sequence[str],
    *,
    fixed: Mapping[str, float],
    welded: Sequence[str] = (),
    acceleration_limit: float | Sequence[float] | None = None,
    tool: str | None = None,
    sphere_tolerance: float,
) -> Robot:
    """The robot that plans `joints` (in the tree's order) and holds the others at `fixed`, or at rest.

    welded: names of the tree's fixed joints, for which a held value is accepted and has no effect.
    Raises InputError for unknown joints and links, limits that do not rise, and held values that are not finite.
    """
    movable = {node.joint.name: node.joint for node in tree.nodes if node.joint is not None}
    _check_names(tree, "joint to plan", joints, movable)
    _check_names(tree, "held joint", fixed, [*movable, *welded])
    planned = [name for name in movable if name in set(joints)]
    if not planned:
        raise InputError(f"{tree.source}: no joint to plan; the robot's movable joints are: {_list(movable)}")
    values = {name: _held_value(tree, movable, fixed, planned, name) for name in movable if name not in planned}
    mounts, places = _mount(tree, planned, values)
    order = sorted((i for i, node in enumerate(tree.nodes) if node.shapes), key=lambda i: places[i].frame)
    fitted = [
        fit_spheres(tree.nodes[i].shapes, sphere_tolerance, f"{tree.source}: {tree.nodes[i].name}") for i in order
    ]
    links = [
        Link(tree.nodes[i].name, places[i].frame, _moved(spheres, places[i].pose), spheres.radii)
        for i, spheres in zip(order, fitted, strict=True)
    ]
    pairs = [
        (a, b)
        for a, b in itertools.combinations(range(len(links)), 2)
        if links[a].frame != links[b].frame and _may_collide(tree, order[a], order[b])
    ]
    target = _tool(tree, places, tool, len(planned))
    chain = make_chain(mounts, links, pairs, (places[target].frame, places[target].pose.translation), tree.stands)
    velocities = np.array([movable[name].velocity for name in planned])
    robot = Robot(
        name=tree.name,
        joints=tuple(planned),
        links=tuple(link.name for link in links),
        velocity_limit=np.where(velocities > 0, velocities, DEFAULT_VELOCITY),
        acceleration_limit=_accelerations(tree, acceleration_limit, planned),
        chain=chain,
        fixed=values,
        source=tree.source,
        sphere_bound=max((spheres.overshoot for spheres in fitted), default=0.0),
    )
    if tree.complete:
        return robot
    touching = _always_touching(robot)
    kept = [pair for pair, touches in zip(pairs, touching, strict=True) if not touches]
    pairs_kept = np.array(kept, dtype=np.int64).reshape(-1, 2)
    return replace(robot, chain=chain._replace(link_pairs=pairs_kept))


def main_chain(tree: RobotTree) -> tuple[str, ...]:
    """The joints of the longest serial chain, without its hand.

    Joints that mimic another or are called a finger, gripper or knuckle do not count. The chain follows the longest
    branch outwards, and ends at a branching where no branch has as many joints in line as the chain has by then:
    those are fingers.
    """
    children: dict[int, list[int]] = {}
    for i, node in enumerate(tree.nodes):
        children.setdefault(node.parent, []).append(i)
    depth = np.zeros(len(tree.nodes), np.int64)
    for i in range(len(tree.nodes) - 1, -1, -1):
        further = max((depth[child] for child in children.get(i, [])), default=0)
        depth[i] = further + 1 if _counts(tree.nodes[i].joint) else further
    chain: list[str] = []
    at = -1
    while True:
        branches = sorted((i for i in children.get(at, []) if depth[i] > 0), key=lambda i: -depth[i])
        if not branches or (len(branches) > 1 and depth[branches[0]] < len(chain)):
            return tuple(chain)
        at = branches[0]
        joint = tree.nodes[at].joint
        if joint is not None and _counts(joint):
            chain.append(joint.name)


def _counts(joint: TreeJoint | None) -> bool:
    return joint is not None and joint.mimic is None and not any(word in joint.name.lower() for word in HAND_WORDS)


def _check_names(tree: RobotTree, what: str, names: Collection[str], known: Collection[str]) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(f"{tree.source}: unknown {what} {_list(unknown)}; expected some of: {_list(known)}")


def _list(names: Collection[str]) -> str:
    return ", ".join(names) or "none"


def _held_value(
    tree: RobotTree, movable: Mapping[str, TreeJoint], fixed: Mapping[str, float], planned: Sequence[str], name: str
) -> float:
    """Where a joint that is not planned is held: as given, else as the joint it mimics, else at rest."""
    joint = movable[name]
    if name in fixed:
        value = float(fixed[name])
    elif joint.mimic is None:
        value = joint.rest
    else:
        other, multiplier, offset = joint.mimic
        _check_names(tree, f"joint that {name} mimics,", [other], movable)
        if other in planned:
            raise InputError(
                f"{tree.source}: {name} mimics {other}, which is to be planned; expected a joint that is held, "
                f"or a value for {name} in `fixed`"
            )
        if movable[other].mimic is not None and other not in fixed:
            raise InputError(f"{tree.source}: {name} mimics {other}, which mimics another; expected a free joint")
        value = multiplier * float(fixed.get(other, movable[other].rest)) + offset
    if not np.isfinite(value):
        raise InputError(f"{tree.source}: the held joint {name} is {value}; expected a finite number")
    return value


def _mount(tree: RobotTree, planned: Sequence[str], values: Mapping[str, float]) -> tuple[list[Mount], list[Held]]:
    """The planned joints' mounts, and where each node is once the others are held."""
    mounts: list[Mount] = []
    places: list[Held] = []
    for node in tree.nodes:
        parent = places[node.parent] if node.parent >= 0 else Held(0, identity())
        pose = parent.pose.then(node.pose)
        joint = node.joint
        if joint is None:
            places.append(Held(parent.frame, pose))
        elif joint.name not in planned:
            places.append(Held(parent.frame, pose.then(moved_by(joint, values[joint.name]))))
        else:
            if not (np.isfinite([joint.lower, joint.upper]).all() and joint.lower < joint.upper):
                raise InputError(
                    f"{tree.source}: {joint.name} has the limits {joint.lower} to {joint.upper}; "
                    "expected two that are finite and rise"
                )
            mounts.append(Mount(parent.frame, *pose, joint.axis, joint.prismatic, joint.lower, joint.upper))
            places.append(Held(len(mounts), identity()))
    return mounts, places


def moved_by(joint: TreeJoint, value: float) -> Pose:
    """What a joint does to its frame at a value (rad or m)."""
    if joint.prismatic:
        return Pose(np.eye(3), value * joint.axis)
    return Pose(about(joint.axis, value), np.zeros(3))


def _moved(spheres: Spheres, pose: Pose) -> FloatArray:
    return np.asarray(spheres.centres @ pose.rotation.T + pose.translation)


def _may_collide(tree: RobotTree, a: int, b: int) -> bool:
    nodes = tree.nodes
    if frozenset((nodes[a].name, nodes[b].name)) in tree.allowed:
        return False
    if tree.complete:
        return _link_above(tree, a) != b and _link_above(tree, b) != a
    group_a, group_b = _rigid_group(tree, a), _rigid_group(tree, b)
    above_a, above_b = (_group_above(tree, group) for group in (group_a, group_b))
    return group_a != group_b and above_a != group_b and above_b != group_a


def _link_above(tree: RobotTree, i: int) -> int:
    """The link that link i is attached to, past the places between joints of one body."""
    i = tree.nodes[i].parent
    while i >= 0 and not tree.nodes[i].name:
        i = tree.nodes[i].parent
    return i


def _rigid_group(tree: RobotTree, i: int) -> int:
    """The first node of those rigidly attached to node i."""
    while tree.nodes[i].joint is None and tree.nodes[i].parent >= 0:
        i = tree.nodes[i].parent
    return i


def _group_above(tree: RobotTree, group: int) -> int:
    above = _link_above(tree, group)
    return _rigid_group(tree, above) if above >= 0 else -1


def _tool(tree: RobotTree, places: Sequence[Held], tool: str | None, last: int) -> int:
    """The node called `tool`, else of those rigid with the last planned joint the one farthest from it."""
    names = [node.name for node in tree.nodes]
    if tool is not None:
        _check_names(tree, "tool", [tool], [name for name in names if name])
        return names.index(tool)
    carried = [i for i, place in enumerate(places) if place.frame == last]
    return max(carried, key=lambda i: float(np.linalg.norm(places[i].pose.translation)))


def _accelerations(tree: RobotTree, limit: float | Sequence[float] | None, planned: Sequence[str]) -> FloatArray:
    given = np.asarray(DEFAULT_ACCELERATION if limit is None else limit, dtype=np.float64)
    if given.shape not in ((), (len(planned),)) or not np.all(np.isfinite(given)) or np.any(given <= 0):
        raise InputError(
            f"{tree.source}: acceleration limit {limit}; expected one positive number, "
            f"or one for each of {_list(planned)}"
        )
    return np.broadcast_to(given, (len(planned),)).copy()


def _always_touching(robot: Robot) -> list[bool]:
    chain = robot.chain
    draws = np.random.default_rng(0).uniform(chain.lower, chain.upper, (CONTACT_SAMPLES, len(chain.lower)))
    apart, spheres = np.empty((len(draws) + 1, len(chain.link_pairs))), np.empty(len(chain.sphere_radius))
    nothing = make_scene([]).obstacles
    for i, q in enumerate([(chain.lower + chain.upper) / 2, *draws]):
        clearances(chain, nothing, q, 1e-6, spheres, apart[i])
    touching = (apart[0] < 0) & (np.mean(apart[1:] < 0, axis=0) >= CONTACT_SHARE)
    return [bool(touches) for touches in touching]
