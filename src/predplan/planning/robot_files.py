"""Robots from the formats of the field: URDF with SRDF, and MJCF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from predplan.errors import InputError
from predplan.planning.robot_trees import build_robot, main_chain
from predplan.planning.robots import Robot
from predplan.planning.urdf import find_srdf, parse_xml, read_srdf, read_urdf

SPHERE_TOLERANCE = 0.025
"""m: how far fitted spheres may reach outside the collision geometry."""


def read_robot(
    path: Path | str,
    *,
    joints: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    acceleration_limit: float | Sequence[float] | None = None,
    tool: str | None = None,
    srdf: Path | str | None = None,
    group: str | None = None,
    sphere_tolerance: float = SPHERE_TOLERANCE,
) -> Robot:
    """A robot from URDF (with the SRDF beside it, or `srdf`) or MJCF; frame 0 is the world.

    joints: those to plan, which come in the file's order. By default the SRDF's `group` (if not named, its first that
    is a chain, or its first), or the longest serial chain without its hand (see main_chain); less those in `fixed`.
    fixed: where other joints are held (rad or m). By default the value in the file, or zero, or the nearest allowed.
    acceleration_limit: rad/s² or m/s², one or one a joint, since neither format has any. Velocity limits are URDF's;
    where none is stated DEFAULT_VELOCITY.
    tool: a link (or MJCF site) that is the end effector; by default, of what is rigid with the last planned joint,
    the link farthest from it.
    sphere_tolerance: m, see fit_spheres; geometry that is spheres is taken as it is.
    Raises InputError for what cannot be read, or names what is not there.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; expected a robot as URDF or MJCF")
    kind = parse_xml(path).tag
    welded: tuple[str, ...] = ()
    chosen = joints is not None
    if kind == "robot":
        tree, welded = read_urdf(path)
        found = Path(srdf) if srdf is not None else find_srdf(path, tree.name)
        if found is not None:
            semantics = read_srdf(found, tree)
            tree = replace(tree, allowed=semantics.allowed, complete=True)
            if group is not None and group not in semantics.groups:
                raise InputError(f"{found}: unknown group {group!r}; expected one of: {', '.join(semantics.groups)}")
            group = group or semantics.main
            if joints is None and group is not None:
                joints, chosen = semantics.groups[group], False
        elif group is not None:
            raise InputError(f"{path}: the group {group!r} needs an SRDF; found none beside the URDF")
    elif kind == "mujoco":
        from predplan.planning.mjcf import read_mjcf_robot  # MuJoCo is needed for its own format only

        tree, joints = read_mjcf_robot(path, joints)
    else:
        raise InputError(f"{path}: the root element is <{kind}>; expected <robot> (URDF) or <mujoco> (MJCF)")
    joints = main_chain(tree) if joints is None else joints
    held = fixed or {}
    if chosen and set(joints) & set(held):
        raise InputError(f"{path}: {', '.join(sorted(set(joints) & set(held)))} both to be planned and held")
    return build_robot(
        tree,
        [joint for joint in joints if joint not in held],
        fixed=held,
        welded=welded,
        acceleration_limit=acceleration_limit,
        tool=tool,
        sphere_tolerance=sphere_tolerance,
    )
