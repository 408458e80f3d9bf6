"""predplan control on CartPole: what it writes, what it goes on from, and what stops it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from predplan.artifacts.tables import read_table
from predplan.cli import run
from predplan.control.tables import LEARNING

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
        (["train", "nowhere"], "task: found 'nowhere', expected one of cartpole"),
        (["train", "CartPole-v1"], "task: found 'CartPole-v1', expected one of cartpole"),
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


def test_no_episodes_are_refused(learned: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["control", "evaluate", str(learned), "--episodes", "0"]) == 2
    assert "--episodes is 0" in capsys.readouterr().err
