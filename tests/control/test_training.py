from dataclasses import asdict, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from predplan.control.environments import EnvironmentSettings
from predplan.control.filtering import filter_trajectories
from predplan.control.memories import Predictive
from predplan.control.methods import METHODS, Method, find_method
from predplan.control.networks import NetworkSettings
from predplan.control.ppo import PPOSettings
from predplan.control.training import Diverged, Progress, Schedule, Training
from predplan.errors import InputError

CARTPOLE = EnvironmentSettings("cartpole", threads=1)
LOSSY = replace(CARTPOLE, noise=0.2, drop=0.2)
SCHEDULE = Schedule(8 * 16 * 4, 8, 16)


def advance(training: Training, updates: int = 4) -> list[Progress]:
    return [training.advance() for _ in range(updates)]


def told(progress: Progress) -> dict[str, Any]:
    """What does not depend on the clock, as text, for NaN to equal NaN."""
    return {name: repr(value) for name, value in asdict(progress).items() if name != "cpu_s"}


@pytest.mark.parametrize("task", [CARTPOLE, LOSSY])
@pytest.mark.parametrize("method", ["rpsp", "rpsp-obs", "fm2", "gru", "rpsp-alt"])
def test_same_seed_same_progress_and_another_seed_another(task: EnvironmentSettings, method: str) -> None:
    first, same, other = (advance(Training(task, METHODS[method], SCHEDULE, seed)) for seed in (0, 0, 1))
    assert [told(one) for one in first] == [told(one) for one in same]
    assert [told(one) for one in first] != [told(one) for one in other]
    assert [one.steps for one in first] == [128, 256, 384, 512]
    assert [one.update for one in first] == [1, 2, 3, 4]
    assert all(one.skipped == 0 for one in first if method != "rpsp-alt")
    assert all(later.cpu_s > earlier.cpu_s for earlier, later in pairwise(first))
    assert all(np.isfinite(one.prediction_error) == method.startswith("rpsp") for one in first)


def test_threads_do_not_matter() -> None:
    one, two = (
        advance(Training(replace(LOSSY, threads=threads), METHODS["rpsp"], SCHEDULE, 0), 3) for threads in (1, 2)
    )
    assert [told(row) for row in one] == [told(row) for row in two]


def test_every_method_begins_with_the_same_blind_batch() -> None:
    returns = set()
    for name in ("rpsp", "fm2", "gru", "rpsp-obs"):
        first = Training(LOSSY, METHODS[name], SCHEDULE, 3).advance()
        returns.add((first.return_mean, first.episodes))
    assert len(returns) == 1


@pytest.mark.parametrize("task", [CARTPOLE, LOSSY])
@pytest.mark.parametrize("method", ["rpsp", "rpsp-obs", "rpsp-vrpg"])
def test_running_episodes_are_filtered_with_the_model_as_it_is(task: EnvironmentSettings, method: str) -> None:
    """After refits too: the memory's states are those of the episodes so far, from their beginnings."""
    training = Training(task, METHODS[method], SCHEDULE, 0)
    refitted = []
    for _ in range(4):
        refitted.append(training.advance().refitted)
        memory = training.sampler.memory
        assert isinstance(memory, Predictive)
        assert memory.model is training.learner.model
        running = training._pool.running()
        goes_on = ~training.sampler._begins
        expected = filter_trajectories(memory.model, running).after[running.first[1:] - 1]
        np.testing.assert_allclose(memory.state.mean[goes_on], expected[goes_on], rtol=1e-9, atol=1e-9)
        features = training.learner.whitening(memory.features())
        assert np.isfinite(features).all()
    if method != "rpsp-vrpg":
        assert any(refitted)


def test_refits_come_when_they_are_due_and_leave_the_policy_nearly_what_it_was() -> None:
    method = METHODS["rpsp"]
    assert method.filter is not None
    training = Training(CARTPOLE, replace(method, filter=replace(method.filter, refit_every=3)), SCHEDULE, 0)
    rows = advance(training, 6)
    assert [np.isfinite(one.refit_kl) for one in rows] == [False, False, True] * 2
    assert all(one.refit_kl <= method.filter.most_divergence for one in rows if one.refitted)
    strict = replace(method, filter=replace(method.filter, refit_every=1, most_divergence=1e-12))
    training = Training(LOSSY, strict, SCHEDULE, 0)
    first = training.advance()
    model = training.learner.model
    rows = [first, *advance(training, 2)]
    assert not any(one.refitted for one in rows[1:])
    assert training.learner.model is model or first.refitted


