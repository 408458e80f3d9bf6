"""`predplan plan`, from files to exit codes; bad input is one line and exit code 2."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from predplan.artifacts.mcap import read_provenance
from predplan.artifacts.provenance import hash_file
from predplan.cli import run
from predplan.cli_plan import plan as plan_command
from predplan.inspection import record
from predplan.planning.plan_files import read_plan
from predplan.planning.planner import METHODS
from tests.planning.models import write

LINK = (
    '<link name="{0}"><collision><origin xyz="{1} 0 0"/><geometry><sphere radius=".05"/></geometry></collision></link>'
)
JOINT = """
  <joint name="{0}" type="{3}"><origin xyz="{4} 0 0"/><parent link="{1}"/><child link="{2}"/><axis xyz="{5}"/>
  <limit lower="-2.5" upper="2.5" velocity="2" effort="1"/></joint>"""
URDF = f"""<robot name="arm"><link name="base"/>
  {LINK.format("upper", 0.4)}{LINK.format("fore", 0.3)}{LINK.format("hand", 0.1)}
  {JOINT.format("shoulder", "base", "upper", "revolute", 0.0, "0 0 1")}
  {JOINT.format("elbow", "upper", "fore", "revolute", 0.4, "0 0 1")}
  {JOINT.format("slide", "fore", "hand", "prismatic", 0.3, "1 0 0")}
</robot>"""
SCENE = """
world:
  collision_objects:
    - {id: post, primitives: [{type: cylinder, dimensions: [1, .05]}], primitive_poses: [{position: [.6, .5, 0]}]}
"""
WALLS = """
world:
  collision_objects:
    - {id: left, primitives: [{type: box, dimensions: [2, .02, 1]}], primitive_poses: [{position: [1.1, .2, 0]}]}
    - {id: right, primitives: [{type: box, dimensions: [2, .02, 1]}], primitive_poses: [{position: [-1.1, .2, 0]}]}
