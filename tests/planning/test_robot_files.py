"""Robots from URDF, SRDF and MJCF: which joints, which pairs, what is held, and what is refused with which words."""

from pathlib import Path

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning.kinematics import poses, tool_trace
from predplan.planning.poses import about
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import DEFAULT_ACCELERATION, DEFAULT_VELOCITY, Robot
from tests.planning.models import SRDF, TREE, URDF, bench_file, kitchen, write

CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))


def pairs(robot: Robot) -> set[tuple[str, str]]:
    return {(robot.links[a], robot.links[b]) for a, b in robot.chain.link_pairs}


def test_a_urdf_alone_plans_its_longest_chain_without_the_hand(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, "bent.urdf", URDF), fixed={"finger_left": 0.02})
    assert robot.name == "bent"
    assert robot.joints == ("lift", "elbow", "turn")
    assert robot.fixed == {"finger_left": 0.02, "finger_right": pytest.approx(0.03)}
    assert robot.chain.lower.tolist() == [0.0, -2.0, pytest.approx(-2 * np.pi)]
    assert robot.chain.upper.tolist() == [0.4, 2.0, pytest.approx(2 * np.pi)]
    assert robot.velocity_limit.tolist() == [0.5, 1.5, DEFAULT_VELOCITY]
    assert robot.acceleration_limit.tolist() == [DEFAULT_ACCELERATION] * 3
    assert robot.links == ("base", "upper", "fore", "left", "right")
    assert robot.source == str(tmp_path / "bent.urdf")
    assert 0 < robot.sphere_bound <= 0.025
    np.testing.assert_allclose(robot.chain.axis[0], [0, 0, 1])
    tip = tool_trace(robot.chain, np.zeros((1, 3)))[0]
    rotations, positions = poses(robot.chain, np.zeros((1, 3)))
    assert robot.chain.tool_frame == 3
    assert np.linalg.norm(tip - positions[0, 3]) == pytest.approx(np.hypot(0.05, 0.04))  # the finger farther out
    np.testing.assert_allclose(rotations[0, 0], np.eye(3))


def test_pairs_without_srdf_leave_out_neighbours_and_what_always_touches(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, "bent.urdf", URDF))
    # The fingers hang on the wrist, which has no body, by joints that are held: they adjoin nothing else.
    assert ("base", "fore") in pairs(robot)
    assert not {("base", "upper"), ("upper", "fore"), ("left", "right")} & pairs(robot)
    inside = URDF.replace(
        '<link name="wrist"/>',
        '<link name="wrist"><collision><geometry><sphere radius=".45"/></geometry></collision></link>',
    )
    assert ("upper", "wrist") not in pairs(read_robot(write(tmp_path, "large.urdf", inside)))


def test_an_srdf_gives_groups_and_the_pairs_that_may_touch(tmp_path: Path) -> None:
    path = write(tmp_path, "bent.urdf", URDF)
    write(tmp_path, "bent.srdf", SRDF)
    robot = read_robot(path, group="arm")
    assert robot.joints == ("lift", "elbow", "turn")
    assert pairs(robot) == {
        ("base", "fore"), ("base", "right"), ("upper", "left"), ("upper", "right"), ("fore", "left"), ("fore", "right"),
    }  # fmt: skip
    assert read_robot(path).joints == ("lift", "elbow", "turn")  # the first group that is a chain
    assert read_robot(path, group="elbow_only").joints == ("elbow",)
    assert read_robot(path, group="both", fixed={"finger_right": 0.0}).joints == (
        "lift",
        "elbow",
        "turn",
        "finger_left",
    )
    assert read_robot(path, joints=["turn", "lift"]).joints == ("lift", "turn")
    elsewhere = write(tmp_path, "other.xml", SRDF.replace('name="hand"', 'name="zero"'))
    assert read_robot(path, srdf=elsewhere, group="arm").joints == ("lift", "elbow", "turn")
    with pytest.raises(
        InputError, match=r"bent.srdf: unknown group 'leg'; expected one of: hand, arm, elbow_only, both"
    ):
        read_robot(path, group="leg")
    with pytest.raises(InputError, match="finger_right mimics finger_left, which is to be planned"):
        read_robot(path, group="both")


