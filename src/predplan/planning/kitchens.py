"""Planning problems in a kitchen (§4.7.3 to §4.7.8): beside a cabinet, among objects, into the microwave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from predplan.errors import PredplanError
from predplan.planning.collisions import valid
from predplan.planning.kinematics import tool_trace
from predplan.planning.problems import ENDS_CLEAR, Problem, poses_a_problem
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.running import tool_jacobian
from predplan.planning.scenes import Box, Capsule, Cylinder, Scene, Shape, make_scene, moved

KETTLE, DOOR = "kettleroot", "microdoorroot"
"""How the names of the model's kettle and microwave door begin."""
CABINET_WAY = (-0.30, 0.50, 2.15), (0.45, 0.45, 2.65)
"""m: from under the hinged cabinet to the other side, up beside the sliding one."""
CABINET_SPREAD = 0.05
"""m: the ends of all but the first problem beside the cabinet lie up to this far from it along each axis."""
WORKSPACE = (-0.65, 0.15, 1.70), (0.65, 0.80, 2.50)
"""m: corners of the box in which the end effector starts and ends."""
CLUTTER = (-0.50, 0.30, 1.72), (0.50, 0.80, 2.35)
"""m: corners of the box in which objects' middles are placed."""
LEAST_WAY = 0.4
"""m: between the end effector's start and goal."""
NEARER = (0.35, -0.06, 0.10)
"""m: how the kitchen is moved towards the robot, which then stands beside the counter of the microwave."""
DOOR_ANGLE = -1.9
"""rad: how far the microwave's door is open."""
INTO = 0.06
"""m: how deep behind the microwave's front edge the end effector's goal is."""
ATTEMPTS = 20_000


@dataclass(frozen=True)
class Kitchen:
    """A robot in a kitchen, as the model has them."""

    robot: Robot
    shapes: tuple[Shape, ...]


def kitchen_simple(kitchen: Kitchen, count: int, generator: np.random.Generator) -> list[Problem]:
    """The task beside the cabinet (Fig. 4.10); the first problem's ends are CABINET_WAY, the others' vary about it."""
    scene = make_scene(kitchen.shapes, "cabinet")
    spread = CABINET_SPREAD
    fixed = np.random.default_rng(0)  # the first problem is one and the same whatever the seed
    problems = []
    for n in range(count):
        source, by = (fixed, 0.0) if n == 0 else (generator, spread)

        def drawn(source: np.random.Generator = source, by: float = by) -> tuple[FloatArray, FloatArray]:
            start, goal = (np.array(end) + source.uniform(-by, by, 3) for end in CABINET_WAY)
            first = reach(kitchen.robot, scene, start, source)
            return first, reach(kitchen.robot, scene, goal, source, first)

        start, goal = _problem(kitchen.robot, scene, drawn, source, f"cabinet-{n}")
        problems.append(Problem(f"cabinet-{n}", kitchen.robot, scene, start, goal))
    return problems


def kitchen_cluttered(kitchen: Kitchen, count: int, generator: np.random.Generator) -> list[Problem]:
    """Two boxes, three bottles, a kettle and two cylinders above the table, random ends (Fig. 4.12)."""
    robot, problems = kitchen.robot, []
    kettle = [shape for shape in kitchen.shapes if shape.name.startswith(KETTLE)]
    fixed = [shape for shape in kitchen.shapes if not shape.name.startswith(KETTLE)]
    for n in range(count):
        scene = make_scene([*fixed, *_clutter(kettle, generator)], f"clutter-{n}")

        def drawn(scene: Scene = scene) -> tuple[FloatArray, FloatArray]:
            return _above_table(robot, scene, generator), _above_table(robot, scene, generator)

        start, goal = _problem(robot, scene, drawn, generator, scene.name)
        problems.append(Problem(scene.name, robot, scene, start, goal))
    return problems


def kitchen_constrained(kitchen: Kitchen, count: int, generator: np.random.Generator) -> list[Problem]:
    """One goal inside the open microwave, the kitchen nearer, random starts (Fig. 4.14)."""
    robot = kitchen.robot
    inside = microwave_mouth(kitchen.shapes) + np.array(NEARER)
    scene = make_scene(
        [moved(shape, np.eye(3), np.array(NEARER)) for shape in with_open_door(kitchen.shapes)], "microwave"
    )
    goal = reach(robot, scene, inside, np.random.default_rng(0))  # one goal whatever the seed
    problems = []
    for n in range(count):

        def drawn() -> tuple[FloatArray, FloatArray]:
            return _above_table(robot, scene, generator), goal

        start, _ = _problem(robot, scene, drawn, generator, f"microwave-{n}")
        problems.append(Problem(f"microwave-{n}", robot, scene, start, goal))
    return problems