"""


def request_text(start: dict[str, object], goal: dict[str, object]) -> str:
    constraints = "".join(f"\n      - {{joint_name: {joint}, position: {value}}}" for joint, value in goal.items())
    state = f"{{name: [{', '.join(start)}], position: [{', '.join(map(str, start.values()))}]}}"
    return f"start_state:\n  joint_state: {state}\ngoal_constraints:\n  - joint_constraints:{constraints}\n"


START: dict[str, object] = {"shoulder": 0.0, "elbow": 0.2, "slide": 0.3}
GOAL: dict[str, object] = {"shoulder": 1.6, "elbow": 0.2}


@pytest.fixture
def files(tmp_path: Path) -> Path:
    write(tmp_path, "arm.urdf", URDF)
    write(tmp_path, "scene.yaml", SCENE)
    write(tmp_path, "request.yaml", request_text(START, GOAL))
    return tmp_path


def arguments(files: Path, *options: object, **named: object) -> list[str]:
    given: dict[str, object] = {
        "robot": files / "arm.urdf",
        "scene": files / "scene.yaml",
        "request": files / "request.yaml",
        "out": files / "plan.mcap",
        "budget": 20,
        **named,
    }
    return ["plan", *(str(part) for name, value in given.items() for part in (f"--{name}", value)), *map(str, options)]


def fails(capsys: pytest.CaptureFixture[str], files: Path, *options: object, **named: object) -> str:
    """The one line that bad input leaves on stderr; nothing is written."""
    assert run(arguments(files, *options, **named)) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("predplan: ")
    assert said.err.count("\n") == 1
    assert not list(files.glob("*.mcap"))
    return said.err


def test_a_plan_is_found_written_and_told(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (files / "plan.mcap").write_text("an older file")
    assert run(arguments(files)) == 0
    said = capsys.readouterr()
    assert all(
        word in said.out
        for word in ("certified", "cascade", " ms", "duration", "length", "acceleration", "limits used", "plan.mcap")
    )
    found = read_plan(files / "plan.mcap")
    assert found.states.names == ("shoulder", "elbow")
    np.testing.assert_allclose(found.states.position[[0, -1]], [[0.0, 0.2], [1.6, 0.2]], atol=1e-9)
    provenance = read_provenance(files / "plan.mcap")
    assert provenance.upstream == {
        "robot": hash_file(files / "arm.urdf"),
        "scene": hash_file(files / "scene.yaml"),
        "request": hash_file(files / "request.yaml"),
    }
    assert provenance.seed == 0
    assert provenance.params["method"] == "cascade"
    record(files / "plan.mcap", files / "plan.rrd")
    assert (files / "plan.rrd").stat().st_size > 1000


@pytest.mark.parametrize("method", METHODS)
def test_json_says_what_was_found(files: Path, capsys: pytest.CaptureFixture[str], method: str) -> None:
    assert run(arguments(files, "--json", method=method, seed=3)) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert (told["success"], told["certified"], told["reason"], told["method"]) == (True, True, "", method)
    assert 0.0 < told["time_s"] < 20.0
    assert told["scene_time_s"] > 0.0
    assert told["duration_s"] > 1.6 / 2
    assert told["costs"].keys() == {"length_rad", "velocity_cost", "acceleration_cost"}
    assert told["certificate"]["free"]
    assert told["certificate"]["margin_m"] == 0.0
    assert told["certificate"]["configurations"] > 0
    limits = told["limits"]
    assert limits["joints"] == ["shoulder", "elbow"]
    assert (limits["lower"], limits["upper"], limits["velocity"]) == ([-2.5, -2.5], [2.5, 2.5], [2.0, 2.0])
    assert limits["acceleration"] == [10.0, 10.0]
    assert all(0.0 < share <= 1.0 for share in limits["used"].values())
    assert told["attempts"][-1]["outcome"] == "certified"


def test_the_same_seed_writes_the_same_bytes(files: Path) -> None:
    assert run(arguments(files)) == 0
    assert run(arguments(files, out=files / "again.mcap")) == 0
    assert (files / "plan.mcap").read_bytes() == (files / "again.mcap").read_bytes()


def test_joints_the_goal_does_not_name_are_held_where_they_start(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The hand slid out meets a wall that it does not reach when it is in."""
    wall = SCENE.replace("[.6, .5, 0]", "[1.09, .14, 0]")
    write(files, "scene.yaml", wall)
    assert "start is in collision: hand and post" in fails(capsys, files)
    write(files, "request.yaml", request_text(START | {"slide": 0.0}, GOAL))
    assert run(arguments(files)) == 0
    write(files, "request.yaml", request_text(START | {"slide": 0.0}, GOAL | {"slide": 0.1}))
    assert run(arguments(files, "--json")) == 0
    assert json.loads(capsys.readouterr().out.split("plan.mcap\n")[-1])["limits"]["joints"][-1] == "slide"


