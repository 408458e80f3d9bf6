"""predplan control on CartPole: what it writes, what it goes on from, and what stops it."""

from __future__ import annotations

import io
import json
import re
import sys
from pathlib import Path

import pytest

from predplan.artifacts.tables import read_table
from predplan.cli import run
from predplan.control.tables import LEARNING, RUNS
from predplan.control.training import Diverged, Progress, Training

STEPS = "2100"


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("learned") / "run"
    assert run(["control", "train", "cartpole", "--out", str(folder), "--steps", STEPS]) == 0
    return folder


def test_a_policy_is_written_and_evaluated(learned: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert read_table(learned / "learning.parquet", LEARNING).num_rows == 2
    save = tmp_path / "rollout.mcap"
    arguments = ["control", "evaluate", str(learned), "--episodes", "3", "--drop", "0.1", "--json"]
    assert run([*arguments, "--save", str(save)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["episodes"], found["drop"], found["method"]) == (3, 0.1, "rpsp")
    assert found["return_standard_error"] is not None
    assert save.exists()


def test_the_same_order_again_is_done_and_another_is_refused(learned: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (learned / "network.safetensors").read_bytes()
    assert run(["control", "train", "cartpole", "--out", str(learned), "--steps", STEPS]) == 0
    assert (learned / "network.safetensors").read_bytes() == before
    assert run(["control", "train", "cartpole", "--out", str(learned), "--steps", STEPS, "--noise", "0.1"]) == 2
    assert "choose another folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["train", "nowhere"],
            "task: found 'nowhere', expected one of MuJoCo's",
        ),
        (
            ["train", "CartPole-v1"],
            "task: found 'CartPole-v1', expected one of MuJoCo's",
        ),
        (["train", "cartpole", "--method", "magic"], "method: found 'magic', expected one of rpsp"),
        (["train", "cartpole", "--steps", "0"], "steps: found 0"),
        (["train", "cartpole", "--seed", "-1"], "--seed is -1"),
        (["train", "cartpole", "--noise", "-0.1"], "noise: found -0.1"),
        (["train", "cartpole", "--drop", "1"], "drop: found 1.0"),
        (["train", "Reacher-v5", "--noise", "0.1"], "scale: none is known for 'Reacher-v5'"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(["control", *arguments, "--out", str(tmp_path / "run")]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", ["policy.json", "network.safetensors", "checkpoint.safetensors"])
def test_damage_is_named(name: str, learned: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    folder.mkdir()
    for file in learned.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / name).write_bytes((learned / name).read_bytes()[:-20])
    again = ["train", "cartpole", "--out", str(folder), "--steps", STEPS]
    command = again if name == "checkpoint.safetensors" else ["evaluate", str(folder)]
    assert run(["control", *command]) == 2
    assert name in capsys.readouterr().err


def stop_in_update(update: int, error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """Training goes so far, and no further."""
    advance = Training.advance

    def advance_or_stop(training: Training) -> Progress:
        if training.updates + 1 == update:
            raise error
        return advance(training)

    monkeypatch.setattr(Training, "advance", advance_or_stop)


def interrupted(command: list[str]) -> object:
    """The exit code: cyclopts leaves with it."""
    try:
        return run(command)
    except SystemExit as left:
        return left.code


@pytest.mark.parametrize("update", [1, 3])
def test_an_interrupted_run_says_how_it_goes_on_and_does(
    update: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    whole, left = tmp_path / "whole", tmp_path / "left"
    command = ["control", "train", "cartpole", "--steps", "6000", "--method", "fm2", "--out"]
    with monkeypatch.context() as patched:
        stop_in_update(update, KeyboardInterrupt(), patched)
        assert interrupted([*command, str(left)]) == 130
    told = "nothing was learned yet" if update == 1 else "the same command goes on where it was"
    assert capsys.readouterr().err == f"predplan: interrupted; {told}\n"
    assert [path.name for path in tmp_path.rglob("*.*")] == ([] if update == 1 else ["checkpoint.safetensors"])
    seen: list[int] = []
    advance = Training.advance

    def count(training: Training) -> Progress:
        seen.append(training.updates + 1)
        return advance(training)

    monkeypatch.setattr(Training, "advance", count)
    assert run([*command, str(left)]) == 0
    assert seen == list(range(update, 4))
    assert run([*command, str(whole)]) == 0
    for name in ("network.safetensors", "policy.json"):
        assert (left / name).read_bytes() == (whole / name).read_bytes()


@pytest.mark.parametrize("update", [1, 3])
def test_a_diverged_run_is_told_of_and_leaves_its_curve(
    update: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    stop_in_update(update, Diverged("actor.0.weight is not finite"), monkeypatch)
    command = ["control", "train", "cartpole", "--steps", "8000", "--method", "fm2", "--out", str(tmp_path / "run")]
    curve = tmp_path / "run" / "learning.parquet"
    for _ in range(2):  # the same command again comes to the same end
        assert run(command) == 1
        assert capsys.readouterr().err == (
            "predplan: diverged: actor.0.weight is not finite; no policy is written;"
            f" the curve of the {2048 * (update - 1)} steps before is {curve}\n"
        )
    assert read_table(curve, LEARNING).num_rows == update - 1
    assert read_table(tmp_path / "run" / "runs.parquet", RUNS)["reason"].to_pylist() == [
        "diverged: actor.0.weight is not finite"
    ]
    assert not (tmp_path / "run" / "policy.json").exists()


def test_progress_is_shown_on_a_terminal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    told = Terminal()
    command = ["control", "train", "cartpole", "--steps", "6000", "--out", str(tmp_path / "run")]
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", told)
        patched.setenv("COLUMNS", "120")
        patched.setenv("TERM", "xterm")
        stop_in_update(3, KeyboardInterrupt(), patched)
        assert interrupted(command) == 130
    shown = told.getvalue()
    assert "exploring" in shown
    assert "4096/6000" in shown
    assert re.search(r"return [\d.]+, prediction error [\d.]+", shown)
    assert shown.endswith("predplan: interrupted; the same command goes on where it was\n")
    again = Terminal()
    monkeypatch.setattr(sys, "stderr", again)
    assert run(command) == 0
    assert "going on" in again.getvalue()


class Terminal(io.StringIO):
    """Takes what is written to a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_folder_that_cannot_be_made_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert run(["control", "train", "cartpole", "--out", str(tmp_path / "file" / "run")]) == 2
    assert capsys.readouterr().err == f"predplan: {tmp_path / 'file'} is a file; expected a folder to write to\n"


def test_no_episodes_are_refused(learned: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["control", "evaluate", str(learned), "--episodes", "0"]) == 2
    assert "--episodes is 0" in capsys.readouterr().err
