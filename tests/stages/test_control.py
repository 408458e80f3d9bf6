"""The control branch's runs on a short CartPole: done ones are kept, interrupted ones go on, seeds can be added."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from predplan.artifacts.mcap import read_steps
from predplan.artifacts.tables import read_rows, write_rows
from predplan.control.run_files import CHECKPOINT, run_name
from predplan.control.running import Order, Run, run
from predplan.control.tables import COMPARISONS, LEARNING, PREDICTION, RUNS, SUMMARY
from predplan.errors import InputError
from stages.common import TaskStage
from stages.control import compare, evaluate, explore, train
from stages.control.ordered import orders
from stages.settings import load_settings

PARAMS = """root: .
params: p.yaml
out: {out}
reports: {out}/reports
workers: 1
labelling: {{corpora: {{}}}}
control:
  every: 1
  episodes: 2
  tasks:
    short: {{task: cartpole, steps: 600, copies: 4, length: 64, methods: [{methods}], conditions: [{{noise: 0.2}}],
      seeds: {seeds}, explored: 5, held_out: 3}}
"""


def make_stage(folder: Path, seeds: int = 1, methods: str = "rpsp, fm2") -> TaskStage:
    folder.mkdir(parents=True, exist_ok=True)
    params = folder / "p.yaml"
    params.write_text(PARAMS.format(out=folder, seeds=seeds, methods=methods), encoding="utf-8")
    settings = load_settings(params)
    return TaskStage("short", settings)


def timeless(stage: TaskStage) -> list[dict[str, Any]]:
    rows = read_rows(stage.path("learning.parquet"), LEARNING)
    return [{name: value for name, value in row.items() if name != "cpu_s"} for row in rows]


def policies(stage: TaskStage) -> dict[str, bytes]:
    folder = stage.path("policies")
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> TaskStage:
    stage = make_stage(tmp_path_factory.mktemp("made"))
    train.main(stage)
    return stage


def test_exploration_is_two_parts(tmp_path: Path) -> None:
    stage = make_stage(tmp_path)
    explore.main(stage)
    counts = [read_steps(stage.path(f"exploration-{part}.mcap")).episode.max() for part in ("training", "held_out")]
    assert counts == [4, 2]


def test_results_are_compared_and_played(made: TaskStage) -> None:
    write_rows(made.path("prediction.parquet"), PREDICTION, [], made.provenance())
    compare.main(made)
    evaluate.main(made)
    assert len(read_rows(made.result("summary.parquet"), SUMMARY)) == 2
    assert [row["verdict"] for row in read_rows(made.result("comparisons.parquet"), COMPARISONS)] == ["too few seeds"]
    assert len(list(made.path("rollouts").glob("*.mcap"))) == 2
    for name in ("metrics.json", "curve.csv", "evaluations.json", "runs.parquet", "learning.parquet"):
        assert made.result(name).exists()


def test_same_seed_same_learning(made: TaskStage, tmp_path: Path) -> None:
    again = make_stage(tmp_path)
    train.main(again)
    assert timeless(again) == timeless(made)
    assert policies(again) == policies(made)


def test_an_interrupted_stage_goes_on(made: TaskStage, tmp_path: Path) -> None:
    stage = make_stage(tmp_path)

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    order = orders(stage)[0]
    with pytest.raises(KeyboardInterrupt):
        run(order, stage.path("runs") / run_name(order) / CHECKPOINT, 1, after(2, interrupt))
    assert (stage.path("runs") / run_name(order) / CHECKPOINT).exists()
    train.main(stage)
    assert timeless(stage) == timeless(made)


def test_seeds_that_are_added_leave_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    train.main(make_stage(tmp_path, seeds=1, methods="fm2"))
    made: list[int] = []

    def noted(order: Order, *rest: Any) -> Run:
        made.append(order.seed)
        return run(order, *rest)

    monkeypatch.setattr("predplan.control.run_files.run", noted)
    stage = make_stage(tmp_path, seeds=2, methods="fm2")
    train.main(stage)
    assert made == [1]
    assert [row["seed"] for row in read_rows(stage.path("runs.parquet"), RUNS)] == [0, 1]


@pytest.mark.parametrize(
    ("found", "put", "said"),
    [
        (
            "methods: [rpsp, fm2]",
            "methods: [rpsp, magic]",
            r"control\.tasks\.short\.methods\.1: found \"magic\", must be",
        ),
        (
            "task: cartpole",
            "task: cartpool",
            r"control\.tasks\.short\.task: found 'cartpool', expected one of MuJoCo's",
        ),
    ],
)
def test_unknown_names_stop_before_any_stage_works(tmp_path: Path, found: str, put: str, said: str) -> None:
    params = tmp_path / "p.yaml"
    text = PARAMS.format(out=tmp_path, seeds=1, methods="rpsp, fm2")
    assert found in text
    params.write_text(text.replace(found, put), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        load_settings(params)


def after(count: int, action: Callable[[object], None]) -> Callable[[object], None]:
    """A report that acts at the count-th call."""
    calls = []

    def report(progress: object) -> None:
        calls.append(progress)
        if len(calls) == count:
            action(progress)

    return report
