"""The pages of control: what of rollouts and tables of learning is in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from predplan import inspection
from predplan.artifacts.provenance import Provenance
from predplan.control.environments import EnvironmentSettings
from predplan.control.rollout_files import write_rollouts
from predplan.control.rollouts import Rollouts
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