def test_no_plan_is_a_reason_and_no_file(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A box all around the base: the goal lies on the other side."""
    write(files, "scene.yaml", WALLS)
    write(files, "request.yaml", request_text({"shoulder": -1.57, "elbow": 0.0, "slide": 0.0}, {"shoulder": 1.57}))
    assert run(arguments(files, budget=0.2)) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("predplan: no certified trajectory within 0.2 s: ")
    assert said.err.count("\n") == 1
    assert run(arguments(files, "--json", budget=0.2)) == 1
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert (told["success"], told["certified"], told["duration_s"], told["certificate"]) == (False, False, None, None)
    assert told["reason"].startswith("no certified trajectory")
    assert told["attempts"]
    assert not (files / "plan.mcap").exists()


@pytest.mark.parametrize("text", ["world: {}\n", "world: {collision_objects: []}\n"])
def test_an_empty_scene_is_fine(files: Path, text: str) -> None:
    write(files, "scene.yaml", text)
    assert run(arguments(files)) == 0


BAD_FILES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "start in collision": ("scene.yaml", SCENE.replace("[.6, .5, 0]", "[.7, 0, 0]"), ("start", "post", "fore")),
    "goal in collision": ("scene.yaml", SCENE.replace("[.6, .5, 0]", "[-.17, 1.08, 0]"), ("goal", "post", "hand")),
    "outside limits": ("request.yaml", request_text(START, GOAL | {"elbow": 2.6}), ("goal", "elbow", "2.6", "2.5")),
    "start outside limits": ("request.yaml", request_text(START | {"elbow": -9}, GOAL), ("start", "elbow", "-9")),
    "no such joint": ("request.yaml", request_text(START, GOAL | {"wrist": 0}), ("wrist", "shoulder")),
    "no such joint at the start": ("request.yaml", request_text(START | {"wrist": 0}, GOAL), ("wrist", "shoulder")),
    "no start of a joint": ("request.yaml", request_text({"shoulder": 0}, GOAL), ("start", "elbow")),
    "not a number": ("request.yaml", request_text(START, GOAL | {"elbow": ".nan"}), ("elbow", "nan", "request.yaml")),
    "infinite": ("request.yaml", request_text(START | {"elbow": ".inf"}, GOAL), ("elbow", "inf", "request.yaml")),
    "no goal": ("request.yaml", request_text(START, GOAL).split("goal")[0], ("request.yaml", "goal_constraints")),
    "size not a number": ("scene.yaml", SCENE.replace(".05]", ".nan]"), ("post", "dimensions", "scene.yaml")),
    "size below zero": ("scene.yaml", SCENE.replace(".05]", "-.05]"), ("post", "dimensions")),
    "not YAML": ("scene.yaml", "world: [", ("scene.yaml:", "not YAML")),
    "request not YAML": ("request.yaml", "{a: b", ("request.yaml:", "not YAML")),
    "not XML": ("arm.urdf", URDF[:-9], ("arm.urdf",)),
    "empty robot": ("arm.urdf", "", ("arm.urdf",)),
    "missing mesh": (
        "arm.urdf",
        URDF.replace('<sphere radius=".05"/>', '<mesh filename="meshes/none.stl"/>', 1),
        ("none.stl",),
    ),
}


@pytest.mark.parametrize("fault", BAD_FILES)
def test_bad_files_are_named(files: Path, capsys: pytest.CaptureFixture[str], fault: str) -> None:
    name, text, words = BAD_FILES[fault]
    write(files, name, text)
    line = fails(capsys, files)
    assert [word for word in words if word not in line] == []


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({"budget": 0}, "--budget is 0"),
        ({"budget": -1}, "--budget is -1"),
        ({"budget": "nan"}, "--budget is nan"),
        ({"budget": "inf"}, "--budget is inf"),
        ({"budget": "soon"}, "soon"),
        ({"method": "magic"}, "magic"),
        ({"seed": -1}, "--seed is -1"),
        ({"acceleration-limit": -1}, "-1"),
        ({"robot": "nowhere.urdf"}, "nowhere.urdf: no such file"),
        ({"scene": "nowhere.yaml"}, "nowhere.yaml: no such file"),
        ({"request": "nowhere.yaml"}, "nowhere.yaml: no such file"),
        ({"cylinders-as": "cone"}, "cone"),
    ],
)
def test_bad_options_are_named(
    files: Path, capsys: pytest.CaptureFixture[str], named: dict[str, object], words: str
) -> None:
    assert words in fails(capsys, files, **named)


def test_what_is_read_is_not_written_over(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "which is read" in fails(capsys, files, out=files / "scene.yaml")
    assert (files / "scene.yaml").read_text() == SCENE
    assert "is a folder" in fails(capsys, files, out=files)


def test_a_missing_package_is_named(
    files: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "predplan.planning.plan_files", None)
    assert "predplan[planning]" in fails(capsys, files)


def test_methods_offered_are_those_there_are() -> None:
    hints = get_type_hints(plan_command)
    assert get_args(hints["method"]) == METHODS


def test_nothing_is_imported_that_is_not_needed(files: Path) -> None:
    code = (
        "import sys; from predplan.cli import run; code = run(sys.argv[1:])\n"
        "slow = ['matplotlib', 'pandas', 'scipy.stats', 'scipy.spatial', 'mujoco', 'rerun', 'pyarrow', 'toppra']\n"
        "print([name for name in slow if name in sys.modules]); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments(files)], capture_output=True, text=True, timeout=300, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
