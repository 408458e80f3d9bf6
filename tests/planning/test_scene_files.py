"""Scenes and requests from MoveIt YAML and MJCF, and what is refused with which words."""

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import planar_arm
from predplan.planning.scene_files import read_request, read_scene
from predplan.planning.scenes import Scene
from tests.planning.models import REQUEST, SCENE, URDF, kitchen, nearest_to, write

ROOM = """
<mujoco model="room">
  <compiler angle="radian"/>
  <asset><mesh name="rock" vertex="0 0 0  1 0 0  0 1 0  0 0 1  .1 .1 .1"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <geom type="sphere" size=".1" pos="0 0 9" contype="0" conaffinity="0"/>
    <body name="desk" pos="1 2 .5" euler="0 0 .3">
      <geom type="box" size=".4 .3 .02"/>
      <geom type="cylinder" size=".03 .25" pos=".2 .2 -.25" euler=".1 0 0"/>
      <body name="drawer" pos="0 0 .1">
        <joint name="slide" type="slide"/><geom name="knob" type="sphere" size=".02"/>
      </body>
    </body>
    <body name="things" pos="-1 -1 1">
      <freejoint/>
      <geom type="ellipsoid" size=".1 .2 .3" pos=".1 .2 .3" euler=".4 .5 .6"/>
      <geom type="capsule" fromto="0 0 0 .3 .4 0" size=".05" contype="0"/>
      <geom name="stone" type="mesh" mesh="rock" pos="2 0 0" euler="0 0 1"/>
    </body>
    <body name="arm"><joint name="shoulder"/><geom type="capsule" size=".1 .2"/><body><geom size=".1"/></body></body>
  </worldbody>
  <actuator><motor joint="shoulder"/></actuator>
</mujoco>
"""


def distance(scene: Scene, *point: float) -> tuple[float, str]:
    found = nearest_to(scene.obstacles, point)
    return found[0], scene.names[found[2]]


def test_a_moveit_scene_is_where_its_poses_put_it(tmp_path: Path) -> None:
    scene = read_scene(write(tmp_path, "scene.yaml", SCENE))
    assert scene.name == "shelf"
    assert scene.names == ("plank", "ground", "can[1]", "can[0]", "wedge")
    for point, apart, name in (
        ((0.0, 0.5, 0.45), 0.04, "plank"),
        ((-0.26, 0.5, 0.4), 0.01, "plank"),  # turned: half a metre along x
        ((0.1, 0.2, 0.21), 0.02, "can[0]"),
        ((0.0, 0.0, 1.15), 0.1, "can[1]"),
        ((2.2, 0.2, -0.1), 0.1, "wedge"),
        ((-5.0, 5.0, -0.3), 0.2, "ground"),
    ):
        found, nearest_name = distance(scene, *point)
        assert found == pytest.approx(apart)
        assert nearest_name == name


def test_cylinders_may_be_capsules_or_boxes_and_only_first_primitives_count(tmp_path: Path) -> None:
    path = write(tmp_path, "scene.yaml", SCENE)
    below = (0.1, 0.2, 0.21)
    assert distance(read_scene(path, cylinders_as="capsule"), *below)[0] == pytest.approx(-0.01)
    box = read_scene(path, cylinders_as="box", primitives="first")
    assert box.names == ("plank", "can", "ground", "wedge")
    assert distance(box, 0.13, 0.23, 0.3)[0] == pytest.approx(0.0, abs=1e-12)  # the corner that a cylinder lacks
    np.testing.assert_allclose(box.obstacles.box_half[1], [0.03, 0.03, 0.07])
    with pytest.raises(InputError, match="cylinders_as: unknown 'cone'; expected one of cylinder, capsule, box"):
        read_scene(path, cylinders_as="cone")  # type: ignore[arg-type]


def test_an_empty_scene_is_fine(tmp_path: Path) -> None:
    assert read_scene(write(tmp_path, "empty.yaml", "world: {collision_objects: []}")).names == ()
    assert read_scene(write(tmp_path, "bare.yaml", "world:")).names == ()
    assert read_scene(write(tmp_path, "void.xml", "<mujoco/>")).names == ()