def with_open_door(shapes: Sequence[Shape]) -> list[Shape]:
    """The shapes with the microwave's door turned about its left edge by DOOR_ANGLE."""
    panel = next(shape for shape in shapes if shape.name.startswith(DOOR) and isinstance(shape, Box))
    rotation, half = np.asarray(panel.rotation), np.asarray(panel.half)
    hinge = np.asarray(panel.centre) - rotation[:, 0] * half[0]
    cosine, sine = np.cos(DOOR_ANGLE), np.sin(DOOR_ANGLE)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return [moved(shape, turn, hinge - turn @ hinge) if shape.name.startswith(DOOR) else shape for shape in shapes]


def microwave_mouth(shapes: Sequence[Shape]) -> FloatArray:
    """A place INTO m behind the middle of the closed door's opening side."""
    panel = next(shape for shape in shapes if shape.name.startswith(DOOR) and isinstance(shape, Box))
    rotation, half, centre = np.asarray(panel.rotation), np.asarray(panel.half), np.asarray(panel.centre)
    # The door also covers the panel of buttons; the oven behind it ends at four fifths of the way.
    return np.asarray(centre - 0.2 * half[0] * rotation[:, 0] + (half[1] + INTO) * rotation[:, 1])


def reach(
    robot: Robot, scene: Scene, target: FloatArray, generator: np.random.Generator, near: FloatArray | None = None
) -> FloatArray:
    """A valid configuration [D] whose end effector is at the target (m), by damped least squares from random ones.

    near: of several found, the one nearest to this configuration. Raises PredplanError if none is found.
    """
    chain = robot.chain
    found: list[FloatArray] = []
    for _ in range(ATTEMPTS // 40):
        q = generator.uniform(chain.lower, chain.upper)
        for _ in range(60):
            gap = target - tool_trace(chain, q[None])[0]
            if np.linalg.norm(gap) < 1e-3:
                break
            jacobian = tool_jacobian(robot, q)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-3 * np.eye(3), gap)
            q = np.clip(q + step, chain.lower, chain.upper)
        else:
            continue
        if valid(chain, scene.obstacles, q, ENDS_CLEAR):
            if near is None:
                return q
            found.append(q)
            if len(found) == 10:
                break
    if near is None or not found:
        raise PredplanError(f"{scene.name}: no valid configuration has its end effector at {target.round(3).tolist()}")
    return min(found, key=lambda q: float(np.linalg.norm(q - near)))


def _problem(
    robot: Robot,
    scene: Scene,
    draw: Callable[[], tuple[FloatArray, FloatArray]],
    generator: np.random.Generator,
    name: str,
) -> tuple[FloatArray, FloatArray]:
    """The first drawn start and goal that are far enough apart and pose a problem."""
    for _ in range(200):
        start, goal = draw()
        way = np.diff(tool_trace(robot.chain, np.stack([start, goal])), axis=0)
        if np.linalg.norm(way) >= LEAST_WAY and poses_a_problem(robot, scene, start, goal, generator):
            return start, goal
    raise PredplanError(f"{name}: no start and goal found that are clear, apart, and need a way around")


def _above_table(robot: Robot, scene: Scene, generator: np.random.Generator) -> FloatArray:
    """A random valid configuration [D] whose end effector is in WORKSPACE."""
    chain = robot.chain
    low, high = (np.array(corner) for corner in WORKSPACE)
    for _ in range(ATTEMPTS):
        q = generator.uniform(chain.lower, chain.upper)
        tool = tool_trace(chain, q[None])[0]
        if np.all(tool >= low) and np.all(tool <= high) and valid(chain, scene.obstacles, q, ENDS_CLEAR):
            return q
    raise PredplanError(f"{scene.name}: no valid configuration above the table in {ATTEMPTS} draws")


def _clutter(kettle: Sequence[Shape], generator: np.random.Generator) -> list[Shape]:
    """Two boxes, three bottles (capsules), a kettle and two cylinders, upright, turned about z at random."""
    low, high = (np.array(corner) for corner in CLUTTER)
    made: list[Shape] = []
    for k in range(2):
        half = generator.uniform(0.03, 0.07, 3)
        made.append(Box(generator.uniform(low, high), half, _turn(generator), name=f"box {k}"))
    for k in range(3):
        middle, half_height = generator.uniform(low, high), np.array([0.0, 0.0, generator.uniform(0.06, 0.1)])
        made.append(Capsule(middle - half_height, middle + half_height, 0.035, name=f"bottle {k}"))
    body = next(shape for shape in kettle if isinstance(shape, Box))
    place, turn = generator.uniform(low, high), _turn(generator)
    made += [moved(shape, turn, place - turn @ np.asarray(body.centre)) for shape in kettle]
    for k in range(2):
        made.append(Cylinder(generator.uniform(low, high), 0.06, 0.04, _turn(generator), name=f"cylinder {k}"))
    return made


def _turn(generator: np.random.Generator) -> FloatArray:
    angle = generator.uniform(0.0, 2.0 * np.pi)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
