from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.sampling import Batch, Sampler, replay
from predplan.control.whitening import Whitening, no_whitening
from tests.control.learners import CARTPOLE, SWIMMER, learned_filter, memory, sampler, seeing_network

LOSSY = replace(CARTPOLE, noise=0.2, drop=0.3)


def whitening(size: int) -> Whitening:
    """Not the identity."""
    generator = np.random.default_rng(8)
    return Whitening(
        0.1 * generator.standard_normal(size), np.eye(size) + 0.1 * generator.standard_normal((size, size))
    )


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY, SWIMMER])
@pytest.mark.parametrize("recurrent", [0, 5])
def test_a_batch_is_what_happened(settings: EnvironmentSettings, recurrent: int) -> None:
    """The same actions in the same environments, and a window and a core stepped beside them."""
    made = sampler(settings, copies=4, recurrent=recurrent)
    network = seeing_network(made.memory.size, made.environments.action_size, recurrent)
    white = whitening(made.memory.size)
    batch, episodes = made.collect(network, white, 40, np.random.default_rng(1))
    returns, ends = [], 0
    with Environments(settings, 4, np.random.default_rng(0)) as environments:
        window = memory(environments, 2)
        window.begin(np.arange(4), environments.reset().observation)
        begins, core, total, age = np.ones(4, np.bool_), network.initial(4), np.zeros(4), np.zeros(4)
        if environments.in_step:
            environments.stagger()
        for t in range(40):
            np.testing.assert_array_equal(batch.begins[t], begins)
            np.testing.assert_array_equal(batch.features[t], window.features())
            with torch.no_grad():
                known, core = network.step(torch.from_numpy(white(window.features()).astype(np.float32)), core)
                np.testing.assert_allclose(batch.mean[t], network.actor(known).numpy(), rtol=1e-5, atol=1e-6)
            outcome = environments.step(batch.action[t])
            np.testing.assert_array_equal(batch.after[t], outcome.observation)
            np.testing.assert_array_equal(batch.reward[t], outcome.reward)
            np.testing.assert_array_equal(batch.terminated[t], outcome.terminated)
            np.testing.assert_array_equal(batch.truncated[t], outcome.truncated)
            window.observe(batch.action[t], outcome.observation)
            for copy in np.flatnonzero(outcome.truncated):
                np.testing.assert_array_equal(batch.cut_features[ends], window.features()[copy])
                torch.testing.assert_close(batch.cut_core[ends], core[copy])
                ends += 1
            total += outcome.reward
            age += 1
            begins = outcome.terminated | outcome.truncated
            rows = np.flatnonzero(begins)
            returns += [total[row] for row in rows if outcome.terminated[row] or age[row] == environments.horizon]
            total[rows] = age[rows] = 0.0
            if len(rows):
                window.begin(rows, environments.reset(rows).observation)
                core[torch.from_numpy(rows)] = 0.0
        np.testing.assert_array_equal(batch.features[40], window.features())
        np.testing.assert_array_equal(batch.begins[40], begins)
    assert ends == len(batch.cut_features) > 0
    assert batch.steps == 160
    np.testing.assert_allclose(episodes.returns, returns)
    whole = lengths(batch) if settings is not SWIMMER else [one for one in lengths(batch) if one == settings.horizon]
    np.testing.assert_array_equal(np.sort(episodes.lengths), np.sort(whole))
    made.environments.close()


