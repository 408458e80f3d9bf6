from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from predplan.artifacts.mcap import read_steps, write_recording
from predplan.artifacts.provenance import Provenance
from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.exploration import Exploration, ExplorationSettings, degraded, explore, measure_scale
from predplan.control.tasks import TASKS
from predplan.control.trajectories import Trajectories, from_steps, join, to_steps
from predplan.errors import InputError


def exploration(task: str, seed: int = 0, count: int = 6, least: int = 1, copies: int = 5) -> Exploration:
    root = np.random.default_rng(seed)
    with Environments(EnvironmentSettings(task, threads=1), copies, root) as environments:
        return explore(environments, ExplorationSettings(count, least), root)


def same(first: Trajectories, second: Trajectories) -> None:
    for field in fields(Trajectories):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name), err_msg=field.name)


def test_trajectories_are_as_long_as_wanted_and_all_steps_are_counted() -> None:
    found = exploration("hopper", least=22)
    trajectories = found.trajectories
    assert len(trajectories.lengths) == 6
    assert (trajectories.lengths >= 23).all()  # 22 steps and the reset
    assert found.steps > (trajectories.lengths - 1).sum()
    assert (np.abs(trajectories.action) <= 1.0).all()
    np.testing.assert_array_equal(trajectories.action[trajectories.first[:-1]], 0.0)
    np.testing.assert_array_equal(np.flatnonzero(trajectories.terminated), trajectories.first[1:] - 1)
    assert not trajectories.truncated.any()
    interior = np.abs(trajectories.action[trajectories.age > 0])
    assert (interior == 1.0).mean() == pytest.approx(0.317, abs=0.06)  # clipped share of N(0, 1)


def test_actions_led_to_their_observations() -> None:
    """Replaying a trajectory's actions gives its observations: row t holds a_t and o_t."""
    found = exploration("swimmer", count=2, copies=2).trajectories
    with Environments(EnvironmentSettings("swimmer"), 2, np.random.default_rng(0)) as environments:
        start = environments.reset().position
        np.testing.assert_array_equal(start, found.observation[found.first[:-1]])
        for step in range(1, 20):
            outcome = environments.step(found.action[found.first[:-1] + step])
            np.testing.assert_array_equal(outcome.position, found.observation[found.first[:-1] + step])
            np.testing.assert_array_equal(outcome.reward, found.reward[found.first[:-1] + step])


def test_same_seed_same_trajectories() -> None:
    same(exploration("cartpole", 3).trajectories, exploration("cartpole", 3).trajectories)


def test_recordings_are_read_back(tmp_path: Path) -> None:
    found = exploration("cartpole").trajectories
    found = degraded(found, 0.2, 0.3, np.array(TASKS["cartpole"].scale), np.random.default_rng(0))
    path, step = tmp_path / "exploration.mcap", 0.04
    write_recording(path, Provenance(), steps=to_steps(found, step))
    steps = read_steps(path)
    same(from_steps(steps), found)
    assert not found.seen.all()
    # A step of the recording pairs an observation with the action done upon it.
    np.testing.assert_array_equal(steps.action[found.first[0]], found.action[found.first[0] + 1])
    assert steps.reward[found.first[1] - 1] == 0.0


def test_trajectories_are_taken_and_joined() -> None:
    found = exploration("cartpole").trajectories
    parts = [found.take(np.array([0, 1])), found.take(np.array([2, 3, 4, 5]))]
    same(join(parts), found)
    same(found.take(np.array([4])).take(np.array([0])), found.take(np.array([4])))


def test_noise_is_added_as_if_it_had_been_there() -> None:
    found = exploration("swimmer").trajectories
    scale = np.array(TASKS["swimmer"].scale)
    noisy = degraded(found, 0.2, 0.25, scale, np.random.default_rng(1))
    assert noisy.seen.mean() == pytest.approx(0.75, abs=0.03)
    spread = np.std(noisy.observation[noisy.seen] - found.observation[noisy.seen], axis=0)
    np.testing.assert_allclose(spread, 0.2 * scale, rtol=0.05)
    same(degraded(found, 0.0, 0.0, scale, np.random.default_rng(1)), found)
    with pytest.raises(InputError, match="noise: found -1"):
        degraded(found, -1.0, 0.0, scale, np.random.default_rng(1))


def test_the_scale_of_noise_is_what_was_measured() -> None:
    measured = measure_scale("hopper", np.random.default_rng(0))
    np.testing.assert_allclose(measured, TASKS["hopper"].scale, rtol=5e-3)


def test_what_cannot_be_explored_is_said() -> None:
    with pytest.raises(InputError, match="least_length: found 300, expected at most the horizon, 200"):
        exploration("cartpole", least=300)
    with pytest.raises(InputError, match="trajectories: found 0"):
        ExplorationSettings(0)
    with pytest.raises(InputError, match="least_length: found 0"):
        ExplorationSettings(1, 0)


def test_broken_trajectories_are_refused() -> None:
    found = exploration("cartpole").trajectories
    steps = to_steps(found, 0.04)
    with pytest.raises(InputError, match="episodes one after the other"):
        from_steps(replace(steps, episode=steps.episode[::-1].copy()))
    with pytest.raises(InputError, match="first: expected to rise"):
        replace(found, first=np.array([0, 3]))
    with pytest.raises(InputError, match="action: found 1 rows"):
        replace(found, action=found.action[:1])