def test_a_tool_and_accelerations_may_be_named(tmp_path: Path) -> None:
    path = write(tmp_path, "bent.urdf", URDF)
    robot = read_robot(path, tool="fore", acceleration_limit=[1.0, 2.0, 3.0])
    assert (robot.chain.tool_frame, robot.acceleration_limit.tolist()) == (2, [1.0, 2.0, 3.0])
    assert read_robot(path, acceleration_limit=4).acceleration_limit.tolist() == [4.0] * 3
    with pytest.raises(InputError, match="unknown tool claw; expected some of: base, upper, fore, wrist, left, right"):
        read_robot(path, tool="claw")
    for limit in (0.0, [1.0, 2.0], [1.0, 2.0, np.nan]):
        with pytest.raises(InputError, match=r"acceleration limit .*; expected one positive number, or one for each"):
            read_robot(path, acceleration_limit=limit)


def test_an_mjcf_plans_the_driven_tree_and_excludes_what_it_excludes(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, "tree.xml", TREE))
    assert robot.joints == ("a", "b", "c", "e", "f", "g")
    assert robot.fixed == {"d": 0.0}
    assert robot.velocity_limit.tolist() == [DEFAULT_VELOCITY] * 6
    assert robot.chain.lower[:3].tolist() == pytest.approx([-np.deg2rad(2), -0.3, -2 * np.pi])
    every = read_robot(tmp_path / "tree.xml", joints=list("abcdefg"))
    # Left out: neighbours, "far" with what "three" adjoins, being rigid with it, and what is excluded.
    assert pairs(every) == {("base", "two"), ("base", "three"), ("base", "far"), ("two", "three")}
    assert read_robot(tmp_path / "tree.xml", fixed={"a": 0.5, "g": 0.1}).joints == ("b", "c", "e", "f")


def test_mjcf_bits_decide_which_bodies_may_touch(tmp_path: Path) -> None:
    blind = TREE.replace('size=".03"/></body>', 'size=".03" contype="2" conaffinity="4"/></body>')
    robot = read_robot(write(tmp_path, "blind.xml", blind), joints=list("abcdefg"))
    assert "far" in robot.links
    assert not any("far" in pair for pair in pairs(robot))


def test_a_joint_that_an_mjcf_ties_to_another_follows_it(tmp_path: Path) -> None:
    tied = TREE.replace(
        "<actuator>", '<equality><joint joint1="e" joint2="d" polycoef=".05 .5 0 0 0"/></equality><actuator>'
    )
    path = write(tmp_path, "tied.xml", tied)
    assert read_robot(path, joints=["a"], fixed={"d": 0.2}).fixed["e"] == pytest.approx(0.15)


def test_the_kitchens_arm_is_found_among_all_that_moves() -> None:
    robot = read_robot(kitchen(), sphere_tolerance=0.05, fixed={"robot:panda0_finger_joint1": 0.04})
    assert robot.joints == tuple(f"robot:panda0_joint{i}" for i in range(1, 8))
    assert robot.fixed == {"robot:panda0_finger_joint1": 0.04, "robot:panda0_finger_joint2": 0.0}
    assert robot.links[1:9] == tuple(f"panda0_link{i}" for i in range(8))
    assert robot.chain.scene_link == 2  # the pedestal and link0
    assert ("panda0_link1", "panda0_link2") not in pairs(robot)
    assert ("panda0_link0", "panda0_link5") in pairs(robot)
    assert 0 < robot.sphere_bound <= 0.05


def test_the_benchmarks_panda() -> None:
    robot = read_robot(bench_file("panda_spherized.urdf"), fixed={"panda_finger_joint1": 0.065})
    assert (robot.name, len(robot.chain.sphere_radius), robot.sphere_bound) == ("panda", 59, 0.0)
    assert robot.velocity_limit.tolist() == [2.3925] * 4 + [2.871] * 3
    assert robot.fixed == {}  # the file welds the fingers
    with pytest.raises(
        InputError, match=r"panda.urdf: the collision mesh .*link0.* of panda_link0 is missing; looked for"
    ):
        read_robot(bench_file("panda.urdf"))


