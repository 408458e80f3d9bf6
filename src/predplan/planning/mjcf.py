"""MJCF through MuJoCo's own compiler: a robot's tree, and the shapes of a scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from predplan.errors import InputError
from predplan.planning.poses import Pose, from_quaternion
from predplan.planning.robot_trees import Node, RobotTree, TreeJoint, main_chain, moved_by
from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, convex_hull, moved

PLANE_HALF = np.array([20.0, 20.0, 10.0])
"""m: half extents of the box that stands for a plane, which is its upper face."""
FULL_TURN = 2 * np.pi
AXIS_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def read_mjcf_robot(path: Path | str, joints: Sequence[str] | None) -> tuple[RobotTree, tuple[str, ...]]:
    """The body tree that holds `joints`, and these; by default the longest serial chain that actuators drive.

    Geoms are collision geometry where contype or conaffinity is not zero; pairs of bodies whose geoms cannot meet by
    these bits, or that are excluded, may touch. Free and ball joints are held where the model puts them.
    """
    model = _compile(path)
    roots = [body for body in range(1, model.nbody) if model.body_rootid[body] == body]
    trees = {root: _tree(model, root, path) for root in roots}
    if joints is None:
        driven = _driven_roots(model)
        candidates = [trees[root] for root in roots if root in driven] or list(trees.values())
        tree = max(candidates, key=lambda candidate: len(main_chain(candidate)), default=None)
        if tree is None:
            raise InputError(f"{path}: no body; expected a robot")
        return tree, main_chain(tree)
    known = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] in AXIS_JOINTS]
    unknown = [joint for joint in joints if joint not in known]
    if unknown:
        raise InputError(f"{path}: unknown joint to plan {', '.join(unknown)}; expected some of: {', '.join(known)}")
    holding = {int(model.body_rootid[model.joint(joint).bodyid[0]]) for joint in joints}
    if len(holding) > 1:
        raise InputError(f"{path}: {', '.join(joints)} are in {len(holding)} body trees; expected one")
    return trees[holding.pop()] if holding else trees[roots[0]], tuple(joints)


def read_mjcf_shapes(path: Path | str, exclude_bodies: Sequence[str] | None) -> tuple[str, list[Shape]]:
    """The model's name and what can collide in it, in the world, without the excluded bodies and what they carry."""
    model = _compile(path)
    names = [model.body(body).name for body in range(model.nbody)]
    if exclude_bodies is None:
        left_out = _driven_roots(model)
    else:
        unknown = [name for name in exclude_bodies if name not in names[1:]]
        if unknown:
            found = ", ".join(name for name in names[1:] if name)
            raise InputError(f"{path}: unknown body {', '.join(unknown)}; the model has: {found}")
        left_out = {names.index(name) for name in exclude_bodies}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    shapes: list[Shape] = []
    for body in range(model.nbody):
        if int(model.body_parentid[body]) in left_out and body > 0:
            left_out.add(body)
        if body in left_out:
            continue
        geoms = list(_colliding(model, body))
        for k, geom in enumerate(geoms):
            where = names[body] or f"body{body}"
            name = model.geom(geom).name or (where if len(geoms) == 1 else f"{where}[{k}]")
            pose = Pose(data.geom_xmat[geom].reshape(3, 3).copy(), data.geom_xpos[geom].copy())
            shapes.append(moved(_shape(model, geom, name, path), *pose))
    return Path(path).stem, shapes


def _compile(path: Path | str) -> Any:
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; expected an MJCF model")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error


def _tree(model: Any, root: int, path: Path | str) -> RobotTree:
    nodes: list[Node] = []
    number: dict[int, int] = {}
    mimics = _mimics(model)
    for body in range(root, model.nbody):
        if model.body_rootid[body] != root:
            continue
        parent = number.get(int(model.body_parentid[body]), -1)
        pose = Pose(from_quaternion(*model.body_quat[body]), model.body_pos[body].copy())
        anchor = np.zeros(3)  # of the joint before, since a joint's node sits at its anchor
        first = int(model.body_jntadr[body])
        for j in range(first, first + int(model.body_jntnum[body])):
            if model.jnt_type[j] not in AXIS_JOINTS:
                continue
            joint, at = _joint(model, j, mimics), model.jnt_pos[j].copy()
            mounted = pose.then(Pose(np.eye(3), at - anchor)).then(moved_by(joint, -joint.rest))
            nodes.append(Node("", parent, mounted, joint))
            parent, pose, anchor = len(nodes) - 1, Pose(np.eye(3), np.zeros(3)), at
        name = model.body(body).name or f"body{body}"
        shapes = tuple(
            moved(_shape(model, geom, name, path), from_quaternion(*model.geom_quat[geom]), model.geom_pos[geom].copy())
            for geom in _colliding(model, body)
        )
        nodes.append(Node(name, parent, pose.then(Pose(np.eye(3), -anchor)), None, shapes))
        number[body] = len(nodes) - 1
        for site in range(model.nsite):
            if model.site_bodyid[site] == body and model.site(site).name:
                at_site = Pose(from_quaternion(*model.site_quat[site]), model.site_pos[site].copy())
                nodes.append(Node(model.site(site).name, number[body], at_site))
    allowed = _allowed(model, list(number))
    # Like MuJoCo, which never lets what stands still collide with what stands still.
    return RobotTree(Path(path).stem, tuple(nodes), str(path), allowed, stands=True)


