"""The pages of control: what of rollouts and tables of learning is in a recording."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from predplan import inspection
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import TableSchema, write_rows
from predplan.control.environments import EnvironmentSettings
from predplan.control.rollout_files import write_rollouts
from predplan.control.rollouts import Rollouts
from predplan.control.tables import LEARNING, PREDICTION, RUNS
from predplan.control.trajectories import Trajectories
from tests.inspection.test_planning import read_back

LENGTH = 30


def made_rollouts(task: str = "hopper", speed: float = 2.0, states: int = 3, noise: float = 0.1) -> Rollouts:
    """Two episodes of a robot that sways and travels; every fifth observation is lost, every prediction .01 off."""
    size, hidden = {"hopper": (6, 1), "cartpole": (2, 0)}[task]
    rng, n = np.random.default_rng(0), 2 * LENGTH
    age = np.tile(np.arange(LENGTH), 2)
    configuration = 0.1 * np.sin(age[:, None] / 5.0 + np.arange(size))
    if hidden:
        configuration[:, 0], configuration[:, 1] = speed * age / 10.0, 1.2
    position = configuration[:, hidden:]
    observation = position + noise * 0.1 * rng.normal(size=position.shape)
    if noise:
        observation[::5] = np.nan
    prediction = np.where(age[:, None] > 0, position + 0.01, np.nan)
    ends = np.zeros(n, np.bool_)
    ends[[LENGTH - 1, n - 1]] = True
    rows = Trajectories(
        observation,
        np.where(age[:, None] > 0, 0.5, 0.0) * np.ones((n, 3 if hidden else 1)),
        np.where(age > 0, 1.0, 0.0),
        ends & (np.arange(n) < LENGTH),
        ends & (np.arange(n) >= LENGTH),
        np.array([0, LENGTH, n]),
    )
    settings = EnvironmentSettings(task, noise, 0.2 if noise else 0.0)
    return Rollouts(settings, rows, configuration, rng.normal(size=(n, states)), prediction, 0.05)


def recorded(folder: Path, rollouts: Rollouts) -> dict[str, dict[str, list[Any]]]:
    write_rollouts(folder / "r.mcap", rollouts, "rpsp", Provenance({"method": "rpsp"}, seed=1))
    inspection.record(folder / "r.mcap", folder / "r.rrd")
    return read_back(folder / "r.rrd")


def test_rollouts_show_robot_ghost_and_curves(tmp_path: Path) -> None:
    rollouts = made_rollouts()
    found = recorded(tmp_path, rollouts)
    for body in ("robot\\/torso", "predicted\\/foot"):
        assert len(found[f"/world/{body}"]["Transform3D:translation"]) == 2 * LENGTH
    seen = rollouts.trajectories.seen
    assert len(found["/observed/rootz/true"]["Scalars:scalars"]) == 2 * LENGTH
    observed = np.array(found["/observed/thigh_joint/observed"]["Scalars:scalars"])[:, 0]
    np.testing.assert_allclose(observed, rollouts.trajectories.observation[seen, 2])
    predicted = np.array(found["/observed/thigh_joint/predicted"]["Scalars:scalars"])[:, 0]
    assert len(predicted) == 2 * (LENGTH - 1)
    assert len(found["/observed/thigh_joint/lost"]["Scalars:scalars"]) == (~seen).sum() - 2
    assert np.shape(found["/state"]["Scalars:scalars"]) == (2 * LENGTH, 3)
    gained = np.array(found["/gained"]["Scalars:scalars"])[:, 0]
    assert (gained[LENGTH - 1], gained[LENGTH], gained[-1]) == (LENGTH - 1, 0.0, LENGTH - 1)
    text = found["/about"]["TextDocument:text"][0][0]
    assert "| 0.00 | 29.0 | 29 | fell |" in text
    assert "| 1.50 | 29.0 | 29 | cut off |" in text
    [blueprint] = RrdReader(tmp_path / "r.rrd").blueprints()
    assert blueprint.application_id == "predplan_rollouts"


def test_a_camera_follows_who_goes_far(tmp_path: Path) -> None:
    way = recorded(tmp_path, made_rollouts())["/world/followed"]["Transform3D:translation"]
    x = np.array(way)[:, 0, 0]
    np.testing.assert_allclose(np.diff(x[:LENGTH]), 0.2, atol=0.02)
    assert x[LENGTH] == pytest.approx(x[0], abs=0.05)
    assert "/world/followed" not in recorded(tmp_path, made_rollouts(speed=0.0))


def test_what_is_seen_as_it_is_has_no_points(tmp_path: Path) -> None:
    found = recorded(tmp_path, made_rollouts("cartpole", states=0, noise=0.0))
    assert "/observed/slider/observed" not in found
    assert "/observed/slider/lost" not in found
    assert "/state" not in found
    assert any(path.startswith("/world/rail/") for path in found)


def made_learning(methods: tuple[str, ...] = ("rpsp", "fm2", "new"), seeds: int = 3) -> list[dict[str, Any]]:
    """Runs of two conditions that rise to a level of the method; the last run of the last method stops half-way."""
    rng, rows = np.random.default_rng(0), []
    for noise, (level, method), seed in itertools.product((0.0, 0.2), enumerate(methods), range(seeds)):
        stops = method == methods[-1] and seed == seeds - 1
        for update in range(11 if stops else 21):
            known = update != 7
            rows.append(
                {"task": "cartpole", "noise": noise, "drop": 0.0, "method": method, "seed": seed, "update": update}
                | {"steps": 2000 * (update + 1), "episodes": 10 if known else 0, "skipped": 0, "cpu_s": 0.5 * update}
                | {
                    "return_mean": 8.0 + (150.0 - 40.0 * level) * (1 - np.exp(-update / 5)) + rng.normal()
                    if known
                    else None
                }
                | {"return_std": 1.0, "length_mean": 20.0, "policy_kl": 0.01, "entropy": 1.4, "value_error": 0.3}
                | {"prediction_error": 0.01 * rng.uniform(0.5, 1.0) if method == "rpsp" else None}
            )
    return rows


def made_runs() -> list[dict[str, Any]]:
    rng = np.random.default_rng(1)
    return [
        {"task": "cartpole", "noise": noise, "drop": 0.0, "method": method, "seed": seed, "steps": 42_000}
        | {"mean_return": level + 5 * rng.normal(), "final_return": 1.5 * level, "steps_to_threshold": None}
        | {"reason": "finished", "cpu_s": 12.0}
        for noise, (method, level), seed in itertools.product(
            (0.0, 0.2), (("rpsp", 120.0), ("fm2", 90.0), ("new", 60.0)), range(3)
        )
    ]


def made_prediction() -> list[dict[str, Any]]:
    rng = np.random.default_rng(2)
    return [
        {"task": "cartpole", "noise": noise, "drop": 0.0, "seed": seed, "predictor": name, "steps": ahead, "rows": 900}
        | {"error": ahead * level * rng.uniform(0.9, 1.1)}
        for noise, (name, level), seed, ahead in itertools.product(
            (0.0, 0.2), (("last", 0.05), ("order 2", 0.001), ("rpsp", 0.0005)), range(2), (1, 5)
        )
    ]


@pytest.mark.parametrize(
    ("schema", "rows", "pictures", "said"),
    [
        (LEARNING, made_learning(), {"/return_mean", "/prediction_error", "/policy_kl", "/cpu_s"}, "18 runs"),
        (RUNS, made_runs(), {"/runs"}, "cartpole, σ = 0"),
        (PREDICTION, made_prediction(), {"/errors", "/ahead"}, "a perfect sensor"),
    ],
)
def test_tables_have_pages(
    tmp_path: Path, schema: TableSchema, rows: list[dict[str, Any]], pictures: set[str], said: str
) -> None:
    write_rows(tmp_path / "made.parquet", schema, rows, Provenance(seed=1))
    inspection.record(tmp_path / "made.parquet", tmp_path / "made.rrd")
    found = read_back(tmp_path / "made.rrd")
    for path in pictures:
        assert found[path]["EncodedImage:blob"]
    assert said in found["/about"]["TextDocument:text"][0][0]


def test_an_empty_table_is_said(tmp_path: Path) -> None:
    write_rows(tmp_path / "made.parquet", LEARNING, [], Provenance())
    inspection.record(tmp_path / "made.parquet", tmp_path / "made.rrd")
    assert "no rows" in read_back(tmp_path / "made.rrd")["/rows"]["TextDocument:text"][0][0]
