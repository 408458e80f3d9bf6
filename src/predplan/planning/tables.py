"""The planning branch's tables: their schemas, and the way between them and problems, robots and scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from predplan.artifacts.files import read_json, write_json
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import Column, TableSchema, read_rows, write_rows
from predplan.errors import InputError
from predplan.planning.problems import Problem
from predplan.planning.robots import Chain, Robot
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Scene, Shape, Sphere, make_scene

TUNING, TEST = "tuning", "test"

_FLOATS = pa.list_(pa.float64())
_METHOD = Column("method", pa.string(), "1", "name of the method")
_OTHER = Column("other", pa.string(), "1", "name of the method it is held against")
_PROBLEM = Column("problem", pa.string(), "1", "name of the problem")
_ITERATION = Column("iteration", pa.int32(), "1", "iterations done; 0 is the straight line")
_LAMBDA = Column("inverse_step", pa.float64(), "1", "λ, the inverse step of Eq. 4.11, kernel normalised")
_MAXIMUM = Column("maximum", pa.float64(), "m", "workspace cost of the worst body sphere at the worst of 101 times")
_INTEGRAL = Column("integral", pa.float64(), "m2", "workspace cost by arc length, summed over the body's spheres")
_VELOCITY = Column("velocity", pa.float64(), "rad2 or m2", "half the mean of squared velocity, t in [0, 1]")
_ACCELERATION = Column("acceleration", pa.float64(), "rad2 or m2", "half the mean of squared acceleration, t in [0, 1]")
_Q = Column("q", _FLOATS, "rad or m", "configuration, joint by joint")
_S = Column("s", pa.float64(), "1", "normalised time, 0 to 1")

MEASURES = ("maximum", "integral", "velocity", "acceleration")

PROBLEMS = TableSchema(
    "problems",
    "problems",
    (
        Column("part", pa.string(), "1", "tuning: steps are chosen on it; test: methods are compared on it"),
        _PROBLEM,
        Column("scene", pa.string(), "1", "name of its scene among the shapes"),
        Column("start", _FLOATS, "rad or m", "configuration, joint by joint"),
        Column("goal", _FLOATS, "rad or m", "configuration, joint by joint"),
    ),
)
SHAPES = TableSchema(
    "shapes",
    "problems",
    (
        Column("scene", pa.string(), "1", "name of the scene"),
        Column("obstacle", pa.string(), "1", "name of the obstacle"),
        Column("kind", pa.string(), "1", "box, sphere, capsule, cylinder or mesh"),
        Column("numbers", _FLOATS, "m or 1", "its sizes and pose, field by field as in predplan.planning.scenes"),
    ),
)
STEPS = TableSchema(
    "steps",
    "tune",
    (
        _METHOD,
        _LAMBDA,
        Column("free", pa.float64(), "1", "share of the tuning problems certified free of collision"),
        _MAXIMUM,
        _INTEGRAL,
        _VELOCITY,
        _ACCELERATION,
        Column("chosen", pa.bool_(), "1", "whether the method is compared with this step"),
    ),
)
COSTS = TableSchema("costs", "plan", (_METHOD, _PROBLEM, _ITERATION, _MAXIMUM, _INTEGRAL, _VELOCITY, _ACCELERATION))
OUTCOMES = TableSchema(
    "outcomes",
    "plan",
    (
        _METHOD,
        _PROBLEM,
        _LAMBDA,
        Column("free", pa.bool_(), "1", "whether the whole last trajectory is proved free of collision and in limits"),
        Column("reason", pa.string(), "1", "if not, what was found where"),
    ),
)
TRAJECTORIES = TableSchema("trajectories", "plan", (_METHOD, _PROBLEM, _ITERATION, _S, _Q))
SUPPORTS = TableSchema(
    "supports",
    "plan",
    (_METHOD, _PROBLEM, _ITERATION, Column("times", _FLOATS, "1", "normalised times whose coefficients are not zero")),
)
TIMES = TableSchema(
    "times",
    "plan",
    (
        _METHOD,
        Column("samples", pa.int32(), "1", "times at which the arm is looked at in an iteration"),
        Column("repeat", pa.int32(), "1", "number of the descent; all methods take turns"),
        Column("time_ms", pa.float64(), "ms", "wall time of an iteration, mean over ten"),
    ),
)

CURVES = TableSchema(
    "curves",
    "compare",
    (
        _METHOD,
        _ITERATION,
        Column("measure", pa.string(), "1", "maximum, integral, velocity or acceleration, as in the table of costs"),
        Column("mean", pa.float64(), "as the measure", "mean over problems"),
        Column("standard_error", pa.float64(), "as the measure", "standard error of the mean"),
        Column("n", pa.int32(), "1", "problems"),
    ),
)
COMPARISONS = TableSchema(
    "comparisons",
    "compare",
    (
        _METHOD,
        _OTHER,
        _ITERATION,
        Column("measure", pa.string(), "1", "maximum, integral, velocity or acceleration, as in the table of costs"),
        Column("n", pa.int32(), "1", "problems"),
        Column("difference", pa.float64(), "as the measure", "mean cost of the method less that of the other"),
        Column("effect", pa.float64(), "1", "mean difference over the standard deviation of differences"),
        Column("t", pa.float64(), "1", "Student's t of paired samples"),
        Column("t_p", pa.float64(), "1", "its p-value, two-sided"),
        Column("w", pa.float64(), "1", "Wilcoxon's signed-rank statistic"),
        Column("w_z", pa.float64(), "1", "its normal score, below zero where the method costs less"),
        Column("w_p", pa.float64(), "1", "its p-value, two-sided"),
    ),
)
EXAMPLE = TableSchema(
    "example",
    "compare",
    (
        _METHOD,
        _ITERATION,
        _S,
        _Q,
        Column("tool", _FLOATS, "m", "where the end effector is: x, y, z"),
        Column("body", _FLOATS, "m", "where the body's joints and end effector are, x and y in turn; empty in 3-D"),
    ),
)
FIELD = TableSchema(
    "field",
    "compare",
    (
        Column("x", pa.float64(), "m", "place"),
        Column("y", pa.float64(), "m", "place"),
        Column("cost", pa.float64(), "m", "workspace cost of a point of the plane, in the first problem's scene"),
    ),
)

_SHAPES: Mapping[str, tuple[type[Any], Mapping[str, tuple[int, ...]]]] = {
    "box": (Box, {"centre": (3,), "half": (3,), "rotation": (3, 3)}),
    "sphere": (Sphere, {"centre": (3,), "radius": ()}),
    "capsule": (Capsule, {"a": (3,), "b": (3,), "radius": ()}),
    "cylinder": (Cylinder, {"centre": (3,), "half": (), "radius": (), "rotation": (3, 3)}),
    "mesh": (Mesh, {"vertices": (-1, 3)}),
}


def write_problems(folder: Path, parts: Mapping[str, Sequence[Problem]], provenance: Provenance) -> None:
    """Write problems.parquet, shapes.parquet and robot.json; all problems have one robot."""
    robot = next(problem.robot for problems in parts.values() for problem in problems)
    rows, scenes = [], {}
    for part, problems in parts.items():
        for problem in problems:
            scene = f"{part}-{problem.scene.name}"
            scenes[scene] = problem.scene
            ends = {"start": problem.start.tolist(), "goal": problem.goal.tolist()}
            rows.append({"part": part, "problem": problem.name, "scene": scene, **ends})
    write_rows(folder / "problems.parquet", PROBLEMS, rows, provenance)
    shapes = [row for name, scene in scenes.items() for row in _shape_rows(name, scene)]
    write_rows(folder / "shapes.parquet", SHAPES, shapes, provenance)
    write_json(folder / "robot.json", robot_to_plain(robot))


def read_problems(folder: Path, part: str) -> list[Problem]:
    """The problems of one part, as they were written."""
    robot = robot_from_plain(read_json(folder / "robot.json"), str(folder / "robot.json"))
    shapes: dict[str, list[Shape]] = {}
    for row in read_rows(folder / "shapes.parquet", SHAPES):
        shapes.setdefault(row["scene"], []).append(_shape(row))
    scenes: dict[str, Scene] = {}
    problems = []
    for row in read_rows(folder / "problems.parquet", PROBLEMS):
        if row["part"] != part:
            continue
        name = row["scene"]
        if name not in scenes:
            scenes[name] = make_scene(shapes.get(name, []), name.removeprefix(f"{part}-"))
        start, goal = np.array(row["start"]), np.array(row["goal"])
        problems.append(Problem(row["problem"], robot, scenes[name], start, goal))
    return problems


def robot_to_plain(robot: Robot) -> dict[str, Any]:
    """A robot as plain data: names, limits and the chain's arrays; where it was read from is left out."""
    chain = {name: _array_to_plain(value) for name, value in robot.chain._asdict().items()}
    return {
        "name": robot.name,
        "joints": list(robot.joints),
        "links": list(robot.links),
        "velocity_limit": robot.velocity_limit.tolist(),
        "acceleration_limit": robot.acceleration_limit.tolist(),
        "fixed": dict(robot.fixed),
        "sphere_bound": robot.sphere_bound,
        "chain": chain,
    }


