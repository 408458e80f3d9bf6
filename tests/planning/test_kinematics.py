"""Forward kinematics against MuJoCo's, and Jacobians against finite differences."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from predplan.planning.kinematics import forward, point_jacobian, poses, tool_position, tool_trace
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import FloatArray, Robot
from tests.planning.models import TREE, bench_file, kitchen, urdf_in_mujoco, write


def mujoco_at(model: Any, robot: Robot, q: FloatArray) -> Any:
    data = mujoco.MjData(model)
    for joint, value in [*zip(robot.joints, q, strict=True), *robot.fixed.items()]:
        data.qpos[model.joint(joint).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    return data


def spheres_at(robot: Robot, q: FloatArray) -> FloatArray:
    joints, spheres = len(q), len(robot.chain.sphere_radius)
    centres = np.empty((spheres, 3))
    forward(robot.chain, q, np.empty((joints + 1, 3, 3)), np.empty((joints + 1, 3)), centres)
    return centres


@pytest.mark.parametrize("joints", ["abcdefg", "acd", "cg", "e"])
def test_a_tree_of_slides_and_hinges_is_where_mujoco_puts_it(tmp_path: Path, joints: str) -> None:
    path = write(tmp_path, "tree.xml", TREE)
    held = {name: value for name, value in {"b": 0.25, "f": 1.1, "g": -0.7}.items() if name not in joints}
    robot = read_robot(path, joints=list(joints), fixed=held, tool="tip")
    model = mujoco.MjModel.from_xml_path(str(path))
    generator = np.random.default_rng(3)
    for _ in range(50):
        q = generator.uniform(robot.chain.lower, robot.chain.upper)
        data = mujoco_at(model, robot, q)
        expected = [
            data.geom_xpos[g]
            for link in robot.links
            for g in range(model.ngeom)
            if model.geom_bodyid[g] == model.body(link).id and model.geom_contype[g]
        ]
        np.testing.assert_allclose(spheres_at(robot, q), expected, atol=1e-9)
        np.testing.assert_allclose(tool_trace(robot.chain, q[None])[0], data.site("tip").xpos, atol=1e-9)


def test_the_panda_of_the_benchmark_is_where_mujoco_puts_it() -> None:
    path = bench_file("panda_spherized.urdf")
    robot, model = read_robot(path, fixed={"panda_finger_joint1": 0.065}), urdf_in_mujoco(path)
    assert robot.joints == tuple(f"panda_joint{i}" for i in range(1, 8))
    names = [model.body(body).name for body in range(model.nbody)]
    generator = np.random.default_rng(4)
    for _ in range(50):
        q = generator.uniform(robot.chain.lower, robot.chain.upper)
        data = mujoco_at(model, robot, q)
        bodies = [names.index(link) if link in names else 0 for link in robot.links]
        expected = [data.geom_xpos[g] for body in bodies for g in range(model.ngeom) if model.geom_bodyid[g] == body]
        np.testing.assert_allclose(spheres_at(robot, q), expected, atol=1e-6)


def test_the_panda_in_the_kitchen_is_where_mujoco_puts_it() -> None:
    robot = read_robot(kitchen(), sphere_tolerance=0.05)
    model = mujoco.MjModel.from_xml_path(str(kitchen()))
    assert robot.joints == tuple(f"robot:panda0_joint{i}" for i in range(1, 8))
    generator = np.random.default_rng(5)
    configurations = generator.uniform(robot.chain.lower, robot.chain.upper, (50, 7))
    rotations, positions = poses(robot.chain, configurations)
    tips = tool_trace(robot.chain, configurations)
    for i, q in enumerate(configurations):
        data = mujoco_at(model, robot, q)
        for j in range(1, 8):
            body = data.body(f"panda0_link{j}")
            np.testing.assert_allclose(positions[i, j], body.xpos, atol=1e-6)
            np.testing.assert_allclose(rotations[i, j], body.xmat.reshape(3, 3), atol=1e-6)
        np.testing.assert_allclose(tips[i], data.site("end_effector").xpos, atol=1e-6)


def test_jacobians_are_what_finite_differences_give(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, "tree.xml", TREE), joints=list("abcdefg"), tool="tip")
    chain, step = robot.chain, 1e-6
    rotations, positions, point, jacobian = np.empty((8, 3, 3)), np.empty((8, 3)), np.empty(3), np.empty((3, 7))
    for q in np.random.default_rng(6).uniform(chain.lower, chain.upper, (20, 7)):
        forward(chain, q, rotations, positions, np.empty((len(chain.sphere_radius), 3)))
        tool_position(chain, rotations, positions, point)
        point_jacobian(chain, rotations, positions, chain.tool_frame, point, jacobian)
        ahead, behind = (tool_trace(chain, q + sign * step * np.eye(7)) for sign in (1, -1))
        np.testing.assert_allclose(jacobian, (ahead - behind).T / (2 * step), atol=1e-8)
