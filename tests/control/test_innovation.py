from dataclasses import replace

import numpy as np
import pytest

from predplan.control.autoregression import fit_autoregression, residual_covariance, standardise, window_moments
from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import (
    InnovationSettings,
    expected_future,
    fit_basis,
    fit_in_basis,
    fit_innovation,
    future_errors,
)
from predplan.control.moments import second_moments
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError
from tests.control.systems import example, kalman_predictions, simulate

SETTINGS = InnovationSettings(past=15, future=8, dimension=3)


def excess(drop: float, trajectories: int, seed: int, settings: InnovationSettings = SETTINGS) -> float:
    """Mean square difference of learned and exact predictions, over that of exact ones and what was observed."""
    system = example()
    held_out = simulate(system, 40, 50, np.random.default_rng(1000), drop)
    exact = kalman_predictions(system, held_out)
    model = fit_innovation(simulate(system, trajectories, 50, np.random.default_rng(seed), drop), settings)
    learned = filter_trajectories(model, held_out).prediction
    return float(np.mean((learned - exact) ** 2) / np.nanmean((held_out.observation - exact) ** 2))


@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_predictions_become_the_kalman_filters_as_data_grows(drop: float) -> None:
    sizes = np.array([20, 80, 320, 1280])
    errors = np.array([np.mean([excess(drop, size, seed) for seed in range(3)]) for size in sizes])
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert slope < -0.7, errors  # the parameters' variance falls like 1 / n
    assert errors[-1] < 0.003, errors


def test_missing_observations_cost_no_more_than_they_must() -> None:
    """Learned and used with 30% missing, errors against what was seen are the exact filter's within 2%."""
    assert excess(0.3, 400, 7) < 0.02


def test_start_of_trajectories_is_learned() -> None:
    """Trajectories that start far and wide: predictions in the first rows are those of a filter that knows."""
    system = replace(example(), P0=example().steady + np.diag([4.0, 2.0, 0.0]))
    held_out = simulate(system, 300, 6, np.random.default_rng(1))
    exact = kalman_predictions(system, held_out)
    data = simulate(system, 600, 40, np.random.default_rng(2))
    model = fit_innovation(data, SETTINGS)
    certain = replace(model, initial_covariance=np.zeros((3, 3)))
    share = [
        np.mean((filter_trajectories(one, held_out).prediction - exact) ** 2)
        / np.mean((held_out.observation - exact) ** 2)
        for one in (model, certain)
    ]
    assert share[0] < 0.01
    assert share[0] < 0.1 * share[1]


def test_what_was_learned_forgets() -> None:
    model = fit_innovation(simulate(example(), 200, 50, np.random.default_rng(3)), SETTINGS)
    assert np.abs(np.linalg.eigvals(model.A - model.K @ model.C)).max() < 1.0


def test_same_data_same_bytes() -> None:
    data = simulate(example(), 30, 40, np.random.default_rng(4), 0.2)
    first, second = (fit_innovation(data, SETTINGS) for _ in range(2))
    for one, other in zip(first.arrays(), second.arrays(), strict=True):
        assert one.tobytes() == other.tobytes()


def test_units_do_not_matter() -> None:
    data = simulate(example(), 50, 40, np.random.default_rng(5))
    factor, offset = np.array([1e4, 1e-3]), np.array([5.0, -2.0])
    scaled = data.with_observation(data.observation * factor + offset)
    plain = filter_trajectories(fit_innovation(data, SETTINGS), data).prediction
    other = filter_trajectories(fit_innovation(scaled, SETTINGS), scaled).prediction
    np.testing.assert_allclose(other, plain * factor + offset, rtol=1e-6, atol=1e-6 * factor.max())


def test_moments_with_gaps_are_those_without_as_data_grows() -> None:
    generator = np.random.default_rng(6)
    mixing = generator.standard_normal((6, 6))
    errors = []
    for count in (300, 3000, 30000):
        vectors = generator.standard_normal((count, 6)) @ mixing.T + 1.0
        gaps = np.where(generator.random(vectors.shape) < 0.3, np.nan, vectors)
        found = second_moments(gaps, iterations=200)
        errors.append(np.abs(found.covariance - mixing @ mixing.T).max())
    assert errors[2] < 0.3 * errors[0]
    assert errors[2] < 0.2


