"""Problems are problems, the same from the same numbers, and survive being written."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from predplan.artifacts.provenance import Provenance
from predplan.planning.collisions import valid
from predplan.planning.kinematics import tool_trace
from predplan.planning.kitchens import (
    CLUTTER,
    DOOR,
    Kitchen,
    kitchen_cluttered,
    kitchen_constrained,
    kitchen_simple,
    microwave_mouth,
    with_open_door,
)
from predplan.planning.problems import ENDS_CLEAR, Problem, maze_problems, planar_problems
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, make_scene
from predplan.planning.tables import TEST, TUNING, read_problems, write_problems

Make = Callable[[int, np.random.Generator], list[Problem]]
IN_THE_PLANE: tuple[Make, ...] = (maze_problems, planar_problems)


def is_a_problem(problem: Problem) -> bool:
    """Both ends clear, the line between them not."""
    chain, obstacles = problem.robot.chain, problem.scene.obstacles
    line = problem.start + np.linspace(0, 1, 300)[:, None] * (problem.goal - problem.start)
    ends = valid(chain, obstacles, problem.start, ENDS_CLEAR) and valid(chain, obstacles, problem.goal, ENDS_CLEAR)
    return ends and not all(valid(chain, obstacles, q, 0.0) for q in line)


@pytest.mark.parametrize("make", IN_THE_PLANE)
def test_ends_are_clear_and_the_line_is_not(make: Make) -> None:
    assert all(map(is_a_problem, make(8, np.random.default_rng(0))))


@pytest.mark.parametrize("make", IN_THE_PLANE)
def test_same_numbers_same_problems(make: Make) -> None:
    once, again, other = (make(3, np.random.default_rng(seed)) for seed in (5, 5, 6))
    for a, b in zip(once, again, strict=True):
        np.testing.assert_array_equal(a.start, b.start)
        np.testing.assert_array_equal(a.goal, b.goal)
        assert repr(a.scene.shapes) == repr(b.scene.shapes)
    assert repr([(a.start, a.scene.shapes) for a in once]) != repr([(a.start, a.scene.shapes) for a in other])


def test_the_maze_is_fixed_and_the_first_problem_too() -> None:
    first, second = (maze_problems(2, np.random.default_rng(seed)) for seed in (0, 1))
    assert repr(first[0].scene.shapes) == repr(second[1].scene.shapes)
    np.testing.assert_array_equal(first[0].start, second[0].start)
    assert first[1].start[1] != second[1].start[1]


def test_twelve_discs_and_fixed_ends() -> None:
    problems = planar_problems(5, np.random.default_rng(0))
    assert all(len(problem.scene.shapes) == 12 for problem in problems)
    assert len({tuple(problem.start) + tuple(problem.goal) for problem in problems}) == 1


def test_problems_survive_being_written(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    parts = {TUNING: planar_problems(1, generator), TEST: planar_problems(2, generator)}
    write_problems(tmp_path, parts, Provenance())
    for part, problems in parts.items():
        for made, read in zip(problems, read_problems(tmp_path, part), strict=True):
            assert (made.name, made.robot.joints, made.robot.links) == (read.name, read.robot.joints, read.robot.links)
            for a, b in zip(made.robot.chain, read.robot.chain, strict=True):
                np.testing.assert_array_equal(a, b)
                assert np.asarray(a).dtype == np.asarray(b).dtype
            for a, b in zip(made.scene.obstacles, read.scene.obstacles, strict=True):
                np.testing.assert_array_equal(a, b)
            np.testing.assert_array_equal(made.start, read.start)


def test_every_shape_survives(tmp_path: Path) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (2.0, 3.0)])
    shapes: list[Shape] = [
        Box((1, 2, 3), (0.1, 0.2, 0.3), turn, "box"),
        Sphere((0, 1, 5), 0.5, "ball"),
        Capsule((0, 0, 5), (0, 0, 6), 0.1, "rod"),
        Cylinder((4, 4, 4), 0.5, 0.2, turn, "can"),
        Mesh(corners, "cube"),
    ]
    problem = maze_problems(1, np.random.default_rng(0))[0]
    made = Problem("all", problem.robot, make_scene(shapes, "all"), problem.start, problem.goal)
    write_problems(tmp_path, {TEST: [made]}, Provenance())
    read = read_problems(tmp_path, TEST)[0]
    assert read.scene.names == made.scene.names
    for a, b in zip(made.scene.obstacles, read.scene.obstacles, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


@pytest.fixture(scope="module")
def kitchen() -> Kitchen:
    if find_spec("gymnasium_robotics") is None:
        pytest.skip("the kitchen needs gymnasium-robotics")
    from predplan.planning.kitchen_files import read_kitchen

    return read_kitchen()


@pytest.mark.parametrize("make", [kitchen_simple, kitchen_cluttered, kitchen_constrained])
def test_kitchen_problems(kitchen: Kitchen, make: Callable[..., list[Problem]]) -> None:
    problems = make(kitchen, 3, np.random.default_rng(0))
    assert len(problems) == 3
    assert all(map(is_a_problem, problems))


def test_eight_objects_above_the_table(kitchen: Kitchen) -> None:
    problem = kitchen_cluttered(kitchen, 1, np.random.default_rng(0))[0]
    added = [shape for shape in problem.scene.shapes if shape.name.split()[0] in ("box", "bottle", "cylinder")]
    assert sorted(shape.name for shape in added) == [
        *("bottle 0", "bottle 1", "bottle 2", "box 0", "box 1", "cylinder 0", "cylinder 1")
    ]
    low, high = (np.array(corner) for corner in CLUTTER)
    for shape in added:
        assert not isinstance(shape, Mesh)
        middle = np.asarray(shape.centre if not isinstance(shape, Capsule) else (np.add(shape.a, shape.b)) / 2)
        assert np.all(middle >= low - 1e-9)
        assert np.all(middle <= high + 1e-9)
    assert len([shape for shape in problem.scene.shapes if shape.name.startswith("kettleroot")]) == 5


def test_one_goal_inside_the_microwave(kitchen: Kitchen) -> None:
    problems = kitchen_constrained(kitchen, 3, np.random.default_rng(0))
    assert len({tuple(problem.goal) for problem in problems}) == 1
    tool = tool_trace(problems[0].robot.chain, problems[0].goal[None])[0]
    walls = np.array(
        [s.centre for s in problems[0].scene.shapes if s.name.startswith("microroot") and isinstance(s, Box)]
    )
    assert np.all(tool > walls.min(axis=0) - 0.25)
    assert np.all(tool < walls.max(axis=0) + 0.25)
    door = next(shape for shape in kitchen.shapes if shape.name.startswith(DOOR) and isinstance(shape, Box))
    opened = next(shape for shape in with_open_door(kitchen.shapes) if shape.name == door.name)
    assert isinstance(opened, Box)
    hinge = np.asarray(door.centre) - np.asarray(door.rotation)[:, 0] * np.asarray(door.half)[0]
    for shape in (door, opened):
        edge = np.asarray(shape.centre) - np.asarray(shape.rotation)[:, 0] * np.asarray(shape.half)[0]
        np.testing.assert_allclose(edge, hinge, atol=1e-9)
    assert microwave_mouth(kitchen.shapes).shape == (3,)
