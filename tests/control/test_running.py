import re
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import torch

from predplan.artifacts.tables import read_rows
from predplan.artifacts.tensors import read_tensors, write_tensors
from predplan.control.environments import EnvironmentSettings
from predplan.control.kinds import MethodName
from predplan.control.methods import METHODS
from predplan.control.run_files import run_into
from predplan.control.running import KIND, Order, run, steps_to_threshold
from predplan.control.tables import RUNS
from predplan.control.training import Diverged, Progress, Schedule, Training
from predplan.control.trpo import TRPOSettings
from predplan.errors import InputError

UPDATES = 5
LOSSY = EnvironmentSettings("cartpole", noise=0.2, drop=0.1, threads=1)


def order(method: str, task: EnvironmentSettings = LOSSY, seed: int = 0) -> Order:
    return Order(task, method, Schedule(6 * 16 * UPDATES, 6, 16), seed)


def told(progress: list[Progress]) -> list[dict[str, Any]]:
    """What does not depend on the clock, as text, for NaN to equal NaN."""
    return [{name: repr(value) for name, value in asdict(one).items() if name != "cpu_s"} for one in progress]


def never(progress: Progress) -> None:
    raise AssertionError("nothing is left to do")


def test_every_method_has_its_name() -> None:
    assert tuple(METHODS) == get_args(MethodName)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_killed_at_any_update_goes_on_as_if_it_had_not_been(method: str, tmp_path: Path) -> None:
    checkpoint = tmp_path / "checkpoint"
    kept: list[Path] = []

    def keep(progress: Progress) -> None:
        """What a run that is killed in this update leaves behind."""
        if checkpoint.exists():
            kept.append(tmp_path / f"killed-{progress.update}")
            shutil.copy(checkpoint, kept[-1])

    whole = run(order(method), checkpoint, every=1, report=keep)
    assert whole.reason == "finished"
    assert len(whole.progress) == UPDATES
    assert len(kept) == UPDATES - 1
    for left in kept:
        seen: list[Progress] = []
        again = run(order(method), left, every=100, report=seen.append)
        assert told(again.progress) == told(whole.progress)
        assert told(seen) == told(whole.progress[-len(seen) :])
        for name, value in whole.learned.network.state_dict().items():
            assert torch.equal(again.learned.network.state_dict()[name], value), name
        np.testing.assert_array_equal(again.learned.whitening.matrix, whole.learned.whitening.matrix)
        if whole.learned.model is not None:
            assert again.learned.model is not None
            for one, other in zip(again.learned.model.arrays(), whole.learned.model.arrays(), strict=True):
                np.testing.assert_array_equal(one, other)
    done = run(order(method), checkpoint, report=never)
    assert told(done.progress) == told(whole.progress)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of fm2, three updates in."""
    path = tmp_path_factory.mktemp("run") / "checkpoint"

    def kill(progress: Progress) -> None:
        if progress.update == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(order("fm2"), path, every=1, report=kill)
    return path


def test_a_checkpoint_is_written_every_so_often_and_at_the_end(tmp_path: Path) -> None:
    path, found = tmp_path / "folder" / "checkpoint", []

    def look(progress: Progress) -> None:
        found.append(len(read_tensors(path, KIND)[0]["progress.update"]) if path.exists() else 0)

    run(order("fm2"), path, every=2, report=look)
    assert found == [0, 0, 2, 2, 4]
    assert len(read_tensors(path, KIND)[0]["progress.update"]) == UPDATES
    assert list(path.parent.iterdir()) == [path]


def test_damaged_checkpoints_are_named(checkpoint: Path, tmp_path: Path) -> None:
    data, path = checkpoint.read_bytes(), tmp_path / "checkpoint"
    for length in (0, 100, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=f"{path}: damaged"):
            run(order("fm2"), path)
    path.write_bytes(b"\0" * 1000)
    with pytest.raises(InputError, match=f"{path}: damaged"):
        run(order("fm2"), path)


@pytest.mark.parametrize("lost", ["network.log_deviation", "sampler.return", "environments.state", "update.first"])
def test_checkpoints_that_lack_something_are_named(lost: str, checkpoint: Path, tmp_path: Path) -> None:
    arrays, sheet = read_tensors(checkpoint, KIND)
    path = tmp_path / "checkpoint"
    write_tensors(path, {name: one for name, one in arrays.items() if name != lost}, KIND, sheet)
    with pytest.raises(InputError, match=f"{path}: damaged"):
        run(order("fm2"), path)
    for bad in ({}, {"order": sheet["order"]}, {**sheet, "training": {**sheet["training"], "generators": []}}):
        write_tensors(path, arrays, KIND, bad)
        with pytest.raises(InputError, match=f"{path}: "):
            run(order("fm2"), path)


@pytest.mark.parametrize(
    ("other", "name"),
    [
        (order("fm5"), "method"),
        (order("fm2", seed=1), "seed"),
        (order("fm2", replace(LOSSY, noise=0.1)), "task"),
        (order("fm2", replace(LOSSY, task="swimmer")), "task"),
        (replace(order("fm2"), schedule=Schedule(10, 6, 16)), "schedule"),
    ],
)
def test_checkpoints_of_another_order_are_named_and_left(other: Order, name: str, checkpoint: Path) -> None:
    before = checkpoint.read_bytes()
    with pytest.raises(InputError, match=rf"{checkpoint}: {name}: found .*, expected .*; choose another folder"):
        run(other, checkpoint)
    assert checkpoint.read_bytes() == before


def test_a_run_may_go_on_with_other_threads(checkpoint: Path, tmp_path: Path) -> None:
    path = tmp_path / "checkpoint"
    shutil.copy(checkpoint, path)
    found = run(order("fm2", replace(LOSSY, threads=2)), path)
    assert told(found.progress) == told(run(order("fm2")).progress)


def test_a_diverged_run_says_so_and_ends(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    advance = Training.advance

    def diverging(training: Training) -> Progress:
        if training.updates == 2:
            raise Diverged("actor.0.weight is not finite after update 3, 288 steps")
        return advance(training)

    monkeypatch.setattr(Training, "advance", diverging)
    found = run(order("fm2"), tmp_path / "checkpoint", every=1)
    assert found.reason == "diverged: actor.0.weight is not finite after update 3, 288 steps"
    assert len(found.progress) == 2


def test_a_run_whose_numbers_overflow_diverges(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wild = replace(METHODS["fm2-trpo"], update=TRPOSettings(rate=1e20))
    monkeypatch.setitem(METHODS, "fm2-trpo", wild)
    found = run_into(tmp_path, order("fm2-trpo"), every=1)
    assert re.fullmatch(r"diverged: critic\.\d\.weight is not finite after update \d, \d+ steps", found.reason)
    assert 0 < len(found.progress) < UPDATES
    assert all(np.isfinite(one.policy_kl) for one in found.progress)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "checkpoint.safetensors",
        "learning.parquet",
        "runs.parquet",
    ]
    (row,) = read_rows(tmp_path / "runs.parquet", RUNS)
    assert (row["reason"], row["steps"]) == (found.reason, found.progress[-1].steps)


def test_bad_orders_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="method: found 'fm0'"):
        run(order("fm0"), tmp_path / "checkpoint")
    with pytest.raises(InputError, match="steps: found 0, expected at least 1"):
        Schedule(0)
    assert torch.get_num_threads() >= 1


def progress(steps: list[int], returns: list[float]) -> list[Progress]:
    rest = [field for field in Progress.__dataclass_fields__ if field not in ("steps", "return_mean")]
    nothing: dict[str, Any] = dict.fromkeys(rest, 0)
    return [Progress(**nothing, steps=one, return_mean=value) for one, value in zip(steps, returns, strict=True)]


def test_a_threshold_is_reached_when_the_smoothed_return_is() -> None:
    steps = [1000 * one for one in range(1, 11)]
    returns = [10.0, 10.0, 199.0, 199.0, 199.0, 199.0, 199.0, 10.0, 199.0, 199.0]
    assert steps_to_threshold(progress(steps, returns), "cartpole") == 7000
    assert steps_to_threshold(progress(steps, [194.0] * 10), "cartpole") is None
    assert steps_to_threshold(progress(steps[:3], [200.0] * 3), "cartpole") is None
    assert steps_to_threshold(progress(steps[:5], [200.0] * 5), "cartpole") == 5000


def test_no_threshold_is_reached_without_returns_or_where_none_is_set() -> None:
    assert steps_to_threshold([], "cartpole") is None
    assert steps_to_threshold(progress([10, 20], [np.nan, np.nan]), "cartpole") is None
    assert steps_to_threshold(progress([10, 20, 30, 40, 50], [200.0] * 5), "swimmer") is None
    gaps = progress([10, 20, 30, 40, 50, 60], [np.nan, 190.0, np.nan, 210.0, np.nan, np.nan])
    assert steps_to_threshold(gaps, "cartpole") == 50  # 190, 190, 200, 210, 210: 200 in the mean
