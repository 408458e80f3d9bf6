"""URDF and SRDF: links, joints, collision geometry, planning groups and the pairs of links that may touch."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from predplan.errors import InputError
from predplan.planning.mesh_files import find_mesh, read_vertices
from predplan.planning.poses import Pose, from_rpy
from predplan.planning.robot_trees import Node, RobotTree, TreeJoint
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, moved

FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class Semantics:
    """What an SRDF adds: the joints of each group, and pairs of links whose contact is allowed."""

    groups: Mapping[str, tuple[str, ...]]
    main: str | None  # the first group that is a chain, or else the first
    allowed: frozenset[frozenset[str]]


def parse_xml(path: Path | str) -> ET.Element:
    """The root element; raises InputError with file and line where the text is not XML."""
    try:
        return ET.parse(path).getroot()
    except OSError as error:
        raise InputError(f"{path}: no such file" if not Path(path).is_file() else f"{path}: {error}") from error
    except (ET.ParseError, UnicodeDecodeError, ValueError) as error:
        line = getattr(error, "position", ("?",))[0]
        raise InputError(f"{path}:{line}: not XML ({error})") from error


def read_urdf(path: Path | str) -> tuple[RobotTree, tuple[str, ...]]:
    """The tree, and the names of its fixed joints. Links that no joint carries stand in the world.

    Raises InputError for a joint of an unknown or unsupported kind, a link that is not there, limits that are missing,
    geometry of an unknown kind or with wrong numbers, a mesh file that is missing, a loop.
    """
    root = parse_xml(path)
    if root.tag != "robot":
        raise InputError(f"{path}: the root element is <{root.tag}>; expected <robot>")
    links = {_name(link, path): link for link in root.findall("link")}
    carrying: dict[str, ET.Element] = {}
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            if _end(joint, end, path) not in links:
                raise InputError(
                    f"{path}: the joint {_name(joint, path)} has the {end} {_end(joint, end, path)!r}, "
                    f"which is no link; expected one of: {', '.join(links)}"
                )
        child = _end(joint, "child", path)
        if child in carrying:
            raise InputError(f"{path}: two joints carry the link {child}; expected a tree")
        carrying[child] = joint
    if not links or len(carrying) == len(links):
        raise InputError(f"{path}: {len(links)} links and none to start from; expected a link that no joint carries")
    nodes: list[Node] = []
    number: dict[str, int] = {}
    waiting = list(links)
    while waiting:
        ready = [name for name in waiting if name not in carrying or _end(carrying[name], "parent", path) in number]
        if not ready:
            raise InputError(f"{path}: the links {', '.join(waiting)} hang in a loop; expected a tree")
        for name in ready:
            shapes = tuple(shape for part in links[name].findall("collision") for shape in _shapes(part, name, path))
            if name not in carrying:
                nodes.append(Node(name, -1, Pose(np.eye(3), np.zeros(3)), None, shapes))
            else:
                joint = carrying[name]
                parent = number[_end(joint, "parent", path)]
                nodes.append(Node(name, parent, _origin(joint, _name(joint, path), path), _joint(joint, path), shapes))
            number[name] = len(nodes) - 1
        waiting = [name for name in waiting if name not in number]
    welded = tuple(_name(joint, path) for joint in carrying.values() if joint.get("type") == "fixed")
    return RobotTree(root.get("name", Path(path).stem), _in_depth(nodes), str(path)), welded


def read_srdf(path: Path | str, tree: RobotTree) -> Semantics:
    """Groups (chains, joints, links, other groups) as their movable joints, and the disabled pairs."""
    root = parse_xml(path)
    if root.tag != "robot":
        raise InputError(f"{path}: the root element is <{root.tag}>; expected <robot>")
    allowed = frozenset(
        frozenset((pair.get("link1", ""), pair.get("link2", ""))) for pair in root.findall("disable_collisions")
    )
    groups: dict[str, tuple[str, ...]] = {}
    for group in root.findall("group"):
        members = _members(group, groups, tree, path)
        names = [node.joint.name for node in tree.nodes if node.joint is not None and node.joint.mimic is None]
        groups[_name(group, path)] = tuple(name for name in names if name in members)
    chains = [_name(group, path) for group in root.findall("group") if group.find("chain") is not None]
    return Semantics(groups, next(iter([*chains, *groups]), None), allowed)


def find_srdf(path: Path | str, name: str) -> Path | None:
    """The SRDF beside a URDF: called as the file, or as the robot."""
    for stem in (Path(path).stem, name):
        beside = Path(path).with_name(f"{stem}.srdf")
        if beside.is_file():
            return beside
    return None


def _members(group: ET.Element, groups: Mapping[str, tuple[str, ...]], tree: RobotTree, path: Path | str) -> set[str]:
    """Names of the joints of a group; a link stands for the joint that carries it."""
    number = {node.name: i for i, node in enumerate(tree.nodes)}
    members = {joint.get("name", "") for joint in group.findall("joint")}
    for other in group.findall("group"):
        members.update(groups.get(_name(other, path), ()))
    links = [link.get("name", "") for link in group.findall("link")]
    for chain in group.findall("chain"):
        base, at = chain.get("base_link", ""), chain.get("tip_link", "")
        _known(base, number, path)
        while at != base:
            _known(at, number, path)
            links.append(at)
            parent = tree.nodes[number[at]].parent
            if parent < 0:
                raise InputError(f"{path}: the chain's tip {chain.get('tip_link')} does not hang on its base {base}")
            at = tree.nodes[parent].name
    for link in links:
        joint = tree.nodes[_known(link, number, path)].joint
        if joint is not None:
            members.add(joint.name)
    return members


def _known(link: str, number: Mapping[str, int], path: Path | str) -> int:
    if link not in number:
        raise InputError(f"{path}: unknown link {link!r}; the robot's links are: {', '.join(number)}")
    return number[link]


def _in_depth(nodes: Sequence[Node]) -> tuple[Node, ...]:
    """The nodes, each followed by what hangs on it, so that joints come in line."""
    order: list[int] = []
    stack = [i for i, node in reversed(list(enumerate(nodes))) if node.parent < 0]
    while stack:
        at = stack.pop()
        order.append(at)
        stack += [i for i in range(len(nodes) - 1, -1, -1) if nodes[i].parent == at]
    place = {old: new for new, old in enumerate(order)}
    return tuple(
        Node(node.name, place.get(node.parent, -1), node.pose, node.joint, node.shapes)
        for node in (nodes[i] for i in order)
    )


def _joint(joint: ET.Element, path: Path | str) -> TreeJoint | None:
    kind, name = joint.get("type"), _name(joint, path)
    if kind == "fixed":
        return None
    if kind not in ("revolute", "continuous", "prismatic"):
        raise InputError(
            f"{path}: the joint {name} is of type {kind!r}; expected revolute, continuous, prismatic or fixed"
        )
    where = f"the joint {name}"
    axis = _numbers(joint.find("axis"), "xyz", [1.0, 0.0, 0.0], where, path)
    if not np.any(axis):
        raise InputError(f"{path}: {where} has the axis 0 0 0; expected a direction")
    limit = joint.find("limit")
    if kind != "continuous" and (limit is None or limit.get("lower") is None or limit.get("upper") is None):
        raise InputError(f"{path}: {where} has no limits; expected <limit lower= upper=>, or the type continuous")
    turn = FULL_TURN if kind == "continuous" else 0.0
    lower = -turn if turn else float(_numbers(limit, "lower", [0.0], where, path)[0])
    upper = turn if turn else float(_numbers(limit, "upper", [0.0], where, path)[0])
    velocity = float(_numbers(limit, "velocity", [0.0], where, path)[0])
    mimic = joint.find("mimic")
    following = None
    if mimic is not None:
        multiplier, offset = (
            float(_numbers(mimic, key, [default], where, path)[0])
            for key, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        following = (mimic.get("joint", ""), multiplier, offset)
    return TreeJoint(
        name,
        axis / np.linalg.norm(axis),
        kind == "prismatic",
        lower,
        upper,
        velocity,
        rest=min(max(0.0, lower), upper),
        mimic=following,
    )


def _shapes(collision: ET.Element, link: str, path: Path | str) -> list[Shape]:
    geometry = collision.find("geometry")
    where = f"the collision geometry of {link}"
    if geometry is None or len(geometry) != 1:
        raise InputError(f"{path}: {where} has no shape; expected one of box, sphere, cylinder, capsule, mesh")
    shape, pose = geometry[0], _origin(collision, link, path)
    if shape.tag == "sphere":
        radius = _size(shape, "radius", 1, where, path)[0]
        return [moved(Sphere(np.zeros(3), radius, link), *pose)]
    if shape.tag == "box":
        return [moved(Box(np.zeros(3), _size(shape, "size", 3, where, path) / 2, name=link), *pose)]
    if shape.tag in ("cylinder", "capsule"):
        radius, half = _size(shape, "radius", 1, where, path)[0], _size(shape, "length", 1, where, path)[0] / 2
        if shape.tag == "cylinder":
            return [moved(Cylinder(np.zeros(3), half, radius, name=link), *pose)]
        return [moved(Capsule([0, 0, -half], [0, 0, half], radius, link), *pose)]
    if shape.tag == "mesh":
        scale = _numbers(shape, "scale", [1.0, 1.0, 1.0], where, path)
        file = find_mesh(shape.get("filename", ""), path, link)
        return [moved(Mesh(read_vertices(file) * scale, link), *pose)]
    raise InputError(f"{path}: {where} is <{shape.tag}>; expected box, sphere, cylinder, capsule or mesh")


def _size(element: ET.Element, key: str, count: int, where: str, path: Path | str) -> np.ndarray:
    if element.get(key) is None:
        raise InputError(f"{path}: {where}: the {element.tag} has no {key}")
    sizes = _numbers(element, key, [1.0] * count, where, path)
    if np.any(sizes <= 0):
        raise InputError(f"{path}: {where}: {key} is {element.get(key)}; expected more than zero")
    return sizes


def _origin(element: ET.Element, name: str, path: Path | str) -> Pose:
    origin = element.find("origin")
    xyz = _numbers(origin, "xyz", [0.0] * 3, f"the origin of {name}", path)
    rpy = _numbers(origin, "rpy", [0.0] * 3, f"the origin of {name}", path)
    return Pose(from_rpy(*rpy), xyz)


def _numbers(
    element: ET.Element | None, key: str, default: Sequence[float], where: str, path: Path | str
) -> np.ndarray:
    text = element.get(key) if element is not None else None
    if text is None:
        return np.array(default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != len(default) or not np.all(np.isfinite(values)):
        count = "one number" if len(default) == 1 else f"{len(default)} numbers"
        raise InputError(f"{path}: {where}: {key} is {text!r}; expected {count}")
    return values


def _end(joint: ET.Element, end: str, path: Path | str) -> str:
    element = joint.find(end)
    if element is None or element.get("link") is None:
        raise InputError(f"{path}: the joint {_name(joint, path)} has no {end} link")
    return element.get("link", "")


def _name(element: ET.Element, path: Path | str) -> str:
    name = element.get("name")
    if not name:
        raise InputError(f"{path}: a <{element.tag}> without name")
    return name
