"""Small robots and scenes as text, and where the published ones are, if this machine has them."""

import importlib.util
import os
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from predplan.planning.distances import nearest
from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Obstacles

MIRROR = Path(os.environ.get("PREDPLAN_MIRROR", Path(__file__).parents[3] / "shared" / "data"))
BENCH = MIRROR / "motion-bench"

TREE = """
<mujoco model="tree">
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -1"/>
    <body name="base" pos=".1 -.2 .3" euler="10 20 30">
      <geom type="sphere" size=".05" pos="0 0 .02"/>
      <body name="one" pos="0 .1 .2" euler="40 0 15">
        <joint name="a" type="hinge" axis="1 2 3" pos=".02 0 .01" range="-2 2" limited="true"/>
        <joint name="b" type="slide" axis="0 1 1" range="-.3 .5" ref=".1" limited="true"/>
        <joint name="c" type="hinge" axis="0 0 1" pos="0 .05 0" ref=".4"/>
        <geom type="sphere" size=".04" pos=".03 .02 .01"/>
        <geom type="sphere" size=".03" pos=".13 .02 .01"/>
        <geom type="sphere" size=".09" contype="0" conaffinity="0"/>
        <body name="two" pos=".3 0 0" quat=".5 .5 -.5 .5">
          <joint name="d" type="hinge" axis="0 1 0" range="-80 100"/>
          <geom type="sphere" size=".04" pos="0 .1 .1"/>
          <site name="tip" pos="0 .2 .2"/>
        </body>
        <body name="three" pos="-.2 .1 0">
          <joint name="e" type="slide" axis="1 0 0" range="0 .2"/>
          <joint name="f" type="hinge" axis="1 1 0" pos=".1 0 0"/>
          <joint name="g" type="hinge" axis="0 0 1"/>
          <geom type="sphere" size=".05" pos="0 -.1 .1"/>
          <body name="far" pos=".1 .2 .3" euler="5 6 7"><geom type="sphere" size=".03"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="two" body2="far"/></contact>
  <actuator><motor joint="a"/></actuator>
</mujoco>
"""

URDF = """
<robot name="bent">
  <link name="base"><collision><geometry><sphere radius=".1"/></geometry></collision></link>
  <link name="upper">
    <collision><origin xyz="0 0 .2"/><geometry><cylinder radius=".05" length=".4"/></geometry></collision>
  </link>
  <link name="fore">
    <collision><origin xyz="0 0 .15" rpy=".1 0 0"/><geometry><box size=".06 .06 .3"/></geometry></collision>
  </link>
  <link name="wrist"/>
  <link name="left"><collision><geometry><sphere radius=".02"/></geometry></collision></link>
  <link name="right"><collision><geometry><sphere radius=".02"/></geometry></collision></link>
  <joint name="lift" type="prismatic">
    <origin xyz="0 0 .1"/><parent link="base"/><child link="upper"/><axis xyz="0 0 2"/>
    <limit lower="0" upper=".4" velocity=".5" effort="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <origin xyz="0 0 .4" rpy="1.5708 0 .2"/><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1.5" effort="1"/>
  </joint>
  <joint name="turn" type="continuous">
    <origin xyz="0 0 .3"/><parent link="fore"/><child link="wrist"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="finger_left" type="prismatic">
    <origin xyz="0 .01 .05"/><parent link="wrist"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper=".04" velocity=".1" effort="1"/>
  </joint>
  <joint name="finger_right" type="prismatic">
    <origin xyz="0 -.01 .05"/><parent link="wrist"/><child link="right"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper=".04" velocity=".1" effort="1"/><mimic joint="finger_left" multiplier="1" offset=".01"/>
  </joint>
</robot>
"""

SRDF = """
<robot name="bent">
  <group name="hand"><joint name="finger_left"/></group>
  <group name="arm"><chain base_link="base" tip_link="wrist"/></group>
  <group name="elbow_only"><link name="fore"/></group>
  <group name="both"><group name="hand"/><group name="arm"/></group>
  <disable_collisions link1="base" link2="left" reason="Never"/>
</robot>
"""

SCENE = """
name: shelf
world:
  collision_objects:
    - id: plank
      primitives: [{type: box, dimensions: [1, .5, 0.02]}]
      primitive_poses: [{position: [0, .5, .4], orientation: [0, 0, 0.7071067811865476, 0.7071067811865476]}]
    - id: can
      primitives:
        - {type: cylinder, dimensions: [.14, .03]}
        - {type: sphere, dimensions: [5e-2]}
      primitive_poses:
        - {position: {x: .1, y: .2, z: .3}}
        - {position: [0, 0, 1], orientation: {x: 0, y: 0, z: 0, w: 1}}
    - id: wedge
      pose: {position: [2, 0, 0], orientation: [0, 0, 0, 1]}
      meshes: [{vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], {x: 0, y: 0, z: 1}], triangles: []}]
    - id: ground
      planes: [{coef: [0, 0, 1, 0.5]}]
      plane_poses: [{position: [0, 0, 0]}]
"""

REQUEST = """
group_name: arm
start_state:
  joint_state: {name: [lift, elbow, turn, finger_left], position: [0.1, 0, 0, 0.02]}
goal_constraints:
  - joint_constraints:
      - {joint_name: elbow, position: 1}
      - {joint_name: lift, position: 0.2}
      - {joint_name: turn, position: -1e-1}
"""


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def bench_file(*parts: str) -> Path:
    """A file of the published problems; the test is skipped where they are not at hand."""
    path = BENCH.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"the motion-bench files are not under {BENCH}")
    return path


def kitchen() -> Path:
    """Gymnasium-Robotics' kitchen with a Franka Panda in it."""
    spec = importlib.util.find_spec("gymnasium_robotics")
    if spec is None or spec.origin is None:
        pytest.skip("gymnasium-robotics is not installed")
    folder = Path(spec.origin).parent / "envs" / "assets" / "kitchen_franka"
    return folder / "kitchen_assets" / "kitchen_env_model.xml"


def urdf_in_mujoco(path: Path) -> Any:
    """A URDF as MuJoCo reads it, without visual geometry, its fixed links kept apart."""
    root = ET.parse(path).getroot()
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    extension = ET.SubElement(root, "mujoco")
    ET.SubElement(extension, "compiler", fusestatic="false", boundmass="1", boundinertia="1")
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def nearest_to(obstacles: Obstacles, point: ArrayLike, ceiling: float = 100.0) -> tuple[float, FloatArray, int]:
    """The signed distance of a point [3], its gradient [3] and the obstacle's number."""
    x, y, z = np.asarray(point, dtype=np.float64).tolist()
    distance, nx, ny, nz, obstacle = nearest(obstacles, x, y, z, ceiling)
    return float(distance), np.array([nx, ny, nz]), int(obstacle)


def random_rotation(generator: np.random.Generator) -> FloatArray:
    rotation, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    return np.ascontiguousarray(rotation * np.linalg.det(rotation))