def test_meshes_are_found_and_scaled(tmp_path: Path) -> None:
    (tmp_path / "stuff" / "meshes").mkdir(parents=True)
    (tmp_path / "stuff" / "urdf").mkdir()
    write(tmp_path / "stuff" / "meshes", "cube.obj", CUBE)
    mesh = '<mesh filename="package://stuff/meshes/cube.obj" scale=".1 .2 .1"/>'
    text = URDF.replace('<box size=".06 .06 .3"/>', mesh)
    robot = read_robot(write(tmp_path / "stuff" / "urdf", "bent.urdf", text))
    at = robot.links.index("fore")
    middle = about([1, 0, 0], 0.1) @ [0.05, 0.1, 0.05] + [0, 0, 0.15]
    np.testing.assert_allclose(robot.chain.link_centre[at], middle, atol=0.02)
    assert 0.122 <= robot.chain.link_radius[at] <= 0.122 + 0.03


def stl(binary: bool) -> bytes:
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    faces = [[corners[i] for i in face] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    if binary:
        records = [np.array([[0, 0, 0], *face], "<f4").tobytes() + b"\0\0" for face in faces]
        return b"made by hand".ljust(80) + len(faces).to_bytes(4, "little") + b"".join(records)
    lines = ["solid made"]
    for face in faces:
        lines += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"  vertex {x} {y} {z}" for x, y, z in face),
            "endloop",
            "endfacet",
        ]
    return "\n".join([*lines, "endsolid"]).encode()