def robot_from_plain(plain: Any, source: str) -> Robot:
    """The robot of plain data. Raises InputError, which names `source`, where something is missing."""
    try:
        chain = Chain(**{name: _array_from_plain(plain["chain"][name]) for name in Chain._fields})
        return Robot(
            name=plain["name"],
            joints=tuple(plain["joints"]),
            links=tuple(plain["links"]),
            velocity_limit=np.array(plain["velocity_limit"]),
            acceleration_limit=np.array(plain["acceleration_limit"]),
            chain=chain,
            fixed=plain["fixed"],
            sphere_bound=plain["sphere_bound"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{source}: no robot as written by stage problems ({error}); run that stage again") from error


def _array_to_plain(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return int(value)
    return {"dtype": str(value.dtype), "shape": list(value.shape), "values": value.ravel().tolist()}


def _array_from_plain(plain: Any) -> Any:
    if isinstance(plain, int):
        return plain
    return np.array(plain["values"], dtype=plain["dtype"]).reshape(plain["shape"])


def _shape_rows(scene: str, content: Scene) -> Iterable[dict[str, Any]]:
    for shape in content.shapes:
        kind = type(shape).__name__.lower()
        numbers = [
            float(number)
            for field in fields(shape)
            if field.name in _SHAPES[kind][1]
            for number in np.ravel(getattr(shape, field.name))
        ]
        yield {"scene": scene, "obstacle": shape.name, "kind": kind, "numbers": numbers}


def _shape(row: Mapping[str, Any]) -> Shape:
    made, sizes = _SHAPES[row["kind"]]
    numbers, values, at = np.array(row["numbers"]), {}, 0
    for name, size in sizes.items():
        count = int(np.prod(size)) if -1 not in size else len(numbers)
        values[name] = float(numbers[at]) if size == () else numbers[at : at + count].reshape(size)
        at += count
    shape: Shape = made(name=row["obstacle"], **values)
    return shape
