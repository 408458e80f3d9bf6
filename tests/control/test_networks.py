import numpy as np
import pytest
import torch
from torch.distributions import Independent, Normal, kl_divergence

from predplan.control.networks import ActorCritic, NetworkSettings, cut, divergence, log_probability
from tests.control.learners import seeing_network

BEGINS = np.zeros((9, 4), np.bool_)
BEGINS[[0, 3, 4, 8], [0, 0, 0, 0]] = True  # an episode of one step among them
BEGINS[[2, 7], [1, 1]] = True  # copy 1 is in the middle of an episode at first
BEGINS[0, 3] = True


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def stepped(network: ActorCritic, features: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
    """One row after the other, the core forgotten where an episode begins."""
    known = []
    for t in range(len(features)):
        state = torch.where(torch.from_numpy(BEGINS[t])[:, None], 0.0, state)
        one, state = network.step(features[t], state)
        known.append(one)
    return torch.stack(known)


def test_unrolled_at_once_is_stepped_row_by_row() -> None:
    network, features, state = seeing_network(3, 2, recurrent=5), random(9, 4, 3), random(4, 5, seed=1)
    expected = stepped(network, features, state)
    torch.testing.assert_close(network.known(features, BEGINS, state), expected)


def test_gradients_of_unrolled_are_those_of_steps() -> None:
    network, features, state = seeing_network(3, 2, recurrent=5), random(9, 4, 3), random(4, 5, seed=1)
    found, expected = (
        torch.autograd.grad((known**2).sum(), list(network.core.parameters()))  # type: ignore[union-attr]
        for known in (network.known(features, BEGINS, state), stepped(network, features, state))
    )
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize("copies", [[0], [1, 3], [0, 1, 2, 3]])
def test_pieces_hold_each_row_of_their_copies_once(copies: list[int]) -> None:
    pieces = cut(BEGINS, np.array(copies))
    rows = np.sort(pieces.rows[pieces.inside].numpy())
    np.testing.assert_array_equal(rows, np.sort((np.arange(9)[:, None] * 4 + np.array(copies)).ravel()))
    carried = {int(copy): int(one) for copy, one in zip(pieces.copy, pieces.carried, strict=True) if one}
    assert carried == {copy: 1 for copy in copies if not BEGINS[0, copy]}


def test_rows_of_some_copies_are_unrolled_alone() -> None:
    network, features, state = seeing_network(3, 2, recurrent=5), random(9, 4, 3), random(4, 5, seed=1)
    pieces = cut(BEGINS, np.array([1, 3]))
    found = network.unrolled(features.flatten(0, 1), pieces, state)
    expected = network.known(features, BEGINS, state).flatten(0, 1)[pieces.rows[pieces.inside]]
    torch.testing.assert_close(found, expected)


def test_without_a_core_networks_read_the_features() -> None:
    network, features = seeing_network(3, 2), random(9, 4, 3)
    assert network.known(features, BEGINS, network.initial(4)) is features
    row = features[0]
    known, state = network.step(row, network.initial(4))
    assert known is row
    assert state.shape == (4, 0)


def test_probabilities_divergence_and_entropy_are_torchs() -> None:
    mean, other, action = (random(7, 3, seed=seed) for seed in range(3))
    wide, narrow = torch.tensor([0.3, -0.5, 0.0]), torch.tensor([-0.2, 0.1, -1.0])
    first, second = Independent(Normal(mean, wide.exp()), 1), Independent(Normal(other, narrow.exp()), 1)
    torch.testing.assert_close(log_probability(mean, wide, action), first.log_prob(action))  # type: ignore[no-untyped-call]
    torch.testing.assert_close(divergence(mean, wide, other, narrow), kl_divergence(first, second))
    assert float(divergence(mean, wide, mean, wide).abs().max()) < 1e-6
    network = seeing_network(4, 3)
    with torch.no_grad():
        network.log_deviation.copy_(wide)
    entropy = float(first.entropy()[0])  # type: ignore[no-untyped-call]
    assert network.entropy == pytest.approx(entropy, rel=1e-6)


def test_values_stay_when_their_units_change() -> None:
    network, known = seeing_network(3, 1), random(50, 3)
    before = network.values(known).detach()
    for mean, deviation in ((3.0, 10.0), (-40.0, 0.1), (0.0, 1.0)):
        network.rescale_values(mean, deviation)
        torch.testing.assert_close(network.values(known), before, rtol=1e-4, atol=1e-4)
        scaled = (network.values(known) - mean) / deviation
        torch.testing.assert_close(network.scaled_values(known), scaled, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("recurrent", [0, 4])
def test_every_policy_starts_blind_and_from_its_generator(recurrent: int) -> None:
    settings = NetworkSettings((8, 8), recurrent, -0.7)
    first, same, other = (ActorCritic(3, 2, settings, torch.Generator().manual_seed(seed)) for seed in (0, 0, 1))
    known = first.known(random(9, 4, 3), BEGINS, first.initial(4))
    assert not first.actor(known).any()
    assert first.values(known).detach().std() > 0.0
    np.testing.assert_allclose(first.log_deviation.detach(), -0.7)
    states = [one.state_dict() for one in (first, same, other)]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    assert not all(torch.equal(states[0][name], states[2][name]) for name in states[0])


@pytest.mark.parametrize("recurrent", [0, 5])
def test_acting_with_arrays_is_the_actor(recurrent: int) -> None:
    network = seeing_network(3, 2, recurrent)
    known = random(7, recurrent or 3)
    for _ in range(2):
        with torch.no_grad():
            np.testing.assert_allclose(network.acting()(known.numpy()), network.actor(known).numpy(), atol=1e-6)
            next(network.actor.parameters()).add_(0.1)  # and again, changed
