from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.adopting import adopt, states_at_end
from predplan.control.advantages import whitened
from predplan.control.filtering import filter_trajectories
from predplan.control.learner import Learner
from predplan.control.linear_filter import LinearFilter, turned
from predplan.control.memories import predictive_features
from predplan.control.trajectories import Trajectories
from predplan.control.whitening import no_statistics, no_whitening
from tests.control.learners import seeing_network, uneven
from tests.control.systems import exact_filter, example, simulate

CENTRE = np.zeros(2)


def learner_of(window: int, recurrent: int, data: Trajectories) -> Learner:
    """A policy of the exact filter's state, whitened."""
    model = replace(exact_filter(example()), initial_covariance=np.eye(3))
    features = predictive_features(filter_trajectories(model, data), data, window, CENTRE)
    size = features.shape[1]
    learner = Learner(seeing_network(size, 1, recurrent), no_statistics(size), no_whitening(size), model)
    learner.see(features, 1e4, 1e-6)
    return learner


def data_of(drop: float) -> Trajectories:
    lengths = [20, 3, 11, 1, 30, 8, 17, 25]
    return uneven(simulate(example(), 8, 30, np.random.default_rng(0), drop), lengths)


def outputs(learner: Learner, data: Trajectories, window: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Means and values, the core at rest."""
    assert learner.model is not None
    features = predictive_features(filter_trajectories(learner.model, data), data, window, CENTRE)
    network = learner.network
    with torch.no_grad():
        known, _ = network.step(whitened(features, learner.whitening), network.initial(len(features)))
        return network.actor(known), network.values(known)


def in_another_basis(model: LinearFilter, seed: int = 3) -> LinearFilter:
    """The same filter."""
    return turned(model, np.random.default_rng(seed).standard_normal((3, 3)) + 2.0 * np.eye(3))


@pytest.mark.parametrize("window", [0, 1, 2])
@pytest.mark.parametrize("recurrent", [0, 4])
@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_the_same_filter_in_another_basis_leaves_the_policy_what_it_was(
    window: int, recurrent: int, drop: float
) -> None:
    data = data_of(drop)
    learner = learner_of(window, recurrent, data)
    model = learner.model
    assert model is not None
    before, other = outputs(learner, data, window), in_another_basis(model)
    adoption = adopt(learner, other, data, window, CENTRE, 1e-3, 1e-6)
    assert adoption.accepted
    assert adoption.divergence < 1e-5
    assert learner.model is other
    for one, two in zip(outputs(learner, data, window), before, strict=True):
        torch.testing.assert_close(one, two, rtol=0.0, atol=5e-3)


@pytest.mark.parametrize("recurrent", [0, 4])
def test_a_filter_that_moves_the_policy_far_is_rejected_and_nothing_changes(recurrent: int) -> None:
    data = data_of(0.0)
    learner = learner_of(0, recurrent, data)
    model = learner.model
    assert model is not None
    statistics, whitening = learner.statistics, learner.whitening
    weights = {name: one.clone() for name, one in learner.network.state_dict().items()}
    far = replace(model, A=0.1 * model.A, K=-3.0 * model.K, B=np.zeros_like(model.B))
    broken = replace(model, A=np.full((3, 3), np.nan), limit=np.inf, initial_mean=np.full(3, np.nan))
    wider = replace(model, A=np.eye(4))
    for other in (far, broken, wider):
        adoption = adopt(learner, other, data, 0, CENTRE, 1e-4, 1e-6)
        assert not adoption.accepted
        assert adoption.divergence > 1e-4
        assert learner.model is model
        assert learner.statistics is statistics
        assert learner.whitening is whitening
        for name, one in learner.network.state_dict().items():
            assert torch.equal(one, weights[name]), name
    assert adopt(learner, far, data, 0, CENTRE, 1e9, 1e-6).accepted


@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_states_at_the_end_are_those_after_the_last_rows(drop: float) -> None:
    data = data_of(drop)
    model = replace(exact_filter(example()), initial_covariance=np.eye(3))
    state = states_at_end(model, data)
    np.testing.assert_allclose(state.mean, filter_trajectories(model, data).after[data.first[1:] - 1], atol=1e-12)
    for trajectory in range(len(data.lengths)):
        alone = states_at_end(model, data.take(np.array([trajectory])))
        np.testing.assert_allclose(alone.covariance[0], state.covariance[trajectory], atol=1e-12)