BOX = "{type: box, dimensions: [1, .5, 0.02]}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("world:", "wrld:", "no field world; expected a planning scene"),
        ("primitives: [", "primitives: [[", "scene.yaml:[0-9]+: not YAML"),
        (
            BOX,
            "{type: box, dimensions: [1, .5]}",
            r"plank: primitives\[0\] \(box\): dimensions: found 2 numbers; expected 3",
        ),
        (
            BOX,
            "{type: box, dimensions: [1, .5, -1]}",
            r"plank: primitives\[0\] \(box\): dimensions are .*; expected more than",
        ),
        (BOX, "{type: box, dimensions: [1, .5, .nan]}", "dimensions: found nan; expected a finite number"),
        (BOX, "{type: box, dimensions: [1, .5, big]}", "dimensions: found 'big'; expected a finite number"),
        (BOX, "{type: box}", r"dimensions: found 0 numbers; expected 3"),
        (
            BOX,
            "{type: cone, dimensions: [1, .5]}",
            r"plank: primitives\[0\]: type 'cone'; expected box, sphere, cylinder",
        ),
        (BOX, "{type: 4, dimensions: [1, .5]}", "type 4; expected box, sphere, cylinder"),
        (BOX, "box", r"plank: primitives\[0\]: found str 'box'; expected a mapping"),
        (
            "{position: [0, .5, .4], ",
            "{position: [0, .5], ",
            "primitive_poses.0.: position: found 2 numbers; expected 3",
        ),
        ("{position: {x: .1, y: .2, z: .3}}", "{position: {x: .1, y: .2}}", "position: found nan; expected a finite"),
        (
            "orientation: {x: 0, y: 0, z: 0, w: 1}",
            "orientation: [0, 0, 0, 0]",
            "orientation is 0 0 0 0; expected a quat",
        ),
        (
            "- {position: {x: .1, y: .2, z: .3}}",
            "",
            "can: 2 primitives and 1 primitive_poses; expected as many of both",
        ),
        ("{x: 0, y: 0, z: 1}]", "]", "wedge: meshes.0.: 3 vertices; expected at least 4"),
        ("{x: 0, y: 0, z: 1}]", "[1, 1, 0]]", "wedge: 4 points without volume"),
        ("[0, 0, 1, 0.5]", "[0, 0, 0, 0.5]", "ground: planes.0.: coef is .*; expected a normal that is not zero"),
        ("collision_objects:", "octomap: {octomap: {data: [1]}}\n  collision_objects:", "octomaps are not read"),
        ("name: shelf", "robot_state: {attached_collision_objects: [1]}", "objects in the hand are not read"),
        ("name: shelf", "name: [", "scene.yaml:[0-9]+: not YAML"),
    ],
)
def test_a_faulty_scene_is_refused_with_object_and_field(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in SCENE
    with pytest.raises(InputError, match=message) as caught:
        read_scene(write(tmp_path, "scene.yaml", SCENE.replace(old, new, 1)))
    assert "scene.yaml" in str(caught.value)


def test_files_that_are_no_scenes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no.yaml: no such file; expected a planning scene"):
        read_scene(tmp_path / "no.yaml")
    with pytest.raises(InputError, match=r"no.xml: no such file"):
        read_scene(tmp_path / "no.xml")
    with pytest.raises(InputError, match=r"list.yaml: found list .*; expected a planning scene"):
        read_scene(write(tmp_path, "list.yaml", "[1, 2]"))
    (tmp_path / "latin.yaml").write_bytes(b"name: caf\xe9\n")
    with pytest.raises(InputError, match=r"latin.yaml:.*: not YAML"):
        read_scene(tmp_path / "latin.yaml")
    with pytest.raises(InputError, match=r"urdf.xml: .*"):
        read_scene(write(tmp_path, "urdf.xml", URDF.replace('link name="base"', "link")))


def test_an_mjcf_scene_is_mujocos_without_its_robot(tmp_path: Path) -> None:
    path = write(tmp_path, "room.xml", ROOM)
    scene = read_scene(path)
    assert scene.names == ("floor", "desk[0]", "knob", "things[1]", "desk[1]", "things[0]", "stone")
    assert "arm[0]" not in scene.names
    assert "arm" in read_scene(path, exclude_bodies=[]).names
    assert read_scene(path, exclude_bodies=["desk", "things", "arm"]).names == ("floor",)
    with pytest.raises(InputError, match="unknown body dask; the model has: desk, drawer, things, arm"):
        read_scene(path, exclude_bodies=["dask"])
    model, data = probe(path.read_text())
    for point in np.random.default_rng(0).uniform([-2, -2, 0.0], [2, 3, 2], (300, 3)):
        expected = mujoco_distance(model, data, point)
        found, name = distance(scene, *point)
        if name == "things[0]":  # the ellipsoid, which a polyhedron around it stands for
            assert expected - 0.3 * 0.05 <= found <= expected + 1e-6
        elif expected > 0:
            assert found == pytest.approx(expected, abs=1e-6)


def probe(text: str) -> tuple[Any, Any]:
    """The model without robot and with a tiny sphere as its last geom."""
    text = re.sub(r'<body name="arm">.*\n', "", text.replace('<actuator><motor joint="shoulder"/></actuator>', ""))
    text = text.replace("</worldbody>", '<body><freejoint/><geom type="sphere" size=".001"/></body></worldbody>')
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.ccd_tolerance = 1e-12
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def mujoco_distance(model: Any, data: Any, point: np.ndarray) -> float:
    last = model.ngeom - 1
    data.geom_xpos[last] = point
    others = [g for g in range(last) if model.geom_contype[g] or model.geom_conaffinity[g]]
    return min(float(mujoco.mj_geomDistance(model, data, g, last, 100.0, np.zeros(6))) + 0.001 for g in others)


def test_the_kitchen_is_both_a_scene_and_a_robot() -> None:
    scene = read_scene(kitchen())
    assert {"floor", "kettleroot[0]", "microdoorroot[3]", "ovenroot[0]"} <= set(scene.names)
    assert not any("panda" in name for name in scene.names)
    robot = read_robot(kitchen(), sphere_tolerance=0.05)
    assert not set(robot.links) & {name.split("[")[0] for name in scene.names}


def test_a_request_has_start_and_goal_by_joint(tmp_path: Path) -> None:
    request = read_request(write(tmp_path, "request.yaml", REQUEST))
    assert (request.group, request.source) == ("arm", str(tmp_path / "request.yaml"))
    assert request.start == {"lift": 0.1, "elbow": 0.0, "turn": 0.0, "finger_left": 0.02}
    robot = read_robot(write(tmp_path, "bent.urdf", URDF))
    start, goal = request.configurations(robot)
    assert (start.tolist(), goal.tolist()) == ([0.1, 0.0, 0.0], [0.2, 1.0, -0.1])
    with pytest.raises(
        InputError, match=r"request.yaml: the start has no joint1, joint2; it has lift, elbow, turn, fing"
    ):
        request.configurations(planar_arm([1.0, 1.0]))
    only_lift = read_robot(tmp_path / "bent.urdf", joints=["lift"])
    assert request.configurations(only_lift)[1].tolist() == [0.2]  # the other joints are held
    text = REQUEST.replace("joint_name: turn", "joint_name: trun")
    with pytest.raises(InputError, match="the goal has no turn; it has elbow, lift, trun"):
        read_request(write(tmp_path, "typo.yaml", text)).configurations(robot)
    text = REQUEST + "      - {joint_name: knee, position: 0}\n"
    with pytest.raises(InputError, match="the goal names knee; bent plans lift, elbow, turn"):
        read_request(write(tmp_path, "knee.yaml", text)).configurations(robot)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("start_state", "strt_state", "no start_state.joint_state; expected names and positions"),
        (
            "[0.1, 0, 0, 0.02]",
            "[0.1, 0, 0]",
            "start_state.joint_state: 4 names and 3 positions; expected as many of both",
        ),
        (
            "[0.1, 0, 0, 0.02]",
            "[0.1, .nan, 0, 0]",
            "start_state.joint_state: elbow: found nan; expected a finite number",
        ),
        ("position: 1}", "position: .inf}", "goal position of elbow: found inf; expected a finite number"),
        ("position: 1}", "tolerance: 1}", r"joint_constraints\[0\] has no joint_name or no position"),
        ("goal_constraints", "gol_constraints", "no goal_constraints; expected joint_constraints"),
        (
            "- joint_constraints:",
            "- position_constraints: [1]\n    joint_constraints:",
            "position_constraints; expected joint",
        ),
        ("group_name: arm", "group_name: [", "request.yaml:[0-9]+: not YAML"),
    ],
)
def test_a_faulty_request_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in REQUEST
    with pytest.raises(InputError, match=message):
        read_request(write(tmp_path, "request.yaml", REQUEST.replace(old, new)))
    with pytest.raises(InputError, match=r"no.yaml: no such file; expected a motion-plan request"):
        read_request(tmp_path / "no.yaml")
