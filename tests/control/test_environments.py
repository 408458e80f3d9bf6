import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest

from predplan.control.environments import Environments, EnvironmentSettings, Outcome
from predplan.control.tasks import TASKS, Motion, find_task, other_tasks
from predplan.errors import InputError, PredplanError


def gymnasium_copies(identity: str, generator: np.random.Generator, copies: int) -> list[Any]:
    """Gymnasium's environments, each with the generator of our copy of that number."""
    *starts, _ = generator.spawn(copies + 1)
    made: list[Any] = [gymnasium.make(identity).unwrapped for _ in range(copies)]
    for one, start in zip(made, starts, strict=True):
        one.np_random = start
    return made


@pytest.mark.parametrize(("task", "steps"), [("cartpole", 250), ("swimmer", 250), ("hopper", 250), ("walker2d", 200)])
@pytest.mark.parametrize("threads", [1, 2])
def test_copies_equal_gymnasium_step_by_step(task: str, steps: int, threads: int) -> None:
    """Positions, rewards, ends and resets over whole episodes, with the same actions. 1e-9, as solvers start cold."""
    hidden, copies = TASKS[task].hidden, 3
    settings = EnvironmentSettings(task, threads=threads, horizon=150)
    peers = gymnasium_copies(TASKS[task].identity, np.random.default_rng(0), copies)
    actions, ends = np.random.default_rng(1), 0
    with Environments(settings, copies, np.random.default_rng(0)) as environments:
        found = environments.reset().observation
        age = np.zeros(copies, np.int64)
        for row, peer in enumerate(peers):
            np.testing.assert_array_equal(found[row], peer.reset()[0][: len(found[row])])
        for _ in range(steps):
            action = actions.normal(0.0, 0.5, (copies, environments.action_size))
            outcome, age = environments.step(action), age + 1
            for row, peer in enumerate(peers):
                bounds = peer.action_space.high.astype(np.float64)
                observation, reward, terminated, _, _ = peer.step(np.clip(action[row], -1, 1) * bounds)
                positions = observation[: environments.observation_size]
                np.testing.assert_allclose(outcome.observation[row], positions, rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(peer.data.qpos[hidden:], positions)
                assert outcome.reward[row] == pytest.approx(reward, rel=1e-9, abs=1e-9)
                assert outcome.terminated[row] == terminated
                assert outcome.truncated[row] == (age[row] == 150 and not terminated)
            ended = np.flatnonzero(outcome.terminated | outcome.truncated)
            if len(ended):
                ends += len(ended)
                age[ended] = 0
                restarted = environments.reset(ended).observation
                for ended_row, start in zip(ended, restarted, strict=True):
                    np.testing.assert_array_equal(start, peers[ended_row].reset()[0][: len(start)])
    assert ends >= copies


@pytest.mark.parametrize(
    ("task", "name"), [("hopper", "qpos"), ("hopper", "qvel"), ("walker2d", "qpos"), ("cartpole", "qpos")]
)
def test_ends_are_gymnasiums_at_their_bounds(task: str, name: str) -> None:
    """States around every bound, as no random walk finds them."""
    ours = TASKS[task]
    peer: Any = gymnasium.make(ours.identity).unwrapped
    peer.reset(seed=0)
    model, data = peer.model, peer.data
    start = np.concatenate([peer.init_qpos, peer.init_qvel])
    offset = 0 if name == "qpos" else model.nq
    for index in range(model.nq if name == "qpos" else model.nv):
        for value in (-101.0, -99.0, -1.01, -0.21, -0.19, 0.0, 0.69, 0.71, 0.99, 1.99, 2.01, 99.0, 101.0, np.nan):
            state = start.copy()
            state[offset + index] = value
            data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq :]
            position, velocity = state[None, : model.nq], state[None, model.nq :]
            found = ours.terminated(Motion(position, position, velocity, np.zeros((1, model.nu)), 1.0))[0]
            if task == "cartpole":
                expected = not np.isfinite(state).all() or abs(state[1]) > 0.2
            else:
                expected = not peer.is_healthy
            assert found == expected, (index, value)


@pytest.mark.parametrize("identity", ["HalfCheetah-v5", "Reacher-v5", "InvertedDoublePendulum-v5"])
def test_other_tasks_are_stepped_by_gymnasium(identity: str) -> None:
    peers = gymnasium_copies(identity, np.random.default_rng(3), 2)
    actions = np.random.default_rng(4)
    assert identity in other_tasks()
    with warnings.catch_warnings(), Environments(EnvironmentSettings(identity), 2, np.random.default_rng(3)) as ours:
        warnings.simplefilter("ignore")
        ours.reset()
        for peer in peers:
            peer.reset()
        for _ in range(20):
            action = actions.uniform(-1, 1, (2, ours.action_size))
            outcome = ours.step(action)
            for row, peer in enumerate(peers):
                low, high = peer.action_space.low.astype(np.float64), peer.action_space.high.astype(np.float64)
                _, reward, terminated, _, _ = peer.step(low + 0.5 * (action[row] + 1) * (high - low))
                assert outcome.reward[row] == pytest.approx(reward, abs=1e-12)
                assert outcome.terminated[row] == terminated
                np.testing.assert_array_equal(outcome.position[row], peer.data.qpos[-ours.observation_size :])
            if outcome.terminated.any():
                break