def test_moments_without_gaps_are_the_samples() -> None:
    vectors = np.random.default_rng(7).standard_normal((50, 4))
    found = second_moments(vectors)
    np.testing.assert_allclose(found.covariance, np.cov(vectors.T, bias=True), atol=1e-12)


def test_an_observation_that_never_changes_is_foretold() -> None:
    data = simulate(example(), 30, 40, np.random.default_rng(8))
    still = np.concatenate([data.observation, np.full((len(data.observation), 1), 3.0)], axis=1)
    model = fit_innovation(data.with_observation(still), SETTINGS)
    prediction = filter_trajectories(model, data.with_observation(still)).prediction
    np.testing.assert_allclose(prediction[:, 2], 3.0, atol=1e-6)


def test_what_cannot_be_learned_is_said() -> None:
    data = simulate(example(), 5, 12, np.random.default_rng(9))
    with pytest.raises(InputError, match="longest has 12 rows, a window needs 16"):
        fit_innovation(data, SETTINGS)
    nothing = data.with_observation(np.ones_like(data.observation))
    with pytest.raises(InputError, match="never change"):
        fit_innovation(nothing, replace(SETTINGS, past=3))


def test_refits_in_a_basis_keep_what_states_mean() -> None:
    """Learned anew from other data of the same system, states are the same numbers; in a basis of its own they turn."""
    first, second = (simulate(example(), 300, 50, np.random.default_rng(seed)) for seed in (10, 11))
    standard = standardise(first)
    basis = fit_basis(*window_moments(first, SETTINGS.past, standard), standard, SETTINGS)

    def states(learned_from: Trajectories) -> FloatArray:
        _, moments = window_moments(learned_from, SETTINGS.past, standard)
        return filter_trajectories(fit_in_basis(basis, moments, learned_from, SETTINGS), second).state

    before = states(first)
    np.testing.assert_array_equal(before, filter_trajectories(fit_innovation(first, SETTINGS), second).state)
    assert np.mean((states(second) - before) ** 2) < 0.03 * np.mean(before**2)


def test_what_futures_will_differ_by_is_what_they_do() -> None:
    """Observations after a window, of a system without actions, less those expected."""
    system = replace(example(), B=np.zeros((3, 1)), D=np.zeros((2, 1)))
    data = simulate(system, 3000, 25, np.random.default_rng(12))
    standard = standardise(data)
    layout, moments = window_moments(data, 15, standard)
    regression = fit_autoregression(layout, moments, standard, 1e-8)
    expected = future_errors(regression, residual_covariance(regression, moments), 4)
    rows = np.flatnonzero(data.age == 15)
    scaled = standard(data.observation)
    past = scaled[rows[:, None] + np.arange(-15, 0)].reshape(len(rows), -1)
    done = data.action[rows[:, None] + np.arange(-15, 0)].reshape(len(rows), -1)
    window = np.concatenate([past, done], axis=1)
    futures = scaled[rows[:, None] + np.arange(4)].reshape(len(rows), -1)
    error = futures - (window - moments.mean[: window.shape[1]]) @ expected_future(regression, 4).T
    np.testing.assert_allclose(np.cov(error.T), expected, atol=0.05 * np.abs(expected).max())


def test_canonical_variates_keep_what_is_small_but_foretold() -> None:
    """A third observation, tiny in what is foretold of it and yet wholly foretold, is among two components of four."""
    data = simulate(example(), 200, 50, np.random.default_rng(13))
    generator = np.random.default_rng(14)
    hidden = 0.05 * np.sin(np.arange(50) * 0.7 + generator.uniform(0, 6, 200)[:, None]).ravel()
    other = generator.standard_normal((len(hidden), 1))
    data = data.with_observation(np.concatenate([data.observation, hidden[:, None] + 1e-3 * other], axis=1))
    model = fit_innovation(data, replace(SETTINGS, dimension=2))
    prediction = filter_trajectories(model, data).prediction
    late = data.age > 15
    assert np.var((prediction - data.observation)[late, 2]) < 0.05 * np.var(hidden)
