"""The planning branch's stages on tiny suites: what they write, the same bytes twice, and what stops them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from predplan.artifacts.mcap import read_joint_states
from predplan.artifacts.tables import read_provenance, read_rows, read_table
from predplan.errors import InputError
from predplan.planning import tables
from predplan.planning.methods import methods_of
from stages import report
from stages.common import SuiteStage
from stages.planning import compare, inspect, plan, problems, tune
from stages.settings import load_settings

REPOSITORY = Path(__file__).resolve().parents[2]
PARAMS = """root: .
params: p.yaml
out: {out}
reports: {out}/reports
workers: {workers}
labelling:
  corpora: {{}}
planning:
  seed: {seed}
  repeats: 2
  suites:
    maze: {{kind: maze, problems: 2, tuning: 1, iterations: 6, epsilon: 0.1, inverse_steps: [10, 20], steps_of: maze}}
    planar: {{kind: planar, problems: 3, tuning: 2, iterations: 3, epsilon: 0.1, inverse_steps: [1, 5],
      steps_of: planar, timings: [8]}}
    again: {{kind: planar, problems: 3, tuning: 1, iterations: 3, epsilon: 0.1, inverse_steps: [1], steps_of: planar}}
"""
SUITES = ("maze", "planar", "again")
STAGES: tuple[Callable[[SuiteStage], None], ...] = (problems.main, tune.main, plan.main, compare.main)
MADE = {
    "problems": tables.PROBLEMS,
    "shapes": tables.SHAPES,
    "steps": tables.STEPS,
    "costs": tables.COSTS,
    "outcomes": tables.OUTCOMES,
    "trajectories": tables.TRAJECTORIES,
    "supports": tables.SUPPORTS,
    "times": tables.TIMES,
}
RESULTS = {
    "curves": tables.CURVES,
    "comparisons": tables.COMPARISONS,
    "example": tables.EXAMPLE,
    "field": tables.FIELD,
    "outcomes": tables.OUTCOMES,
    "times": tables.TIMES,
    "steps": tables.STEPS,
}


def make_stage(folder: Path, suite: str, seed: int = 0, workers: int = 1) -> SuiteStage:
    folder.mkdir(parents=True, exist_ok=True)
    params = folder / "p.yaml"
    params.write_text(PARAMS.format(out=folder, seed=seed, workers=workers), encoding="utf-8")
    settings = load_settings(params)
    return SuiteStage(suite, settings)


def run_suites(folder: Path, **changed: int) -> Path:
    for suite in SUITES:
        for main in STAGES:
            main(make_stage(folder, suite, **changed))
    return folder


def deterministic(folder: Path) -> dict[str, bytes]:
    """All files but those that hold times."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in ("times.parquet", "p.yaml")
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_suites(tmp_path_factory.mktemp("made"))


def rows(made: Path, suite: str, name: str) -> list[dict[str, Any]]:
    return read_rows(made / "planning" / suite / f"{name}.parquet", MADE[name])


@pytest.mark.parametrize("suite", SUITES)
def test_every_table_is_there_with_its_provenance(made: Path, suite: str) -> None:
    for folder, schemas in ((made / "planning" / suite, MADE), (made / "results" / "planning" / suite, RESULTS)):
        for name, schema in schemas.items():
            path = folder / f"{name}.parquet"
            read_table(path, schema)
            assert read_provenance(path).params["suite"] == suite
            if name not in ("problems", "shapes"):
                assert read_provenance(path).upstream


@pytest.mark.parametrize("suite", ["maze", "planar"])
def test_every_method_on_every_problem(made: Path, suite: str) -> None:
    stage = make_stage(made, suite)
    methods = [method.name for method in methods_of(stage.suite.kind)]
    costs = rows(made, suite, "costs")
    assert len(costs) == len(methods) * stage.suite.problems * (stage.suite.iterations + 1)
    assert {row["method"] for row in costs} == set(methods)
    assert [row["method"] for row in rows(made, suite, "outcomes")][:: stage.suite.problems] == methods
    recordings = sorted(path.stem for path in (made / "planning" / suite / "trajectories").iterdir())
    assert recordings == sorted(methods)


def test_steps_are_chosen_once_a_method_and_shared(made: Path) -> None:
    chosen = {row["method"]: row["inverse_step"] for row in rows(made, "maze", "steps") if row["chosen"]}
    own = [method for method in methods_of("maze") if not method.step_of]
    assert set(chosen) == {method.name for method in own}
    used = {row["method"]: row["inverse_step"] for row in rows(made, "maze", "outcomes")}
    assert used["grbf-narrow"] == chosen["grbf-narrow"]
    assert used["waypoints-velocity-large"] == chosen["grbf-narrow"] / 2


def test_a_suite_with_anothers_steps(made: Path) -> None:
    """The same kind has the same problems; only the steps' source differs, so here all is the same."""
    assert rows(made, "again", "steps") == []
    for name in ("problems", "outcomes", "costs"):
        ours, theirs = (
            [row for row in rows(made, suite, name) if row.get("part") != "tuning"] for suite in ("again", "planar")
        )
        assert ours == theirs


