"""Rollouts against a plain loop, their files, and where bodies and ghosts are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from predplan.artifacts.mcap import read_provenance, read_topics
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import WORLD, Mesh
from predplan.control.acting import Actor
from predplan.control.bodies import (
    body_poses,
    body_solids,
    coordinates,
    ground_height,
    standing_solids,
    task_model,
)
from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.rollout_files import GHOST, ROBOT, read_rollouts, write_rollouts
from predplan.control.rollouts import Rollouts, evaluate, record
from predplan.control.tasks import FloatArray, IntArray
from predplan.errors import InputError


class Held:
    """Acts by chance, remembers and predicts the last observation that was there; counts what it was told."""

    def __init__(self, environments: Environments, predicts: bool = True) -> None:
        self._generator, self._predicts = np.random.default_rng(5), predicts
        self._actions = environments.action_size
        self.state: FloatArray = np.zeros((environments.copies, environments.observation_size))
        self.told = 0

    def reset(self, rows: IntArray, observation: FloatArray) -> None:
        self.state[rows] = np.nan_to_num(observation)

    def act(self, rows: IntArray) -> FloatArray:
        return self._generator.normal(0.0, 0.3, (len(rows), self._actions))

    def observe(self, rows: IntArray, action: FloatArray, observation: FloatArray) -> None:
        assert np.abs(action).max() <= 1.0
        self.told += len(rows)
        self.state[rows] = np.where(np.isfinite(observation), observation, self.state[rows])

    def predict(self, rows: IntArray, action: FloatArray) -> FloatArray:
        return self.state[rows].copy() if self._predicts else np.full_like(self.state[rows], np.nan)


def made_rollouts(task: str, episodes: int = 3, predicts: bool = True, horizon: int | None = 40) -> Rollouts:
    noise = 0.1 if task != "Reacher-v5" else 0.0
    settings = EnvironmentSettings(task, noise=noise, drop=0.2, horizon=horizon, threads=1)
    with Environments(settings, 2, np.random.default_rng(0)) as environments:
        actor: Actor = Held(environments, predicts)
        return record(environments, actor, episodes)


@pytest.mark.parametrize("task", ["cartpole", "swimmer", "hopper", "walker2d", "Reacher-v5"])
def test_what_is_recorded_belongs_together(task: str) -> None:
    found = made_rollouts(task)
    rows, first = found.trajectories, found.trajectories.first
    assert len(rows.lengths) == 3
    assert np.all(rows.lengths <= 41)
    ends = rows.terminated | rows.truncated
    np.testing.assert_array_equal(np.flatnonzero(ends), first[1:] - 1)
    seen = rows.seen
    assert 0 < seen.sum() < len(seen)
    np.testing.assert_array_equal(found.state[seen], rows.observation[seen])
    np.testing.assert_array_equal(found.prediction[1 : first[1]], found.state[: first[1] - 1])
    assert np.isnan(found.prediction[first[:-1]]).all()
    assert not rows.action[first[:-1]].any()
    if task == "Reacher-v5":
        np.testing.assert_array_equal(found.position[seen], rows.observation[seen])
    else:
        assert 0.0 < np.abs(found.position[seen] - rows.observation[seen]).max() < 1.0


def test_recorded_positions_are_gymnasiums() -> None:
    found = made_rollouts("hopper", episodes=1, horizon=None)
    peer = gymnasium.make("Hopper-v5").unwrapped
    model, data = peer.model, peer.data  # type: ignore[attr-defined]
    assert found.configuration.shape[1] == model.nq
    data.qpos[:], data.qvel[:] = found.configuration[0], 0.0
    mujoco.mj_forward(model, data)
    frames = body_poses(model, np.zeros(1), found.configuration[:1])
    np.testing.assert_allclose(frames.translation[0], data.xpos[1:])
    forward = np.diff(found.configuration[:, 0]) / found.step_duration
    effort = 1e-3 * np.sum(found.trajectories.action[1:] ** 2, axis=1)
    alive = ~found.trajectories.terminated[1:]
    np.testing.assert_allclose(found.trajectories.reward[1:], forward + alive - effort)


def test_evaluation_is_what_is_recorded() -> None:
    settings = EnvironmentSettings("cartpole", noise=0.1, threads=1)
    with Environments(settings, 2, np.random.default_rng(0)) as environments:
        found = evaluate(environments, Held(environments), 5)
    with Environments(settings, 2, np.random.default_rng(0)) as environments:
        kept = record(environments, Held(environments), 5)
    np.testing.assert_allclose(found.returns, kept.returns)
    np.testing.assert_array_equal(found.lengths, kept.trajectories.lengths - 1)
    assert found.terminated == kept.trajectories.terminated.sum()
    assert found.mean == pytest.approx(kept.returns.mean())
    assert found.standard_error == pytest.approx(kept.returns.std(ddof=1) / np.sqrt(5))
    errors = (kept.prediction - kept.position) / np.array([0.0645, 0.112])
    assert found.prediction_error == pytest.approx(np.nanmean(errors**2))


def test_nothing_predicted_has_no_error() -> None:
    with Environments(EnvironmentSettings("cartpole"), 1, np.random.default_rng(0)) as environments:
        found = evaluate(environments, Held(environments, predicts=False), 1)
        assert found.prediction_error is None
        assert found.standard_error is None
        with pytest.raises(InputError, match="episodes: found 0"):
            evaluate(environments, Held(environments), 0)


@pytest.mark.parametrize("task", ["cartpole", "swimmer", "Reacher-v5"])
def test_files_give_back_what_was_written(tmp_path: Path, task: str) -> None:
    kept, path = made_rollouts(task), tmp_path / "r.mcap"
    write_rollouts(path, kept, "rpsp", Provenance(seed=3))
    back = read_rollouts(path)
    for name in ("configuration", "state", "prediction", "step_duration", "position"):
        np.testing.assert_array_equal(getattr(back.rollouts, name), getattr(kept, name))
    for name in ("observation", "action", "reward", "terminated", "truncated", "first"):
        np.testing.assert_array_equal(getattr(back.rollouts.trajectories, name), getattr(kept.trajectories, name))
    assert (back.method, len(back.names)) == ("rpsp", kept.position.shape[1])
    assert read_provenance(path).seed == 3
    assert set(read_topics(path)) == {"/joint_states", "/log", "/scene", "/steps", "/tf"}
    first = path.read_bytes()
    write_rollouts(path, kept, "rpsp", Provenance(seed=3))
    assert path.read_bytes() == first


def test_the_ghost_is_where_it_was_expected(tmp_path: Path) -> None:
    kept, path = made_rollouts("swimmer"), tmp_path / "r.mcap"
    hidden = kept.configuration[:, :2]
    perfect = replace(kept, prediction=np.where(np.isfinite(kept.prediction), kept.position, np.nan))
    for rollouts, same in ((perfect, True), (kept, False)):
        write_rollouts(path, rollouts, "rpsp", Provenance())
        frames = read_rollouts(path).frames
        bodies = [name.removeprefix(ROBOT) for name in frames.children if name.startswith(ROBOT)]
        assert list(frames.children) == [f"{ROBOT}{name}" for name in bodies] + [f"{GHOST}{name}" for name in bodies]
        robot, ghost = np.split(frames.quaternion, 2, axis=1)
        assert np.allclose(robot, ghost) == same
        torso = frames.translation[:, [0, len(bodies)]]
        np.testing.assert_allclose(torso[:, 0, :2], hidden, atol=1e-12)
        np.testing.assert_allclose(torso[:, 1, :2], hidden, atol=1e-12)


def test_no_predictions_no_ghost(tmp_path: Path) -> None:
    write_rollouts(tmp_path / "r.mcap", made_rollouts("hopper", predicts=False), "fm2", Provenance())
    found = read_rollouts(tmp_path / "r.mcap")
    assert all(name.startswith(ROBOT) for name in found.frames.children)
    assert all(solid.frame.startswith(ROBOT) or solid.frame == WORLD for solid in found.solids)


def test_another_recording_is_said(tmp_path: Path) -> None:
    from predplan.artifacts.mcap import write_recording
    from predplan.artifacts.recordings import LogLine

    write_recording(tmp_path / "a.mcap", Provenance(), log=[LogLine(0.0, "x")])
    with pytest.raises(InputError, match=r"no rollouts\.json among"):
        read_rollouts(tmp_path / "a.mcap")


@pytest.mark.parametrize("task", ["cartpole", "swimmer", "hopper", "walker2d", "Humanoid-v5", "Reacher-v5"])
def test_solids_cover_the_geoms(task: str) -> None:
    model = task_model(task)
    solids = (*body_solids(model), *standing_solids(model))
    names = {model.body(b).name for b in range(model.nbody)}
    shown = (model.geom_group < 3) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_rgba[:, 3] > 0)
    assert len(solids) == shown.sum()
    assert {solid.frame for solid in solids} <= names | {WORLD}
    assert len(coordinates(model)) == model.nq
    for solid in solids:
        if isinstance(solid, Mesh):
            a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
            volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
            assert volume > 0.0  # closed, and turned outwards


def test_a_capsules_volume() -> None:
    solid = body_solids(task_model("hopper"))[0]
    assert isinstance(solid, Mesh)
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(np.pi * 0.05**2 * (0.4 + 4 / 3 * 0.05), rel=0.03)


def test_a_swollen_capsule_is_no_longer_between_its_ends() -> None:
    model = task_model("hopper")
    [thin, *_], [thick, *_] = body_solids(model), body_solids(model, swell=2.0)
    assert isinstance(thin, Mesh)
    assert isinstance(thick, Mesh)
    np.testing.assert_allclose(np.ptp(thin.vertices, axis=0), [0.1, 0.1, 0.5])
    np.testing.assert_allclose(np.ptp(thick.vertices, axis=0), [0.2, 0.2, 0.6])


def test_what_stands_does_not_move() -> None:
    [rail] = standing_solids(task_model("cartpole"))
    assert (rail.name, rail.frame) == ("rail", WORLD)
    assert not standing_solids(task_model("hopper"))


def test_where_the_ground_is() -> None:
    assert ground_height(task_model("swimmer")) == pytest.approx(-0.1)
    assert ground_height(task_model("cartpole")) is None
