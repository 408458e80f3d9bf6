from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from predplan.control.filtering import FilterState, filter_trajectories
from predplan.control.linear_filter import LinearFilter, gains
from predplan.control.trajectories import Trajectories
from tests.control.systems import exact_filter, example, kalman_predictions, simulate


@pytest.mark.parametrize("drop", [0.0, 0.1, 0.3, 0.9])
def test_innovation_form_gives_the_kalman_filters_predictions_whatever_is_missing(drop: float) -> None:
    system = example()
    data = simulate(system, 20, 60, np.random.default_rng(0), drop)
    filtered = filter_trajectories(exact_filter(system), data)
    np.testing.assert_allclose(filtered.prediction, kalman_predictions(system, data), atol=1e-10)
    assert filtered.skipped == 0


def test_a_wider_start_is_the_kalman_filters_too() -> None:
    """A start that is less certain than the steady state: P_0 of the innovation form is the excess."""
    system = example()
    excess = np.diag([0.5, 1.0, 2.0])
    wide = replace(system, P0=system.steady + excess)
    data = simulate(wide, 20, 40, np.random.default_rng(1), 0.2)
    model = replace(exact_filter(system), initial_covariance=excess)
    np.testing.assert_allclose(filter_trajectories(model, data).prediction, kalman_predictions(wide, data), atol=1e-9)


def test_with_all_seen_the_gain_settles_at_the_steady_one() -> None:
    model = replace(exact_filter(example()), initial_covariance=np.eye(3))
    state = model.initial(1)
    traces = []
    for _ in range(60):
        state = model.update(state, np.zeros((1, 1)), np.zeros((1, 2)))
        traces.append(float(np.trace(state.covariance[0])))
    assert all(later <= earlier for earlier, later in pairwise(traces))
    assert traces[-1] == 0.0
    missing = model.update(state, np.zeros((1, 1)), np.full((1, 2), np.nan))
    np.testing.assert_allclose(missing.covariance[0], model.K @ model.S @ model.K.T, atol=1e-14)


def plain_update(model: LinearFilter, state: FilterState, action: np.ndarray, observation: np.ndarray) -> FilterState:
    """The module's equations, one copy at a time."""
    means, covariances = [], []
    for q, P, a, o in zip(state.mean, state.covariance, action, (observation - model.shift) / model.scale, strict=True):
        e = o - model.C @ q - model.D @ a - model.d
        if np.isfinite(e).all():
            S_t = model.C @ P @ model.C.T + model.S
            K_t = (model.A @ P @ model.C.T + model.K @ model.S) @ np.linalg.inv(S_t)
        else:
            K_t, e = np.zeros_like(model.K), np.zeros_like(e)
        q = model.A @ q + model.B @ a + model.c + K_t @ e
        closed = model.A - K_t @ model.C
        P = closed @ P @ closed.T + (model.K - K_t) @ model.S @ (model.K - K_t).T
        means.append(q * min(1.0, model.limit / np.linalg.norm(q)))
        covariances.append(P * min(1.0, 4 * model.limit**2 / max(float(np.trace(P)), 1e-300)))
    return FilterState(np.array(means), np.array(covariances), state.skipped)


@pytest.mark.parametrize("limit", [1e6, 1.5])
def test_compiled_equals_plain(limit: float) -> None:
    generator = np.random.default_rng(2)
    shift, scale = np.array([0.3, -2.0]), np.array([2.0, 0.1])
    model = replace(
        exact_filter(example()), limit=limit, initial_covariance=np.eye(3), shift=shift, scale=scale,
        c=np.array([0.1, 0.0, -0.2]), d=np.array([0.05, 0.1]), initial_mean=np.array([1.0, 0.0, 0.5]),
    )  # fmt: skip
    compiled = plain = model.initial(7)
    for _ in range(40):
        action, observation = generator.standard_normal((7, 1)), shift + scale * generator.standard_normal((7, 2))
        observation[generator.random(7) < 0.3] = np.nan
        compiled = model.update(compiled, action, observation)
        plain = plain_update(model, plain, action, observation)
        np.testing.assert_allclose(compiled.mean, plain.mean, atol=1e-10)
        np.testing.assert_allclose(compiled.covariance, plain.covariance, atol=1e-10)