def test_recordings_hold_the_trajectories(made: Path) -> None:
    last = [
        row["q"]
        for row in rows(made, "planar", "trajectories")
        if (row["method"], row["problem"], row["iteration"]) == ("grbf", "planar-0", 3)
    ]
    path = made / "planning" / "planar" / "trajectories" / "grbf.mcap"
    states = read_joint_states(path, "/joint_states", "plan")
    assert states.position.tolist() == last


def test_the_same_bytes_again_and_in_two_processes(made: Path, tmp_path: Path) -> None:
    again = run_suites(tmp_path, workers=2)
    first, second = deterministic(made), deterministic(again)
    assert first.keys() == second.keys()
    # Settings that hold paths and workers are no part of what a table was made from.
    assert [name for name in first if first[name] != second[name]] == []


def test_another_seed_other_problems(made: Path, tmp_path: Path) -> None:
    stage = make_stage(tmp_path, "planar", seed=1)
    problems.main(stage)
    assert stage.path("shapes.parquet").read_bytes() != (made / "planning/planar/shapes.parquet").read_bytes()


def test_nothing_half_written(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = make_stage(tmp_path, "planar")
    problems.main(stage)
    tune.main(stage)
    before = deterministic(tmp_path)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(plan, "write_rows", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plan.main(stage)
    left = {name for name in deterministic(tmp_path) if name not in before}
    assert all("/trajectories/" in name and name.endswith(".mcap") for name in left)
    monkeypatch.undo()
    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        problems.main(stage)
    assert {name: content for name, content in deterministic(tmp_path).items() if name in before} == before


def test_missing_inputs_name_the_stage(tmp_path: Path) -> None:
    stage = make_stage(tmp_path, "planar")
    with pytest.raises(InputError, match=r"robot\.json"):
        tune.main(stage)
    problems.main(stage)
    with pytest.raises(InputError, match="dvc repro tune"):
        plan.main(stage)
    with pytest.raises(InputError, match="dvc repro plan"):
        compare.main(stage)


@pytest.mark.parametrize(
    ("found", "put", "said"),
    [
        ("kind: maze", "kind: labyrinth", "planning.suites.maze.kind"),
        ("problems: 2", "problems: 0", "planning.suites.maze.problems"),
        ("epsilon: 0.1", "epsilon: -1", "epsilon"),
        ("inverse_steps: [10, 20]", "inverse_steps: []", "inverse_steps"),
        ("inverse_steps: [10, 20]", "inverse_steps: [0]", "inverse_steps"),
        ("tuning: 1", "tuned: 1", "tuned: unknown key"),
        ("steps_of: maze", "steps_of: nowhere", "steps_of of maze is 'nowhere'"),
        ("repeats: 2", "repeats: 1", "planning.repeats"),
    ],
)
def test_bad_params(tmp_path: Path, found: str, put: str, said: str) -> None:
    params = tmp_path / "p.yaml"
    params.write_text(PARAMS.format(out=tmp_path, seed=0, workers=1).replace(found, put, 1), encoding="utf-8")
    command = [sys.executable, "-m", "stages.planning.tune", str(params), "maze"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_unknown_suite(tmp_path: Path) -> None:
    make_stage(tmp_path, "maze")
    command = [sys.executable, "-m", "stages.planning.problems", str(tmp_path / "p.yaml"), "zoo"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "expected maze, planar, again" in done.stderr


@pytest.mark.parametrize("suite", ["maze", "planar"])
def test_recordings_for_the_viewer(made: Path, suite: str) -> None:
    stage = make_stage(made, suite)
    inspect.main(stage)
    motions, field = sorted(stage.path("recordings").iterdir(), key=lambda path: "field" in path.stem)
    assert field.stem == f"{motions.stem} field"
    assert all(recording.read_bytes().startswith(b"RRF2") for recording in (motions, field))


def test_the_pipeline_declares_what_stages_make(made: Path) -> None:
    stages = YAML(typ="safe").load((REPOSITORY / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    inspect.main(make_stage(made, "planar"))
    declared = set()
    for name in ("problems", "tune", "plan", "compare", "inspect-plans"):
        for out in (*stages[name]["do"].get("outs", ()), *stages[name]["do"].get("metrics", ())):
            declared.add(out.replace("${out}", str(made)).replace("${key}", "planar"))
    assert all(Path(out).exists() for out in declared)
    folders = (made / "planning" / "planar", made / "results" / "planning" / "planar")
    assert declared == {str(path) for folder in folders for path in folder.iterdir()}


def test_the_report(made: Path) -> None:
    stage = make_stage(made, "planar")
    found = report.read_suites(stage.settings)
    assert [suite.name for suite in found] == list(SUITES)
    (made / "results" / "planning" / "maze" / "curves.parquet").rename(made / "hidden")
    with pytest.raises(InputError, match="compare@maze"):
        report.read_suites(stage.settings)
    (made / "hidden").rename(made / "results" / "planning" / "maze" / "curves.parquet")
