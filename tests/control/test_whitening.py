import numpy as np
import pytest
import torch

from predplan.control.learner import Learner
from predplan.control.whitening import Whitening, carry_over, no_statistics, no_whitening, whiten
from tests.control.learners import seeing_network


def correlated(rows: int, size: int = 4, seed: int = 0) -> np.ndarray:
    """Numbers of very different sizes that hang together."""
    generator = np.random.default_rng(seed)
    mixing = generator.standard_normal((size, size)) * 10.0 ** np.arange(-2, size - 2)[:, None]
    return generator.standard_normal((rows, size)) @ mixing.T + generator.standard_normal(size)


def test_running_statistics_are_those_of_all_rows() -> None:
    values = correlated(100)
    statistics = no_statistics(4)
    for part in np.split(values, [1, 30, 75]):
        statistics = statistics.updated(part, np.inf)
    assert statistics.count == 100
    np.testing.assert_allclose(statistics.mean, values.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(statistics.covariance, np.cov(values.T, bias=True), rtol=1e-10)


def test_older_rows_count_no_more_than_said() -> None:
    old, new = correlated(1000, seed=1), correlated(50, seed=2)
    before = no_statistics(4).updated(old, np.inf)
    forgotten = before.updated(new, 0.0)
    np.testing.assert_allclose(forgotten.mean, new.mean(axis=0))
    np.testing.assert_allclose(forgotten.covariance, np.cov(new.T, bias=True))
    equal = before.updated(new, 50.0)
    np.testing.assert_allclose(equal.mean, 0.5 * (old.mean(axis=0) + new.mean(axis=0)))
    both = np.concatenate([np.repeat(old, 1, axis=0), np.repeat(new, 20, axis=0)])
    np.testing.assert_allclose(equal.covariance, np.cov(both.T, bias=True), rtol=1e-10)


def test_whitened_numbers_have_mean_0_and_covariance_1() -> None:
    values = correlated(500)
    white = whiten(no_statistics(4).updated(values, 1.0), 1e-9)
    turned = (values - white.mean) @ white.matrix.T
    np.testing.assert_allclose(turned.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.cov(turned.T, bias=True), np.eye(4), atol=1e-7)
    np.testing.assert_allclose(turned, values @ white.matrix.T + white.offset, atol=1e-9)
    np.testing.assert_array_equal(white(values), np.clip(turned, -10.0, 10.0))


def test_independent_numbers_are_only_scaled() -> None:
    """Of all matrices that whiten, the one that turns nothing."""
    scale = np.array([1e-3, 1.0, 1e3])
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    white = whiten(no_statistics(3).updated(signs * scale, 1.0), 1e-6)
    np.testing.assert_allclose(white.matrix, np.diag(1.0 / scale), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("floor", [1e-2, 1e-5])
def test_directions_below_the_floor_are_not_blown_up(floor: float) -> None:
    generator = np.random.default_rng(3)
    common, apart = generator.standard_normal((2, 2000))
    values = np.stack([common, common + 1e-6 * apart], axis=1)
    white = whiten(no_statistics(2).updated(values, 1.0), floor)
    assert np.linalg.norm(white.matrix, 2) <= floor**-0.5 * 1.01
    spread = white(values).std(axis=0)
    assert spread.max() < 1.01


def test_what_never_changed_keeps_its_unit() -> None:
    values = np.stack([np.full(50, 1.0), np.random.default_rng(4).standard_normal(50)], axis=1)
    white = whiten(no_statistics(2).updated(values, 1.0), 1e-5)
    np.testing.assert_allclose(white.matrix[0], [1.0, 0.0])
    assert white(np.array([[1.0, 0.0]]))[0, 0] == 0.0
    assert white(np.array([[0.0, 0.0]]))[0, 0] == pytest.approx(-1.0)


def test_nothing_is_whitened_before_anything_was_seen() -> None:
    values = correlated(3)
    np.testing.assert_array_equal(no_whitening(4)(values), np.clip(values, -10, 10))


def test_a_layer_carried_over_makes_of_the_new_what_it_made_of_the_old() -> None:
    values = correlated(200, 4)
    generator = torch.Generator().manual_seed(0)
    weight, bias = torch.randn(5, 2, generator=generator), torch.randn(5, generator=generator)
    narrow, offset = np.random.default_rng(1).standard_normal((2, 4)), np.array([0.5, -2.0])
    before = (values @ narrow.T + offset) @ weight.double().numpy().T + bias.double().numpy()
    new = whiten(no_statistics(4).updated(values, 1.0), 1e-9)
    carry_over(weight, bias, narrow, offset, new)
    assert weight.shape == (5, 4)
    assert weight.dtype == torch.float32
    after = ((values - new.mean) @ new.matrix.T) @ weight.double().numpy().T + bias.double().numpy()
    np.testing.assert_allclose(after, before, rtol=1e-4, atol=1e-4 * np.abs(before).max())


@pytest.mark.parametrize("recurrent", [0, 6])
def test_a_policy_that_sees_more_stays_what_it_was(recurrent: int) -> None:
    network = seeing_network(4, 2, recurrent)
    learner = Learner(network, no_statistics(4), no_whitening(4))
    values = 0.02 * correlated(170)

    def outputs(whitening: Whitening) -> tuple[torch.Tensor, torch.Tensor]:
        with torch.no_grad():
            white = torch.from_numpy(whitening(values).astype(np.float32))
            known, _ = network.step(white, 0.1 * torch.ones(170, recurrent))
            return network.actor(known), network.values(known)

    for part in np.split(values, [50, 80, 140]):
        before = outputs(learner.whitening)
        learner.see(part.reshape(5, -1, 4), 50.0, 1e-3)
        for one, other in zip(outputs(learner.whitening), before, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-3)
    assert learner.statistics.count == 80  # the latest 30 in full, 50 of the others