@pytest.mark.parametrize("task", [CARTPOLE, LOSSY])
@pytest.mark.parametrize("method", ["rpsp", "gru", "rpsp-vrpg"])
def test_what_is_put_away_goes_on_the_same_and_does_not_change(task: EnvironmentSettings, method: str) -> None:
    training = Training(task, METHODS[method], SCHEDULE, 0)
    advance(training, 2)
    arrays, rest = training.put_away()
    expected = [told(one) for one in advance(training, 2)]  # after it was put away
    other = Training(task, METHODS[method], SCHEDULE, 0)
    other.take_up(arrays, rest)
    assert [told(one) for one in advance(other, 2)] == expected


def test_a_recurrent_policy_on_predictive_states_learns_and_refits() -> None:
    method = replace(METHODS["rpsp"], network=NetworkSettings((16,), recurrent=8))
    rows = advance(Training(LOSSY, method, SCHEDULE, 0))
    assert any(np.isfinite(one.refit_kl) for one in rows)
    assert all(np.isfinite(one.policy_kl) for one in rows)


def test_numbers_that_are_not_finite_are_skipped_and_counted() -> None:
    training = Training(CARTPOLE, METHODS["rpsp"], SCHEDULE, 0)
    advance(training, 1)
    memory = training.sampler.memory
    assert isinstance(memory, Predictive)
    broken = memory.state.covariance.copy()
    broken[3] = np.nan
    memory.state = replace(memory.state, covariance=broken)
    after = advance(training, 2)
    assert after[0].skipped > 0
    assert after[1].skipped >= after[0].skipped
    assert np.isfinite(memory.features()).all()


def test_a_network_that_is_not_finite_ends_learning() -> None:
    training = Training(CARTPOLE, METHODS["fm2"], SCHEDULE, 0)
    advance(training, 1)
    with torch.no_grad():
        list(training.learner.network.critic.parameters())[-1].fill_(float("nan"))
    with pytest.raises(Diverged, match=r"critic.*is not finite after update 2, 256 steps"):
        training.advance()


@pytest.mark.parametrize("task", ["HalfCheetah-v5", "InvertedDoublePendulum-v5", "Reacher-v5"])
@pytest.mark.parametrize("method", ["rpsp", "fm2"])
def test_other_tasks_of_gymnasium_are_learned_too(task: str, method: str) -> None:
    rows = advance(Training(EnvironmentSettings(task, horizon=20), METHODS[method], Schedule(10_000, 4, 32), 0), 3)
    assert [one.steps for one in rows] == [128, 256, 384]
    assert all(np.isfinite(one.return_mean) for one in rows)


def test_the_first_batch_may_be_all() -> None:
    training = Training(CARTPOLE, METHODS["rpsp"], Schedule(1, 4, 16), 0)
    assert not training.done
    assert training.advance().steps == 64
    assert training.done


def test_bad_methods_are_named() -> None:
    with pytest.raises(InputError, match="method: found 'rpps', expected one of rpsp, "):
        find_method("rpps")
    with pytest.raises(InputError, match="window: found 0, expected at least 1"):
        Method(window=0)


def test_a_batch_too_short_to_learn_a_filter_from_is_named() -> None:
    with pytest.raises(InputError, match="a filter needs windows of 3"):
        Training(CARTPOLE, METHODS["rpsp"], Schedule(10, 2, 1), 0).advance()


def test_cartpole_is_learned() -> None:
    method = replace(METHODS["rpsp"], update=PPOSettings(minibatch=128))
    rows = advance(Training(CARTPOLE, method, Schedule(10_000, 16, 64), 0), 10)
    assert np.nanmean([one.return_mean for one in rows[-3:]]) > 3.0 * rows[0].return_mean
