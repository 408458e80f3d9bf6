"""Planning problems of chapter 4 that need no model: a point in a maze, an arm among discs in the plane.

Every generator is given its random numbers; the same generator gives the same problems.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from predplan.errors import PredplanError
from predplan.planning.collisions import valid
from predplan.planning.robots import FloatArray, Robot, planar_arm, point_robot
from predplan.planning.sampling import connect
from predplan.planning.scenes import Capsule, Scene, Shape, Sphere, make_scene

MAZE_WALLS = (
    ("lower left", (0.20, 0.0), (0.20, 0.42)),
    ("upper", (0.50, 1.0), (0.50, 0.58)),
    ("lower right", (0.80, 0.0), (0.80, 0.42)),
)
MAZE_WALL_RADIUS = 0.1
"""Foot and end of each wall's middle line and half its thickness, m; the way goes over, under and over.

Ends are round: in the flat end of a wall the nearest free point lies sideways, and no gradient leads around it.
"""
MAZE_ENDS = (0.04, 0.50), (0.96, 0.50)
"""m: start and goal of the first maze problem; later ones start and end up to MAZE_SPREAD above or below."""
MAZE_SPREAD = 0.03
ARM_LENGTHS, ARM_RADIUS = (0.4, 0.35, 0.25), 0.025
ARM_START, ARM_GOAL = np.array([-0.35, 0.8, 0.65]), np.array([2.1, 0.7, 0.75])
DISCS, DISC_RADII, DISC_REACH = 12, (0.03, 0.08), (0.8, 1.15)
"""How many discs, their radii (m), and how far from the arm's base their centres are (m)."""
ENDS_CLEAR = 0.02
"""m: start and goal of every problem keep this clear of obstacles."""
ATTEMPTS = 2_000
REACH, RESOLUTION, SEARCH = 0.7, 0.05, 2000
"""Longest motion and its resolution (rad or m), and iterations, of the search that tells whether there is a way."""
CHECKED = 200
"""Configurations of the straight line that are looked at to tell whether it collides."""


@dataclass(frozen=True)
class Problem:
    """From start to goal [D] (rad or m) without touching the scene."""

    name: str
    robot: Robot
    scene: Scene
    start: FloatArray
    goal: FloatArray


def maze_problems(count: int, generator: np.random.Generator) -> list[Problem]:
    """A disc in one fixed maze (Fig. 4.9); the first problem has the ends of MAZE_ENDS, the others move up or down."""
    robot = point_robot(0.015, 0.0, 1.0)
    walls = [Capsule((*foot, 0.0), (*end, 0.0), MAZE_WALL_RADIUS, name=name) for name, foot, end in MAZE_WALLS]
    scene = make_scene(walls, "maze")
    problems = []
    for n in range(count):
        shifts = generator.uniform(-MAZE_SPREAD, MAZE_SPREAD, 2) * (n > 0)
        start, goal = (np.array([x, y + shift]) for (x, y), shift in zip(MAZE_ENDS, shifts, strict=True))
        problems.append(Problem(f"maze-{n}", robot, scene, start, goal))
    return problems


def planar_problems(count: int, generator: np.random.Generator) -> list[Problem]:
    """A 3-joint arm among 12 random discs, with one start and goal for all (§4.7.1); the straight line always collides.

    Discs lie where the arm's end passes, which is bent: the stretched arm is singular, and no gradient folds it.
    """
    robot = planar_arm(ARM_LENGTHS, ARM_RADIUS)
    problems = []
    for n in range(count):
        for _ in range(ATTEMPTS):
            scene = make_scene(_discs(generator), f"discs-{n}")
            if poses_a_problem(robot, scene, ARM_START, ARM_GOAL, generator):
                problems.append(Problem(f"planar-{n}", robot, scene, ARM_START, ARM_GOAL))
                break
        else:
            raise PredplanError(f"planar-{n}: no scene in {ATTEMPTS} that leaves start and goal clear")
    return problems


def _discs(generator: np.random.Generator) -> Sequence[Shape]:
    distance = generator.uniform(*DISC_REACH, DISCS)
    angle = generator.uniform(0.0, np.pi, DISCS)
    radii = generator.uniform(*DISC_RADII, DISCS)
    return [
        Sphere((r * np.cos(a), r * np.sin(a), 0.0), float(radius))
        for r, a, radius in zip(distance, angle, radii, strict=True)
    ]


def poses_a_problem(
    robot: Robot, scene: Scene, start: FloatArray, goal: FloatArray, generator: np.random.Generator
) -> bool:
    """Whether both ends are clear, the straight line between them is not, and RRT-Connect finds another way."""
    chain, obstacles = robot.chain, scene.obstacles
    if not valid(chain, obstacles, start, ENDS_CLEAR) or not valid(chain, obstacles, goal, ENDS_CLEAR):
        return False
    between = np.linspace(0.0, 1.0, CHECKED)[1:-1, None]
    if all(valid(chain, obstacles, q, 0.0) for q in start + between * (goal - start)):
        return False
    return len(connect(chain, obstacles, start, goal, generator, REACH, RESOLUTION, 0.0, SEARCH)) > 0
