from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.advantages import Lesson, prepare
from predplan.control.learner import Learner
from predplan.control.networks import log_probability
from predplan.control.pool import Pool
from predplan.control.ppo import PPO, PPOSettings, pick
from predplan.control.sampling import Batch
from tests.control.learners import CARTPOLE, collect, sampler, seeing_network

NO_HISTORY = Pool(1, 1)


def lesson_of(recurrent: int, length: int = 30) -> tuple[Batch, Learner]:
    made = sampler(CARTPOLE, 6, 2, recurrent)
    network = seeing_network(made.memory.size, 1, recurrent)
    collect(made, network, 5)
    return collect(made, network, length)


@pytest.mark.parametrize("recurrent", [0, 5])
def test_the_first_gradient_is_the_policy_gradient_and_the_values_regression(recurrent: int) -> None:
    """Where nothing has moved, -E[advantage grad log p] + half the gradient of squared errors."""
    batch, learner = lesson_of(recurrent)
    network = learner.network
    lesson = prepare(batch, network, learner.whitening, PPOSettings().advantages)
    known = network.known(lesson.features, lesson.begins, lesson.core)
    probability = log_probability(network.actor(known), network.log_deviation, lesson.drawn)
    loss = -(probability * lesson.advantage).mean()
    loss = loss + 0.5 * ((network.scaled_values(known) - lesson.target) ** 2).mean()
    parameters = list(network.parameters())
    expected = torch.cat([one.reshape(-1) for one in torch.autograd.grad(loss, parameters)]).numpy()
    update = PPO(learner, PPOSettings(rate=1e-12, epochs=1, minibatch=10_000, largest_gradient=1e9))
    report = update(learner, batch, NO_HISTORY, np.random.default_rng(0))
    found = np.array(update.arrays()["first"], np.float64) / 0.1
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5 * np.abs(expected).max())
    assert report.divergence == pytest.approx(0.0, abs=1e-6)
    assert report.skipped == 0


@pytest.mark.parametrize("recurrent", [0, 5])
def test_a_part_holds_the_steps_that_were_asked_for(recurrent: int) -> None:
    batch, learner = lesson_of(recurrent)
    lesson = prepare(batch, learner.network, learner.whitening, PPOSettings().advantages)
    rows = np.array([3, 1, 77]) if recurrent == 0 else np.array([4, 1])
    part = pick(lesson, learner.network, rows)
    known = learner.network.known(lesson.features, lesson.begins, lesson.core)
    chosen = torch.zeros(batch.reward.shape, dtype=torch.bool)
    if recurrent:
        chosen[:, rows] = True
    else:
        chosen.flatten()[rows] = True
    assert len(part.advantage) == int(chosen.sum())
    # All of a step are of the same step: its draw tells which.
    where = {float(drawn): at for at, drawn in enumerate(lesson.drawn.flatten())}
    at = torch.tensor([where[float(one)] for one in part.drawn.flatten()])
    assert set(at.tolist()) == set(np.flatnonzero(chosen.flatten()).tolist())
    torch.testing.assert_close(part.known, known.flatten(0, 1)[at])
    for name in ("advantage", "target", "log_probability"):
        assert torch.equal(getattr(part, name), getattr(lesson, name).flatten()[at])
    assert torch.equal(part.mean, lesson.mean.flatten(0, 1)[at])


@pytest.mark.parametrize("recurrent", [0, 5])
def test_an_update_makes_good_actions_likelier_and_values_better(recurrent: int) -> None:
    batch, learner = lesson_of(recurrent, 60)
    network = learner.network
    lesson = prepare(batch, network, learner.whitening, PPOSettings().advantages)
    before = surrogate(learner, lesson), error(learner, lesson)
    report = PPO(learner, PPOSettings(minibatch=60))(learner, batch, NO_HISTORY, np.random.default_rng(0))
    assert surrogate(learner, lesson) > before[0] + 0.01
    assert error(learner, lesson) < before[1]
    assert 0.0 < report.divergence < 0.2
    assert report.missed >= 0.0
    assert report.entropy == network.entropy


def test_epochs_end_where_the_policy_has_moved_far_enough() -> None:
    moved = []
    for most in (1e-9, 1e-3, 1e9):
        batch, learner = lesson_of(0)
        settings = PPOSettings(minibatch=60, most_divergence=most)
        update = PPO(learner, settings)
        moved.append(update(learner, batch, NO_HISTORY, np.random.default_rng(0)).divergence)
        steps = int(update.arrays()["count"][0])
        assert steps % 3 == 0
        assert (steps == 30) == (most == 1e9)
    assert moved[0] < moved[1] < moved[2]


def test_no_ratio_is_pushed_further_than_the_clip() -> None:
    """Once all ratios are clipped on their good side, no gradient is left for the policy."""
    batch, learner = lesson_of(0)
    settings = PPOSettings(minibatch=10_000, epochs=300, rate=0.02, clip=0.05, most_divergence=1e9)
    PPO(learner, settings)(learner, batch, NO_HISTORY, np.random.default_rng(0))
    lesson = prepare(batch, learner.network, learner.whitening, settings.advantages)
    known = learner.network.known(lesson.features, lesson.begins, lesson.core)
    probability = log_probability(learner.network.actor(known), learner.network.log_deviation, lesson.drawn)
    ratio = torch.exp(probability - lesson.log_probability)
    assert float((ratio * torch.sign(lesson.advantage)).detach().abs().median()) < 1.5


def test_the_same_generator_learns_the_same() -> None:
    found = []
    for seed in (0, 0, 1):
        batch, learner = lesson_of(0)
        PPO(learner, PPOSettings(minibatch=40))(learner, batch, NO_HISTORY, np.random.default_rng(seed))
        found.append(torch.nn.utils.parameters_to_vector(learner.network.parameters()).detach())
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])


def test_gradients_that_are_not_finite_are_counted_and_leave_the_policy() -> None:
    batch, learner = lesson_of(0)
    drawn = batch.drawn.copy()
    drawn[3, 2] = np.nan
    settings = PPOSettings(epochs=2, minibatch=90)
    report = PPO(learner, settings)(learner, replace(batch, drawn=drawn), NO_HISTORY, np.random.default_rng(0))
    assert report.skipped == 2  # of 4, as one of two minibatches holds that step
    assert all(bool(torch.isfinite(one).all()) for one in learner.network.parameters())


def surrogate(learner: Learner, lesson: Lesson) -> float:
    """Mean advantage by probability ratios."""
    network = learner.network
    with torch.no_grad():
        known = network.known(lesson.features, lesson.begins, lesson.core)
        probability = log_probability(network.actor(known), network.log_deviation, lesson.drawn)
        return float((torch.exp(probability - lesson.log_probability) * lesson.advantage).mean())


def error(learner: Learner, lesson: Lesson) -> float:
    """Mean square of what values miss, in the lesson's units."""
    network = learner.network
    with torch.no_grad():
        known = network.known(lesson.features, lesson.begins, lesson.core)
        return float(((network.scaled_values(known) - lesson.target) ** 2).mean())