def test_copies_that_nothing_but_the_horizon_ends_are_not_in_step() -> None:
    made = sampler(SWIMMER, copies=4)
    network, horizon = seeing_network(made.memory.size, 2), made.environments.horizon
    batch, episodes = made.collect(network, no_whitening(made.memory.size), 3 * horizon, np.random.default_rng(1))
    ended = [np.flatnonzero(copy) for copy in batch.truncated.T]
    assert sorted(int(steps[0]) + 1 for steps in ended) == [horizon // 4, horizon // 2, 3 * horizon // 4, horizon]
    assert all((np.diff(steps) == horizon).all() for steps in ended)
    np.testing.assert_array_equal(episodes.lengths, np.full(len(episodes.lengths), horizon))
    assert len(episodes.lengths) == sum(len(steps) for steps in ended) - 3
    made.environments.close()


def lengths(batch: Batch) -> list[int]:
    """Steps of the episodes that ended, of a batch that begins with beginnings."""
    found = []
    for ended in (batch.terminated | batch.truncated).T:
        found += np.diff(np.concatenate([[-1], np.flatnonzero(ended)])).tolist()
    return found


def test_the_next_batch_goes_on() -> None:
    parts, whole = sampler(LOSSY, recurrent=3), sampler(LOSSY, recurrent=3)
    network = seeing_network(parts.memory.size, 1, 3)
    both = np.random.default_rng(4)
    white = no_whitening(parts.memory.size)
    first, second = (parts.collect(network, white, 17, both) for _ in range(2))
    every, episodes = whole.collect(network, white, 34, np.random.default_rng(4))
    for name in ("features", "begins", "observation"):
        np.testing.assert_array_equal(getattr(first[0], name)[-1], getattr(second[0], name)[0])
        np.testing.assert_array_equal(getattr(every, name)[17:], getattr(second[0], name))
    for name in ("after", "drawn", "mean", "reward", "terminated", "truncated", "error"):
        np.testing.assert_array_equal(getattr(every, name)[17:], getattr(second[0], name))
    np.testing.assert_array_equal(episodes.returns, np.concatenate([first[1].returns, second[1].returns]))
    np.testing.assert_array_equal(episodes.lengths, np.concatenate([first[1].lengths, second[1].lengths]))
    batch = second[0]
    features = torch.from_numpy(batch.features[:-1].astype(np.float32))
    known = network.known(features, batch.begins[:-1], batch.core)
    np.testing.assert_allclose(network.actor(known).detach(), batch.mean, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY, replace(SWIMMER, noise=0.1, drop=0.2)])
@pytest.mark.parametrize("window", [0, 2])
def test_replayed_is_what_another_memory_would_have_told(settings: EnvironmentSettings, window: int) -> None:
    model = learned_filter(settings)
    made = sampler(settings, 4, window, model=model)
    network = seeing_network(made.memory.size, made.environments.action_size)
    batch, _ = made.collect(network, no_whitening(made.memory.size), 40, np.random.default_rng(2))
    told = memory(made.environments, 3)
    blind = replay(told, batch)
    assert np.isnan(blind.error).all()
    assert blind.features.shape[2] == told.size
    back = replay(memory(made.environments, window, model), blind)
    for name in ("features", "cut_features", "error"):
        np.testing.assert_array_equal(getattr(back, name), getattr(batch, name))
    assert len(batch.cut_features) > 0
    seen = np.isfinite(batch.after).all(axis=2)
    assert np.isfinite(batch.error[seen]).all()
    assert np.isnan(batch.error[~seen]).all()
    made.environments.close()


def test_what_is_put_away_goes_on_the_same() -> None:
    model = learned_filter(LOSSY)
    first, second = (sampler(LOSSY, 3, 1, model=model, seed=seed) for seed in (0, 9))
    network = seeing_network(first.memory.size, 1)
    white = no_whitening(first.memory.size)
    first.collect(network, white, 20, np.random.default_rng(0))
    arrays = {name: np.array(one) for name, one in first.arrays().items()}
    second.restore(arrays)
    second.environments.restore({name: np.array(one) for name, one in first.environments.arrays().items()})
    generators = (made.environments.generators() for made in (first, second))
    for own, copied in zip(*generators, strict=True):
        copied.bit_generator.state = own.bit_generator.state
    (one, episodes), (other, others) = (
        made.collect(network, white, 20, np.random.default_rng(1)) for made in (first, second)
    )
    np.testing.assert_array_equal(one.features, other.features)
    np.testing.assert_array_equal(episodes.returns, others.returns)


def test_actions_are_drawn_from_the_policy_and_clipped_for_the_environment() -> None:
    made: Sampler = sampler(replace(SWIMMER, horizon=500), copies=20)
    network = seeing_network(made.memory.size, 2)
    batch, episodes = made.collect(network, no_whitening(made.memory.size), 100, np.random.default_rng(3))
    scaled = (batch.drawn - batch.mean) / np.exp(-0.5)
    assert abs(float(scaled.mean())) < 0.05
    assert float(scaled.std()) == pytest.approx(1.0, abs=0.03)
    assert np.abs(batch.drawn).max() > 1.0
    np.testing.assert_array_equal(batch.action, np.clip(batch.drawn, -1.0, 1.0))
    assert len(episodes.returns) == len(episodes.lengths) == 0  # none has ended whole
    assert batch.cut_features.shape == (batch.truncated.sum(), made.memory.size)
