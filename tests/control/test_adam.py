import numpy as np
import pytest
import torch
from torch import Tensor, nn

from predplan.control.adam import Adam
from tests.control.learners import seeing_network


def loss(module: nn.Module) -> Tensor:
    """Of the actor alone."""
    value: Tensor = (module.actor(torch.linspace(-1.0, 1.0, 12).reshape(4, 3)) - 1.0).square().sum()  # type: ignore[operator]
    return value


@pytest.mark.parametrize("largest", [1e6, 0.5])
def test_steps_are_those_of_torch(largest: float) -> None:
    ours, theirs = seeing_network(3, 2), seeing_network(3, 2)
    adam, other = Adam(ours, 0.01), torch.optim.Adam(theirs.parameters(), 0.01, eps=1e-5)
    for _ in range(5):
        assert adam.step(loss(ours), largest)
        other.zero_grad()
        loss(theirs).backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(theirs.parameters(), largest)
        other.step()
    for one, two in zip(ours.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(one, two, rtol=1e-4, atol=1e-6)


def test_a_gradient_is_0_where_the_loss_does_not_reach() -> None:
    network = seeing_network(3, 2)
    gradient, at = Adam(network, 0.01).gradient(loss(network)), 0
    for name, one in network.named_parameters():
        part = gradient[at : at + one.numel()]
        assert bool(part.any()) == name.startswith("actor")
        at += one.numel()
    assert at == len(gradient)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_step_that_is_not_finite_is_not_made(bad: float) -> None:
    network = seeing_network(3, 2)
    adam = Adam(network, 0.01)
    adam.step(loss(network), 1.0)
    before = [one.detach().clone() for one in network.parameters()]
    kept = {name: one.copy() for name, one in adam.arrays().items()}
    assert not adam.step(loss(network) * bad, 1.0)
    for one, other in zip(network.parameters(), before, strict=True):
        assert torch.equal(one, other)
    for name, array in adam.arrays().items():
        np.testing.assert_array_equal(array, kept[name])


def test_what_is_put_away_goes_on_the_same() -> None:
    first, second = seeing_network(3, 2), seeing_network(3, 2, seed=7)
    adam = Adam(first, 0.01)
    for _ in range(3):
        adam.step(loss(first), 1.0)
    second.load_state_dict(first.state_dict())
    other = Adam(second, 0.01)
    other.restore(adam.arrays())
    for _ in range(3):
        adam.step(loss(first), 1.0)
        other.step(loss(second), 1.0)
    assert all(torch.equal(one, two) for one, two in zip(first.parameters(), second.parameters(), strict=True))
