"""Runs as rows: what is missing, what is counted once, and runs that diverged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_rows, write_rows
from predplan.control.environments import EnvironmentSettings
from predplan.control.prediction import PredictionError
from predplan.control.records import learning_rows, prediction_rows, run_row
from predplan.control.running import Order, Run
from predplan.control.tables import LEARNING, PREDICTION, RUNS
from predplan.control.training import Progress, Schedule

RETURNS = (10.0, float("nan"), 30.0, 50.0)


def made_run(returns: tuple[float, ...] = RETURNS, reason: str = "finished", steps: int = 400) -> Run:
    progress = [
        Progress(
            update=k + 1,
            steps=100 * (k + 1),
            episodes=int(np.isfinite(value)),
            return_mean=value,
            return_std=float("nan"),
            length_mean=value,
            prediction_error=float("nan"),
            policy_kl=0.1,
            refit_kl=0.0,
            refitted=False,
            entropy=1.0,
            value_error=0.5,
            skipped=3 * k,
            cpu_s=float(k),
        )
        for k, value in enumerate(returns)
    ]
    order = Order(EnvironmentSettings("cartpole", noise=0.2), "rpsp", Schedule(steps), 7)
    return Run(order, progress, cast(Any, None), reason)


def test_a_row_an_update() -> None:
    rows = learning_rows(made_run())
    assert [row["return_mean"] for row in rows] == [10.0, None, 30.0, 50.0]
    assert [row["skipped"] for row in rows] == [0, 3, 3, 3]
    assert {(row["task"], row["noise"], row["drop"], row["method"], row["seed"]) for row in rows} == {
        ("cartpole", 0.2, 0.0, "rpsp", 7)
    }
    assert all(row["prediction_error"] is None for row in rows)


def test_a_run_in_a_row() -> None:
    row = run_row(made_run())
    assert row["mean_return"] == pytest.approx((10 + 10 + 30 + 50) / 4)
    assert (row["final_return"], row["steps"], row["steps_to_threshold"]) == (50.0, 400, None)


def test_divergence_is_no_advantage() -> None:
    whole, broken = run_row(made_run(steps=400)), run_row(made_run(reason="diverged: not finite", steps=1000))
    assert broken["mean_return"] == pytest.approx((100.0 + 6 * 10.0) / 10)
    assert broken["mean_return"] < whole["mean_return"]
    assert (broken["final_return"], broken["reason"]) == (10.0, "diverged: not finite")


def test_no_episode_ended() -> None:
    row = run_row(made_run((float("nan"),)))
    assert np.isnan(row["mean_return"])
    assert run_row(replace(made_run(), progress=[]))["steps"] == 0


def test_tables_take_the_rows(tmp_path: Path) -> None:
    errors = prediction_rows(EnvironmentSettings("hopper"), 3, [PredictionError("linear", 5, 0.1, 9)])
    assert (errors[0]["predictor"], errors[0]["task"]) == ("linear", "hopper")
    for schema, rows in ((LEARNING, learning_rows(made_run())), (RUNS, [run_row(made_run())]), (PREDICTION, errors)):
        write_rows(tmp_path / "a.parquet", schema, rows, Provenance())
        assert read_rows(tmp_path / "a.parquet", schema) == rows
