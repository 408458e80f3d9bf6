"""The kitchen of gymnasium-robotics, from its MJCF."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np

from predplan.errors import InputError
from predplan.planning.kitchens import Kitchen
from predplan.planning.robot_files import read_robot
from predplan.planning.scene_files import read_scene

MODEL = "envs/assets/kitchen_franka/kitchen_assets/kitchen_env_model.xml"

NEIGHBOURS = "panda0_link5", "panda0_link7"
"""The wrist's crossed axes keep these links beside each other, closer than spheres that cover them tell; MoveIt's own
description of the arm lets them be, too."""


def kitchen_model() -> Path:
    """The model's file. Raises InputError where gymnasium-robotics is not installed."""
    found = importlib.util.find_spec("gymnasium_robotics")  # not imported: that takes seconds
    if found is None or found.origin is None:
        raise InputError("the kitchen suites need gymnasium-robotics: pip install 'predplan[planning,kitchen]'")
    return Path(found.origin).parent / MODEL


def read_kitchen() -> Kitchen:
    """The robot and all that can be touched in the kitchen."""
    path = kitchen_model()
    robot = read_robot(path)
    allowed = {robot.links.index(link) for link in NEIGHBOURS}
    pairs = np.array([pair for pair in robot.chain.link_pairs.tolist() if set(pair) != allowed])
    return Kitchen(replace(robot, chain=robot.chain._replace(link_pairs=pairs)), read_scene(path).shapes)