def test_filters_of_trajectories_equal_steps_one_by_one() -> None:
    system, generator = example(), np.random.default_rng(3)
    data = simulate(system, 5, 30, generator, 0.2)
    keep = np.concatenate([np.arange(30 * e, 30 * e + length) for e, length in enumerate((30, 4, 17, 30, 9))])
    ragged = Trajectories(
        data.observation[keep], data.action[keep], data.reward[keep], data.terminated[keep], data.truncated[keep],
        np.cumsum([0, 30, 4, 17, 30, 9]),
    )  # fmt: skip
    model = replace(exact_filter(system), initial_covariance=np.eye(3))
    filtered = filter_trajectories(model, ragged)
    for first, end in zip(ragged.first[:-1], ragged.first[1:], strict=True):
        state = model.initial(1)
        for t in range(first, end):
            action, observation = ragged.action[t : t + 1], ragged.observation[t : t + 1]
            np.testing.assert_array_equal(filtered.state[t], state.mean[0])
            np.testing.assert_allclose(filtered.prediction[t], model.predict(state, action)[0], atol=1e-13)
            state = model.update(state, action, observation)
            np.testing.assert_array_equal(filtered.after[t], state.mean[0])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_states_stay_finite(bad: float) -> None:
    """What is not finite is missing; what is absurd is clipped; an action that is not finite is skipped and counted."""
    model = replace(exact_filter(example()), limit=10.0)
    state = model.initial(3)
    observation, action = np.zeros((3, 2)), np.zeros((3, 1))
    observation[1, 0] = bad
    state = model.update(state, action, observation)
    assert np.isfinite(state.mean).all()
    assert np.isfinite(state.covariance).all()
    assert np.linalg.norm(state.mean, axis=1).max() <= 10.0 * (1 + 1e-12)
    action[2] = np.nan
    after = model.update(state, action, np.zeros((3, 2)))
    np.testing.assert_array_equal(after.skipped - state.skipped, [0, 0, 1])
    np.testing.assert_array_equal(after.mean[2], state.mean[2])


def test_an_unstable_system_that_is_never_seen_stays_bounded() -> None:
    system = example()
    model = replace(exact_filter(system), A=system.A * 1.5, limit=10.0)
    state = model.initial(1)
    for _ in range(3000):
        state = model.update(state, np.ones((1, 1)), np.full((1, 2), np.nan))
    assert state.skipped[0] == 0
    assert np.linalg.norm(state.mean) <= 10.0 * (1 + 1e-12)
    assert np.trace(state.covariance[0]) <= 400.0 * (1 + 1e-12)


def test_copies_are_taken_and_put() -> None:
    model = exact_filter(example())
    state = model.update(model.initial(4), np.ones((4, 1)), np.arange(8.0).reshape(4, 2))
    rows = np.array([1, 3])
    again = state.put(rows, model.initial(2))
    np.testing.assert_array_equal(again.mean[rows], 0.0)
    np.testing.assert_array_equal(again.mean[[0, 2]], state.mean[[0, 2]])
    np.testing.assert_array_equal(state.take(rows).mean, state.mean[rows])


def test_with_its_gains_the_filter_is_linear_in_observations() -> None:
    system = example()
    data = simulate(system, 6, 25, np.random.default_rng(4), 0.3)
    model = replace(exact_filter(system), initial_covariance=np.eye(3), limit=100.0)
    K, expected = gains(model, data), filter_trajectories(model, data).after
    assert not K[~data.seen].any()
    for first, end in zip(data.first[:-1], data.first[1:], strict=True):
        q = model.initial_mean
        for t in range(first, end):
            innovation = np.nan_to_num(data.observation[t]) - model.C @ q - model.D @ data.action[t] - model.d
            q = model.A @ q + model.B @ data.action[t] + model.c + K[t] @ innovation
            np.testing.assert_allclose(q, expected[t], atol=1e-11)
