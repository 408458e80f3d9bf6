from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from predplan.artifacts.recordings import WORLD, Mesh, Primitive, Solid, Transforms
from predplan.planning.kinematics import tool_trace
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import FloatArray, planar_arm
from predplan.planning.scenes import Box, Capsule, Cylinder, Sphere, make_scene
from predplan.planning.scenes import Mesh as Hull
from predplan.planning.visuals import TOOL, frame_names, frame_poses, robot_solids, scene_solids

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <asset>
    <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3"/>
    <material name="red" rgba="1 0 0 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="base" pos=".1 .2 .3" euler="0 0 .5">
      <geom type="cylinder" size=".1 .2" rgba=".5 .5 .5 1"/>
      <body name="upper" pos="0 0 .2" euler=".3 0 0">
        <joint name="lift" axis="0 1 0" pos="0 0 .05" range="-1 1"/>
        <geom type="mesh" mesh="wedge" material="red" pos=".02 0 0" euler="0 .4 0"/>
        <geom type="sphere" size=".2" group="3"/>
        <body name="fore" pos=".3 0 0">
          <joint name="reach" type="slide" axis="1 0 0" range="0 .5"/>
          <geom type="capsule" fromto="0 0 0 .2 0 .1" size=".03" rgba="0 1 0 .5"/>
          <body name="jaw" pos=".2 0 0">
            <joint name="finger" type="slide" axis="0 1 0" range="0 .1"/>
            <geom type="box" size=".01 .02 .03"/>
          </body>
        </body>
      </body>
    </body>
    <body name="cupboard" pos="1 0 0"><geom type="box" size=".1 .1 .1"/></body>
  </worldbody>
  <actuator><motor joint="lift"/><motor joint="reach"/></actuator>
</mujoco>
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return path


def in_world(solid: Solid, frames: Transforms, points: FloatArray) -> FloatArray:
    """Points [n, 3] of a solid's frame in the world, at the frames' first time."""
    if solid.frame == WORLD:
        return points
    k = frames.children.index(solid.frame)
    placed: FloatArray = Rotation.from_quat(frames.quaternion[0, k]).apply(points) + frames.translation[0, k]
    return placed


def test_solids_are_where_mujoco_has_them(arm: Path) -> None:
    robot = read_robot(arm, joints=["lift", "reach"], fixed={"finger": 0.06})
    solids = robot_solids(robot)
    assert [solid.name for solid in solids] == ["robot/base", "robot/upper", "robot/fore", "robot/jaw"]
    assert [solid.frame for solid in solids] == [WORLD, "lift", "reach", "reach"]
    q = np.array([[0.7, 0.31]])
    frames = frame_poses(robot, np.zeros(1), q)
    model = mujoco.MjModel.from_xml_path(str(arm))
    data = mujoco.MjData(model)
    data.qpos[:] = [*q[0], 0.06]
    mujoco.mj_kinematics(model, data)
    pedestal, wedge, rod, jaw = solids
    for solid, geom in ((pedestal, 1), (jaw, 5)):
        assert isinstance(solid, Primitive)
        np.testing.assert_allclose(in_world(solid, frames, solid.centre[None])[0], data.geom_xpos[geom], atol=1e-9)
        axes = Rotation.from_quat(solid.quaternion).as_matrix().T * 0.5 + solid.centre
        expected = data.geom_xmat[geom].reshape(3, 3).T * 0.5 + data.geom_xpos[geom]
        np.testing.assert_allclose(in_world(solid, frames, axes), expected, atol=1e-9)
    assert isinstance(wedge, Mesh)
    vertices = model.mesh_vert @ data.geom_xmat[2].reshape(3, 3).T + data.geom_xpos[2]
    np.testing.assert_allclose(in_world(wedge, frames, wedge.vertices), vertices, atol=1e-7)
    np.testing.assert_array_equal(wedge.triangles, model.mesh_face)
    assert wedge.colour == (1.0, 0.0, 0.0, 1.0)
    assert isinstance(rod, Mesh)
    assert rod.colour == (0.0, 1.0, 0.0, 0.5)
    a, b = (data.geom_xpos[4] + end * model.geom_size[4][1] * data.geom_xmat[4][2::3] for end in (-1, 1))
    corners = in_world(rod, frames, rod.vertices)
    along = np.clip((corners - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)[:, None]
    np.testing.assert_allclose(np.linalg.norm(corners - (a + along * (b - a)), axis=1), 0.03, atol=1e-9)


def test_without_meshes_the_spheres_of_the_body_are_seen(arm: Path) -> None:
    robot = read_robot(arm)
    spheres = robot_solids(robot, meshes=False)
    assert len(spheres) == len(robot.chain.sphere_radius)
    arm.unlink()
    assert [solid.frame for solid in robot_solids(robot)] == [solid.frame for solid in spheres]


def test_a_robot_made_in_code_is_spheres_in_its_frames() -> None:
    robot = planar_arm([0.5, 0.4])
    assert frame_names(robot) == (WORLD, *robot.joints)
    solids = robot_solids(robot)
    assert {solid.frame for solid in solids} == set(robot.joints)
    assert all(isinstance(solid, Primitive) and solid.kind == "sphere" for solid in solids)


def test_the_tool_has_a_frame() -> None:
    robot = planar_arm([0.5, 0.4])
    q = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    frames = frame_poses(robot, np.arange(5.0), q)
    assert frames.children == (*robot.joints, TOOL)
    np.testing.assert_allclose(frames.translation[:, 2], tool_trace(robot.chain, q), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(frames.quaternion, axis=-1), 1.0)


def test_a_scene_is_its_shapes() -> None:
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])
    turn = Rotation.from_euler("x", 0.3).as_matrix()
    scene = make_scene(
        [
            Box([0, 0, 0], [1, 2, 3], turn, "box"),
            Sphere([1, 1, 1], 0.5, "ball"),
            Capsule([0, 0, 0], [0, 3, 4], 0.1, "rod"),
            Cylinder([0, 0, 1], 0.5, 0.2, turn, "can"),
            Hull(corners, "hull"),
        ]
    )
    box, ball, rod, tip, tail, can, hull = scene_solids(scene)
    assert [solid.name for solid in (box, ball, rod, tip, tail, can, hull)] == [
        f"scene/{name}" for name in ("box", "ball", "rod", "rod", "rod", "can", "hull")
    ]
    assert isinstance(box, Primitive)
    np.testing.assert_array_equal(box.size, [2, 4, 6])
    np.testing.assert_allclose(Rotation.from_quat(box.quaternion).as_matrix(), turn)
    assert isinstance(rod, Primitive)
    np.testing.assert_allclose(Rotation.from_quat(rod.quaternion).as_matrix()[:, 2], [0, 0.6, 0.8])
    np.testing.assert_allclose([rod.centre, rod.size], [[0, 1.5, 2], [0.2, 0.2, 5]])
    assert isinstance(can, Primitive)
    np.testing.assert_allclose(can.size, [0.4, 0.4, 1.0])
    assert isinstance(hull, Mesh)
    a, b, c = np.swapaxes(hull.vertices[hull.triangles], 0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(6.0)  # turned outwards all over