def _joint(model: Any, j: int, mimics: Mapping[int, tuple[str, float, float]]) -> TreeJoint:
    prismatic = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    lower, upper = model.jnt_range[j].tolist() if model.jnt_limited[j] else (-np.inf, np.inf)
    if not prismatic and not model.jnt_limited[j]:
        lower, upper = -FULL_TURN, FULL_TURN
    return TreeJoint(
        model.joint(j).name or f"joint{j}",
        model.jnt_axis[j].copy(),
        prismatic,
        lower,
        upper,
        rest=float(model.qpos0[model.jnt_qposadr[j]]),
        mimic=mimics.get(j),
    )


def _mimics(model: Any) -> dict[int, tuple[str, float, float]]:
    """Joints that a linear equality ties to another: q - q0 = c0 + c1 (other - other0)."""
    tied = {}
    for e in range(model.neq):
        coefficients = model.eq_data[e]
        second = int(model.eq_obj2id[e])
        if int(model.eq_type[e]) != int(mujoco.mjtEq.mjEQ_JOINT) or second < 0 or np.any(coefficients[2:5]):
            continue
        first = int(model.eq_obj1id[e])
        rest, other = (float(model.qpos0[model.jnt_qposadr[j]]) for j in (first, second))
        slope = float(coefficients[1])
        tied[first] = (
            model.joint(second).name or f"joint{second}",
            slope,
            rest + float(coefficients[0]) - slope * other,
        )
    return tied


def _allowed(model: Any, bodies: Sequence[int]) -> frozenset[frozenset[str]]:
    """Pairs of bodies that are excluded, or have no two geoms that MuJoCo's bits let collide."""
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    allowed = set()
    for i, a in enumerate(bodies):
        for b in bodies[i + 1 :]:
            meet = any(
                model.geom_contype[g] & model.geom_conaffinity[h] or model.geom_contype[h] & model.geom_conaffinity[g]
                for g in _colliding(model, a)
                for h in _colliding(model, b)
            )
            if not meet or (a, b) in excluded or (b, a) in excluded:
                allowed.add(frozenset(model.body(body).name or f"body{body}" for body in (a, b)))
    return frozenset(allowed)


def _driven_roots(model: Any) -> set[int]:
    """Roots of the body trees in which some actuator moves a joint."""
    joints: set[int] = set()
    for actuator in range(model.nu):
        kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
        if kind in (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)):
            joints.add(target)
        elif kind == int(mujoco.mjtTrn.mjTRN_TENDON):
            first = int(model.tendon_adr[target])
            wraps = range(first, first + int(model.tendon_num[target]))
            wrapped = int(mujoco.mjtWrap.mjWRAP_JOINT)
            joints.update(int(model.wrap_objid[w]) for w in wraps if int(model.wrap_type[w]) == wrapped)
    return {int(model.body_rootid[model.jnt_bodyid[joint]]) for joint in joints}


def _colliding(model: Any, body: int) -> Iterator[int]:
    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        if model.geom_contype[geom] or model.geom_conaffinity[geom]:
            yield geom


def _shape(model: Any, geom: int, name: str, path: Path | str) -> Shape:
    """A geom in its own frame; a mesh as its convex hull, which is what MuJoCo collides with."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom].copy()
    origin = np.zeros(3)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Box(origin, size, name=name)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return Sphere(origin, float(size[0]), name)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return Capsule(np.array([0, 0, -size[1]]), np.array([0, 0, size[1]]), float(size[0]), name)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return Cylinder(origin, float(size[1]), float(size[0]), name=name)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return Box(np.array([0.0, 0.0, -PLANE_HALF[2]]), PLANE_HALF, name=name)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return Mesh(_ball_around() * size, name)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64)
        return Mesh(_corners(vertices, f"{path}: {name}"), name)
    raise InputError(
        f"{path}: {name} is a {kind.name}; expected box, sphere, capsule, cylinder, ellipsoid, mesh, plane"
    )


def _corners(vertices: FloatArray, name: str) -> FloatArray:
    return np.unique(convex_hull(vertices, name).triangles.reshape(-1, 3), axis=0)


@cache
def _ball_around() -> FloatArray:
    """Vertices [162, 3] of a polyhedron that holds the unit ball and reaches 4% outside it."""
    golden = (1 + np.sqrt(5)) / 2
    corners = [(0.0, a, b * golden) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    points = np.array([np.roll(corner, shift) for corner in corners for shift in range(3)])
    for _ in range(2):
        triangles = convex_hull(points, "ball").triangles
        middles = (triangles + np.roll(triangles, 1, axis=1)).reshape(-1, 3) / 2
        points = np.unique(np.round(np.concatenate([triangles.reshape(-1, 3), middles]), 12), axis=0)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return np.asarray(points / -convex_hull(points, "ball").planes[:, 3].max())