@pytest.mark.parametrize("binary", [True, False])
def test_stl_meshes_are_read_in_both_forms(tmp_path: Path, binary: bool) -> None:
    (tmp_path / "part.stl").write_bytes(stl(binary))
    text = URDF.replace('<box size=".06 .06 .3"/>', '<mesh filename="part.stl" scale=".1 .1 .1"/>')
    robot = read_robot(write(tmp_path, "bent.urdf", text))
    at = robot.links.index("fore")
    assert robot.chain.link_radius[at] == pytest.approx(0.1, abs=0.04)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<robot", "<robt", "bad.urdf:[0-9]+: not XML"),
        ('<robot name="bent">', "<robot", "bad.urdf:[0-9]+: not XML"),
        (
            'parent link="upper"',
            'parent link="uper"',
            "the joint elbow has the parent 'uper', which is no link; expected one",
        ),
        ('<child link="fore"/>', "", "the joint elbow has no child link"),
        ('<child link="fore"/>', '<child link="upper"/>', "two joints carry the link upper"),
        ('<parent link="base"/>', '<parent link="fore"/>', "the links .*upper.* hang in a loop; expected a tree"),
        (
            'name="elbow" type="revolute"',
            'name="elbow" type="ball"',
            "the joint elbow is of type 'ball'; expected revolute",
        ),
        ('name="elbow" type="revolute"', 'type="revolute"', "a <joint> without name"),
        ('<limit lower="-2" upper="2" velocity="1.5" effort="1"/>', "", "the joint elbow has no limits"),
        ('lower="-2" upper="2"', 'lower="-2" upper="two"', "the joint elbow: upper is 'two'; expected one number"),
        ('lower="-2" upper="2"', 'lower="-2" upper="nan"', "the joint elbow: upper is 'nan'; expected one number"),
        ('lower="-2" upper="2"', 'lower="2" upper="-2"', "elbow has the limits 2.0 to -2.0; expected two that"),
        (
            '<axis xyz="0 1 0"/>\n    <limit lower="-2"',
            '<axis xyz="0 0 0"/><limit lower="-2"',
            "elbow has the axis 0 0 0",
        ),
        ('xyz="0 0 .4" rpy', 'xyz="0 .4" rpy', "the origin of elbow: xyz is '0 .4'; expected 3 numbers"),
        (
            '<box size=".06 .06 .3"/>',
            '<box size=".06 .06"/>',
            "geometry of fore: size is '.06 .06'; expected 3 numbers",
        ),
        (
            '<box size=".06 .06 .3"/>',
            '<box size=".06 -.06 .3"/>',
            "geometry of fore: size is .*; expected more than zero",
        ),
        ('<box size=".06 .06 .3"/>', "<cone/>", "the collision geometry of fore is <cone>; expected box"),
        ('<box size=".06 .06 .3"/>', "", "the collision geometry of fore has no shape"),
        ('<cylinder radius=".05"', "<cylinder", "the collision geometry of upper: the cylinder has no radius"),
        ('<box size=".06 .06 .3"/>', '<mesh filename="no.stl"/>', "the collision mesh 'no.stl' of fore is missing"),
        ('<box size=".06 .06 .3"/>', '<mesh filename="bad.urdf"/>', "meshes of kind .urdf are not read; expected .stl"),
        ('<box size=".06 .06 .3"/>', '<mesh filename="flat.obj"/>', "fore: 4 points without volume"),
        ('<box size=".06 .06 .3"/>', '<mesh filename="odd.obj"/>', "odd.obj: not a mesh of kind .obj"),
        ('<box size=".06 .06 .3"/>', '<mesh filename="few.obj"/>', "few.obj: 1 vertices, or some not finite"),
        (
            '<mimic joint="finger_left"',
            '<mimic joint="thumb"',
            "unknown joint that finger_right mimics, thumb; expected",
        ),
    ],
)
def test_a_faulty_urdf_is_refused_with_place_and_fault(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in URDF
    write(tmp_path, "flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n")
    write(tmp_path, "odd.obj", "v 0 0 zero\n")
    write(tmp_path, "few.obj", "v 0 0 0\n")
    with pytest.raises(InputError, match=message) as caught:
        read_robot(write(tmp_path, "bad.urdf", URDF.replace(old, new)))
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"joints": ["lift", "knee"]}, "unknown joint to plan knee; expected some of: lift, elbow, turn, finger_left"),
        ({"joints": []}, "no joint to plan; the robot's movable joints are: lift, elbow"),
        ({"fixed": {"thumb": 0.1}}, "unknown held joint thumb; expected some of: lift"),
        ({"fixed": {"finger_left": np.nan}}, "the held joint finger_left is nan; expected a finite number"),
        ({"joints": ["lift"], "fixed": {"lift": 0.1}}, "lift both to be planned and held"),
        ({"group": "arm"}, "the group 'arm' needs an SRDF; found none beside the URDF"),
        ({"srdf": "no.srdf"}, "no.srdf: no such file"),
        ({"sphere_tolerance": -1.0}, "base: sphere tolerance -1.0; expected more than zero"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path: Path, arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_robot(write(tmp_path, "bent.urdf", URDF), **arguments)  # type: ignore[arg-type]


def test_files_that_are_no_robots_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.urdf: no such file; expected a robot as URDF or MJCF"):
        read_robot(tmp_path / "none.urdf")
    with pytest.raises(InputError, match=r"page.xml: the root element is <html>; expected <robot> .* or <mujoco>"):
        read_robot(write(tmp_path, "page.xml", "<html/>"))
    with pytest.raises(InputError, match=r"empty.urdf: 0 links and none to start from"):
        read_robot(write(tmp_path, "empty.urdf", '<robot name="empty"/>'))
    with pytest.raises(InputError, match=r"still.urdf: no joint to plan; the robot's movable joints are: none"):
        read_robot(write(tmp_path, "still.urdf", '<robot name="still"><link name="rock"/></robot>'))
    with pytest.raises(InputError, match=r"bad.xml: .*unrecognized attribute.*line 8"):
        read_robot(write(tmp_path, "bad.xml", TREE.replace('name="a" type', 'name="a" tpe')))
    missing = '<mujoco><asset><mesh name="m" file="lost.stl"/></asset><worldbody/></mujoco>'
    with pytest.raises(InputError, match=r"lost.xml: .*lost.stl"):
        read_robot(write(tmp_path, "lost.xml", missing))
    with pytest.raises(InputError, match=r"tree.xml: unknown joint to plan z; expected some of: a, b, c, d, e, f, g"):
        read_robot(write(tmp_path, "tree.xml", TREE), joints=["z"])
    with pytest.raises(InputError, match=r"void.xml: no body; expected a robot"):
        read_robot(write(tmp_path, "void.xml", "<mujoco/>"))
    endless = TREE.replace('axis="1 0 0" range="0 .2"', 'axis="1 0 0"')
    with pytest.raises(InputError, match="e has the limits -inf to inf; expected two that are finite and rise"):
        read_robot(write(tmp_path, "endless.xml", endless), joints=["e"])