def rollout(settings: EnvironmentSettings, seed: int, copies: int = 4, steps: int = 30) -> list[Outcome]:
    actions = np.random.default_rng(9)
    with Environments(settings, copies, np.random.default_rng(seed)) as environments:
        outcomes = [environments.reset()]
        for _ in range(steps):
            outcomes.append(environments.step(actions.normal(size=(copies, environments.action_size))))
    return outcomes


def test_same_seed_same_bytes_with_any_number_of_threads() -> None:
    first, second, other = (
        rollout(EnvironmentSettings("swimmer", 0.2, 0.3, threads=threads), seed)
        for threads, seed in ((1, 0), (2, 0), (1, 1))
    )
    for one, two in zip(first, second, strict=True):
        assert one.observation.tobytes() == two.observation.tobytes()
        assert one.reward.tobytes() == two.reward.tobytes()
    assert first[0].position.tobytes() != other[0].position.tobytes()


def test_noise_has_its_size_and_losses_their_share() -> None:
    outcomes = rollout(EnvironmentSettings("swimmer", 0.3, 0.25), 0, copies=20, steps=200)
    observation = np.array([one.observation for one in outcomes])
    position = np.array([one.position for one in outcomes])
    lost = np.isnan(observation)
    np.testing.assert_array_equal(lost.any(axis=2), lost.all(axis=2))
    assert lost.mean() == pytest.approx(0.25, abs=0.02)
    spread = np.nanstd(observation - position, axis=(0, 1))
    np.testing.assert_allclose(spread, 0.3 * np.array(TASKS["swimmer"].scale), rtol=0.05)
    assert np.isfinite(position).all()


def test_noise_does_not_touch_what_happens() -> None:
    clean, noisy = (rollout(EnvironmentSettings("swimmer", noise, drop), 5) for noise, drop in ((0, 0), (0.2, 0.5)))
    for one, two in zip(clean, noisy, strict=True):
        np.testing.assert_array_equal(one.position, two.position)
        np.testing.assert_array_equal(one.reward, two.reward)


def test_some_copies_are_stepped_and_the_others_wait() -> None:
    actions = np.random.default_rng(2).normal(size=(10, 3, 2))
    with Environments(EnvironmentSettings("swimmer"), 3, np.random.default_rng(0)) as every:
        every.reset()
        together = np.array([every.step(action).position for action in actions])
    with Environments(EnvironmentSettings("swimmer"), 3, np.random.default_rng(0)) as apart:
        apart.reset()
        rows = np.array([2, 0])
        some = np.array([apart.step(action[rows], rows).position for action in actions])
        rest = np.array([apart.step(action[[1]], np.array([1])).position for action in actions])
    np.testing.assert_array_equal(some, together[:, rows])
    np.testing.assert_array_equal(rest, together[:, [1]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"task": "cartpool"},
            "task: found 'cartpool', expected one of MuJoCo's",
        ),
        ({"task": "CartPole-v1"}, "task: found 'CartPole-v1'"),
        ({"task": "cartpole", "noise": -0.1}, "noise: found -0.1"),
        ({"task": "cartpole", "noise": float("nan")}, "noise: found nan"),
        ({"task": "cartpole", "drop": 1.0}, "drop: found 1.0"),
        ({"task": "cartpole", "drop": -0.1}, "drop: found -0.1"),
        ({"task": "cartpole", "horizon": 0}, "horizon: found 0"),
        ({"task": "cartpole", "threads": 0}, "threads: found 0"),
    ],
)
def test_bad_settings_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        EnvironmentSettings(**arguments)


def test_bad_use_is_named() -> None:
    with pytest.raises(InputError, match="copies: found 0"):
        Environments(EnvironmentSettings("cartpole"), 0, np.random.default_rng(0))
    with pytest.raises(InputError, match="scale: found 1 numbers, expected 2"):
        Environments(EnvironmentSettings("cartpole", scale=(1.0,)), 1, np.random.default_rng(0))
    with pytest.raises(InputError, match="scale: none is known for 'Reacher-v5'"):
        Environments(EnvironmentSettings("Reacher-v5", 0.1), 1, np.random.default_rng(0))
    with Environments(EnvironmentSettings("cartpole", horizon=1), 2, np.random.default_rng(0)) as environments:
        with pytest.raises(PredplanError, match="copy 0 is stepped after its episode ended"):
            environments.step(np.zeros((2, 1)))
        environments.reset()
        with pytest.raises(PredplanError, match="not finite, in copy 1"):
            environments.step(np.array([[0.0], [np.nan]]))
        with pytest.raises(PredplanError, match="action: found shape"):
            environments.step(np.zeros(2))
        assert environments.step(np.zeros((2, 1))).truncated.all()
        with pytest.raises(PredplanError, match="after its episode ended"):
            environments.step(np.zeros((2, 1)))


def test_tasks_are_found_by_either_name() -> None:
    assert find_task("hopper") is find_task("Hopper-v5") is TASKS["hopper"]
    assert find_task("Ant-v5") is None
