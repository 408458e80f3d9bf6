from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.advantages import AdvantageSettings, estimate, prepare, whitened
from predplan.control.learner import Learner
from predplan.control.networks import log_probability
from predplan.control.sampling import Batch
from tests.control.learners import CARTPOLE, collect, sampler, seeing_network


def batch_of(recurrent: int, horizon: int = 7) -> tuple[Batch, Learner]:
    """The second batch of a sampler: some episodes were running before, some are running after."""
    made = sampler(replace(CARTPOLE, horizon=horizon), 5, 2, recurrent)
    network = seeing_network(made.memory.size, 1, recurrent)
    network.rescale_values(5.0, 3.0)
    collect(made, network, 7)
    batch, learner = collect(made, network, 30)
    assert batch.truncated.any()
    assert batch.terminated.any()
    assert not batch.begins[[0, -1]].all()
    return batch, learner


def brute_force(batch: Batch, learner: Learner, discount: float, trace: float) -> tuple[np.ndarray, np.ndarray]:
    """Advantages as sums over the rest of each episode, and values, the core stepped row by row."""
    network, (length, n) = learner.network, batch.reward.shape
    values, after = np.empty((length + 1, n)), np.zeros((length, n))
    state, cuts = batch.core, 0
    with torch.no_grad():
        for t in range(length + 1):
            state = torch.where(torch.from_numpy(batch.begins[t])[:, None], 0.0, state)
            known, state = network.step(whitened(batch.features[t], learner.whitening), state)
            values[t] = network.values(known)
            for copy in range(n):
                if t < length and batch.truncated[t, copy]:
                    last = whitened(batch.cut_features[[cuts]], learner.whitening)
                    after[t, copy] = network.values(network.step(last, state[[copy]])[0])
                    cuts += 1
    ended = batch.terminated | batch.truncated
    for t in range(length):
        after[t] = np.where(ended[t], after[t], values[t + 1])
    advantage = np.zeros((length, n))
    for copy in range(n):
        for t in range(length):
            weight = 1.0
            for later in range(t, length):
                change = batch.reward[later, copy] + discount * after[later, copy] - values[later, copy]
                advantage[t, copy] += weight * change
                weight *= discount * trace
                if ended[later, copy]:
                    break
    return advantage, values[:-1]


@pytest.mark.parametrize("recurrent", [0, 6])
@pytest.mark.parametrize(("discount", "trace"), [(0.99, 0.95), (0.9, 1.0), (0.95, 0.0)])
def test_advantages_are_the_sums_that_they_stand_for(recurrent: int, discount: float, trace: float) -> None:
    batch, learner = batch_of(recurrent)
    settings = AdvantageSettings(discount, trace)
    advantage, target, value = estimate(batch, learner.network, learner.whitening, settings)
    expected, values = brute_force(batch, learner, discount, trace)
    np.testing.assert_allclose(value, values, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(advantage, expected, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(target, expected + values, rtol=1e-4, atol=1e-4)


def test_a_fallen_pole_is_worth_nothing_more_and_a_cut_episode_goes_on() -> None:
    batch, learner = batch_of(0)
    settings = AdvantageSettings(0.9, 0.0)
    _, target, _ = estimate(batch, learner.network, learner.whitening, settings)
    np.testing.assert_allclose(target[batch.terminated], batch.reward[batch.terminated], atol=1e-6)
    last = whitened(batch.cut_features, learner.whitening)
    worth = learner.network.values(last).detach().numpy()
    np.testing.assert_allclose(target[batch.truncated], batch.reward[batch.truncated] + 0.9 * worth, rtol=1e-5)


@pytest.mark.parametrize("recurrent", [0, 6])
def test_a_lesson_is_the_batch_in_the_networks_units(recurrent: int) -> None:
    batch, learner = batch_of(recurrent)
    network = learner.network
    advantage, target, value = estimate(batch, network, learner.whitening, AdvantageSettings())
    lesson = prepare(batch, network, learner.whitening, AdvantageSettings())
    assert float(lesson.advantage.mean()) == pytest.approx(0.0, abs=1e-6)
    assert float(lesson.advantage.std()) == pytest.approx(1.0, abs=0.01)
    assert np.corrcoef(advantage.ravel(), lesson.advantage.ravel())[0, 1] == pytest.approx(1.0)
    mean, deviation = (float(one) for one in network.value_scale)
    np.testing.assert_allclose(lesson.target * deviation + mean, target, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(lesson.target.mean(), 0.0, atol=1e-5)
    known = network.known(lesson.features, lesson.begins, lesson.core)
    np.testing.assert_allclose(network.values(known).detach(), value, rtol=1e-4, atol=1e-3)  # units do not change them
    assert lesson.missed == pytest.approx(np.var(target - value) / np.var(target))
    torch.testing.assert_close(
        lesson.log_probability, log_probability(torch.from_numpy(batch.mean), network.log_deviation, lesson.drawn)
    )
    with torch.no_grad():
        torch.testing.assert_close(network.actor(known), lesson.mean, rtol=1e-4, atol=1e-5)
