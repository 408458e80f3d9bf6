"""What a robot and its scene look like: an MJCF model's meshes, else spheres; the scene's shapes; poses over time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.geoms import colour_of, geom_solids, is_shown
from predplan.artifacts.recordings import WORLD, Colour, Mesh, Primitive, Solid, Transforms
from predplan.planning.kinematics import poses
from predplan.planning.poses import along, to_quaternion
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Box, Capsule, Cylinder, Scene, Shape, Sphere, convex_hull

TOOL = "tool"
"""The end effector's frame, beside those of the joints."""
ROBOT, SCENE = "robot/", "scene/"
"""What the names of the robot's and the scene's solids begin with."""

SPHERE_COLOUR: Colour = (0.72, 0.75, 0.79, 1.0)
OBSTACLE_COLOUR: Colour = (0.36, 0.43, 0.53, 0.6)
GROUND_COLOUR: Colour = (0.13, 0.14, 0.16, 1.0)
GROUND = 10.0
"""m: a box with a longer edge is ground or wall, and not what the scene is about."""


def frame_names(robot: Robot) -> tuple[str, ...]:
    """Names of the chain's frames: the world, then each joint's, which moves with it."""
    return (WORLD, *robot.joints)


def frame_poses(robot: Robot, times: FloatArray, configurations: FloatArray) -> Transforms:
    """Poses in the world of what each joint moves, and of the tool, at times [n] s and configurations [n, D]."""
    chain = robot.chain
    rotations, positions = poses(chain, configurations)
    tool = positions[:, chain.tool_frame] + rotations[:, chain.tool_frame] @ chain.tool_position
    places = np.concatenate([positions[:, 1:], tool[:, None]], axis=1)
    turns = np.concatenate([rotations[:, 1:], rotations[:, chain.tool_frame, None]], axis=1)
    children = (*robot.joints, TOOL)
    return Transforms(times, (WORLD,) * len(children), children, places, to_quaternion(turns))


def robot_solids(robot: Robot, meshes: bool = True) -> tuple[Solid, ...]:
    """What the robot is seen as, each solid in a frame of `frame_names`.

    With meshes: what MuJoCo's viewer shows of the robot's bodies, if it was read from an MJCF file that MuJoCo can
    still read. Else the spheres of its body.
    """
    if meshes and Path(robot.source).suffix.lower() in (".xml", ".mjcf"):
        seen = tuple(_mjcf_solids(robot))
        if seen:
            return seen
    chain, frames = robot.chain, frame_names(robot)
    return tuple(
        Primitive(
            f"{ROBOT}{robot.links[link]}",
            "sphere",
            centre,
            np.array([0.0, 0.0, 0.0, 1.0]),
            np.full(3, 2.0 * radius),
            SPHERE_COLOUR,
            frames[frame],
        )
        for link, frame, centre, radius in zip(
            chain.sphere_link, chain.sphere_frame, chain.sphere_centre, chain.sphere_radius, strict=True
        )
    )


def scene_solids(scene: Scene) -> tuple[Solid, ...]:
    """The scene's obstacles, in the world."""
    return tuple(solid for shape in scene.shapes for solid in _solids(f"{SCENE}{shape.name}", shape))


def _solids(name: str, shape: Shape) -> Iterator[Solid]:
    if isinstance(shape, Box):
        size = 2.0 * _array(shape.half)
        colour = GROUND_COLOUR if size.max() > GROUND else OBSTACLE_COLOUR
        yield Primitive(name, "cube", _array(shape.centre), to_quaternion(_array(shape.rotation)), size, colour)
    elif isinstance(shape, Sphere):
        yield _ball(name, _array(shape.centre), shape.radius)
    elif isinstance(shape, Cylinder):
        yield _rod(name, _array(shape.centre), _array(shape.rotation), shape.half, shape.radius)
    elif isinstance(shape, Capsule):
        a, b = _array(shape.a), _array(shape.b)
        half = float(np.linalg.norm(b - a)) / 2.0
        if half > 0.0:
            yield _rod(name, (a + b) / 2.0, along(b - a), half, shape.radius)
            yield _ball(name, b, shape.radius)
        yield _ball(name, a, shape.radius)
    else:
        hull = convex_hull(shape.vertices, shape.name)
        edges = np.diff(hull.triangles, axis=1)
        inwards = np.einsum("ij,ij->i", np.cross(edges[:, 0], edges[:, 1]), hull.planes[:, :3]) < 0.0
        corners = np.where(inwards[:, None, None], hull.triangles[:, ::-1], hull.triangles).reshape(-1, 3)
        yield Mesh(name, corners, np.arange(len(corners)).reshape(-1, 3), OBSTACLE_COLOUR)


def _ball(name: str, centre: FloatArray, radius: float) -> Primitive:
    return Primitive(name, "sphere", centre, np.array([0.0, 0.0, 0.0, 1.0]), np.full(3, 2.0 * radius), OBSTACLE_COLOUR)


def _rod(name: str, centre: FloatArray, rotation: FloatArray, half: float, radius: float) -> Primitive:
    size = 2.0 * np.array([radius, radius, half])
    return Primitive(name, "cylinder", centre, to_quaternion(rotation), size, OBSTACLE_COLOUR)


def _array(values: Any) -> FloatArray:
    return np.asarray(values, np.float64)


def _mjcf_solids(robot: Robot) -> Iterator[Solid]:
    """Geoms that are seen, of the body tree that holds the planned joints, in the frames that carry them."""
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(robot.source)
        joints = [model.joint(name).id for name in robot.joints]
    except (ValueError, KeyError):
        return
    data = mujoco.MjData(model)
    middle = (robot.chain.lower + robot.chain.upper) / 2.0
    for name, value in (*robot.fixed.items(), *zip(robot.joints, middle, strict=True)):
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    (rotations,), (positions,) = poses(robot.chain, middle[None])
    carried = _frames_of_bodies(model, joints)
    root = model.body_rootid[model.jnt_bodyid[joints[0]]]
    for g in range(model.ngeom):
        body = int(model.geom_bodyid[g])
        if model.body_rootid[body] != root or not is_shown(model, g):
            continue
        frame = carried[body]
        rotation = rotations[frame].T @ data.geom_xmat[g].reshape(3, 3)
        centre = rotations[frame].T @ (data.geom_xpos[g] - positions[frame])
        name = f"{ROBOT}{model.body(body).name or f'body{body}'}"
        yield from geom_solids(model, g, name, frame_names(robot)[frame], rotation, centre, colour_of(model, g))


def _frames_of_bodies(model: Any, joints: list[int]) -> list[int]:
    """The chain's frame of every body: 0, or one more than the number of the planned joint nearest above it."""
    carried = [0] * model.nbody
    for body in range(1, model.nbody):
        first = int(model.body_jntadr[body])
        own = [j for j in range(first, first + int(model.body_jntnum[body])) if j in joints]
        carried[body] = joints.index(own[-1]) + 1 if own else carried[int(model.body_parentid[body])]
    return carried
