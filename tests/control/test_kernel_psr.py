from dataclasses import replace

import numpy as np
import pytest

from predplan.control.features import components, fourier, squared_bandwidth
from predplan.control.filtering import FilterState, filter_trajectories
from predplan.control.kernel_psr import KernelFilter, KernelSettings, conditioned, fit_kernel
from predplan.errors import InputError
from tests.control.systems import example, simulate

SETTINGS = KernelSettings(past=8, future=4, dimension=8, frequencies=100)


def one_hot(count: int, points: np.ndarray) -> np.ndarray:
    return np.asarray(np.eye(count)[points[:, 0].astype(int)])


def tabular(transition: np.ndarray, emission: np.ndarray) -> KernelFilter:
    """The filter of a system of few states with indicator features: q is the table P(o_t | a_t).

    transition [A, S, S] to by from, emission [O, S]; the action moves the system, then it is observed.
    """
    actions, states, observations = len(transition), transition.shape[1], len(emission)
    tables = np.einsum("os,ast->oat", emission, transition).reshape(observations * actions, states)
    belief = np.linalg.pinv(tables)
    # P(o', o | a, a') of a belief t: first a, then o, then a', then o'.
    both = np.einsum("pr,bru,ou,aut->poabt", emission, transition, emission, transition)
    extend = both.reshape(observations**2, actions**2, states) @ belief
    size = observations * actions
    diagonal = np.zeros((observations, observations, observations))
    diagonal[np.arange(observations), np.arange(observations), np.arange(observations)] = 1.0
    predictor = np.zeros((observations, observations, actions, actions))
    for action in range(actions):
        predictor[np.arange(observations), np.arange(observations), action, action] = 1.0
    return KernelFilter(
        observed=lambda points: one_hot(observations, points),
        acted=lambda points: one_hot(actions, points),
        to_state=np.eye(size).reshape(size, observations, actions),
        from_skipped=np.eye(observations**2).reshape(observations, observations, -1),
        from_skipped_action=np.eye(actions**2).reshape(actions, actions, -1),
        from_square=diagonal,
        extend=np.ascontiguousarray(extend),
        immediate=np.eye(size).reshape(observations, actions, size),
        predictor=predictor.reshape(observations, size, actions),
        shift=np.zeros(observations),
        scale=np.ones(observations),
        start=tables @ np.full(states, 1.0 / states),
        lam=1e-14,
        limit=1e3,
    )


def test_tabular_features_give_bayes_rule() -> None:
    generator = np.random.default_rng(0)
    transition = generator.dirichlet(np.full(3, 0.7), (2, 3)).transpose(0, 2, 1)
    emission = generator.dirichlet(np.full(3, 0.5), 3).T
    model = tabular(transition, emission)
    state, belief = model.initial(1), np.full(3, 1.0 / 3)
    for _ in range(60):
        action = int(generator.integers(2))
        moved = transition[action] @ belief
        expected = emission @ moved
        found = model.predict(state, np.array([[float(action)]]))[0]
        np.testing.assert_allclose(found, expected, atol=1e-7)
        observation = int(generator.choice(3, p=expected / expected.sum()))
        belief = emission[observation] * moved
        belief /= belief.sum()
        state = model.update(state, np.array([[float(action)]]), np.array([[float(observation), 0.0, 0.0]]))
    assert state.skipped[0] == 0


def plain_update(model: KernelFilter, q: np.ndarray, a: np.ndarray, o: np.ndarray) -> np.ndarray:
    """The module's equations as one contraction each. q [p], a and o features."""
    C = np.einsum("ijs,sap,p,a->ij", model.from_square, model.immediate, q, a)
    v = np.linalg.solve(C.T @ C + model.lam * np.eye(len(C)), C @ o)
    skipped, done = model.from_skipped, model.from_skipped_action
    future = np.einsum("Pox,xyp,aQy,o,p,a->PQ", skipped, model.extend, done, v, q, a, optimize=True)
    moved = np.einsum("pPQ,PQ->p", model.to_state, future)
    return np.asarray(moved) * min(1.0, model.limit / float(np.linalg.norm(moved)))


def test_compiled_equals_plain() -> None:
    generator = np.random.default_rng(1)
    data = simulate(example(), 30, 30, generator)
    model = fit_kernel(data, SETTINGS, generator)
    state = model.initial(5)
    for step in range(20):
        action, observation = data.action[step : step + 5], data.observation[step : step + 5]
        a, o = model.acted(action), model.observed(observation)
        expected = np.array([plain_update(model, *one) for one in zip(state.mean, a, o, strict=True)])
        state = model.update(state, action, observation)
        np.testing.assert_allclose(state.mean, expected, atol=1e-10)


def test_predictions_beat_the_mean() -> None:
    system = example()
    data, held_out = (simulate(system, 200, 40, np.random.default_rng(seed)) for seed in (2, 3))
    model = fit_kernel(data, SETTINGS, np.random.default_rng(4))
    filtered, rows = filter_trajectories(model, held_out), held_out.age >= 5
    error = np.mean((filtered.prediction[rows] - held_out.observation[rows]) ** 2)
    assert error < 0.5 * np.mean(held_out.observation.var(axis=0))
    assert filtered.skipped == 0


def test_missing_observations_are_expected_ones() -> None:
    generator = np.random.default_rng(5)
    data = simulate(example(), 30, 30, generator, 0.2)
    model = fit_kernel(data, SETTINGS, generator)
    state = model.update(model.initial(2), data.action[:2], np.zeros((2, 2)))
    action, nothing = data.action[2:4], np.full((2, 2), np.nan)
    expected = model.update(state, action, model.predict(state, action))
    np.testing.assert_array_equal(model.update(state, action, nothing).mean, expected.mean)
    assert np.isfinite(filter_trajectories(model, data).prediction).all()


def test_states_stay_finite() -> None:
    model = fit_kernel(simulate(example(), 30, 30, np.random.default_rng(6)), SETTINGS, np.random.default_rng(6))
    broken = replace(model, extend=model.extend * 1e308)
    state = broken.initial(2)
    after = broken.update(state, np.zeros((2, 1)), np.zeros((2, 2)))
    np.testing.assert_array_equal(after.skipped, [1, 1])
    np.testing.assert_array_equal(after.mean, state.mean)
    far = FilterState(np.full_like(state.mean, 1e6), state.covariance, state.skipped)
    for _ in range(5):
        far = model.update(far, np.ones((2, 1)), np.full((2, 2), 1e6))
        assert np.linalg.norm(far.mean, axis=1).max() <= model.limit * (1 + 1e-12)


def test_same_seed_same_bytes() -> None:
    data = simulate(example(), 20, 30, np.random.default_rng(7))
    first, second = (fit_kernel(data, SETTINGS, np.random.default_rng(8)) for _ in range(2))
    assert first.extend.tobytes() == second.extend.tobytes()
    assert first.predictor.tobytes() == second.predictor.tobytes()


def test_kernel_bayes_rule_of_constant_operators() -> None:
    """Where products do not depend on the past: C_LR C_RR (C_RR² + λI)⁻¹ of the sample's own second moments."""
    generator = np.random.default_rng(9)
    left, right = generator.standard_normal((50, 3)), generator.standard_normal((50, 2))
    found = conditioned(np.ones((50, 1)), left, right, 1e-3)
    crossed, square = left.T @ right / 50 / 1.001, right.T @ right / 50 / 1.001
    expected = crossed @ square @ np.linalg.inv(square @ square + 1e-3 * np.eye(2))
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-12)


def test_random_features_tend_to_the_gaussian_kernel() -> None:
    generator = np.random.default_rng(10)
    points = generator.standard_normal((20, 3))
    features = fourier(points, generator.standard_normal((3, 40_000)) / 1.7)
    distances = ((points[:, None] - points) ** 2).sum(axis=2)
    np.testing.assert_allclose(features @ features.T, np.exp(-distances / (2 * 1.7**2)), atol=0.03)


def test_components_are_the_leading_singular_vectors() -> None:
    generator = np.random.default_rng(11)
    features = generator.standard_normal((200, 30)) * 0.7 ** np.arange(30)
    found = components(features, 4, generator)
    _, _, right = np.linalg.svd(features)
    np.testing.assert_allclose(np.abs(found.T @ right[:4].T), np.eye(4), atol=1e-3)


def test_the_bandwidth_is_a_percentile_of_squared_distances() -> None:
    points = np.random.default_rng(12).standard_normal((2000, 1)) / np.sqrt(2)  # squared distances: chi-square of 1
    assert squared_bandwidth(points, 95.0, np.random.default_rng(13)) == pytest.approx(3.84, rel=0.1)
    assert squared_bandwidth(np.ones((5, 2)), 95.0, np.random.default_rng(13)) == 1.0


def test_what_cannot_be_learned_is_said() -> None:
    with pytest.raises(InputError, match="longest has"):
        fit_kernel(simulate(example(), 5, 4, np.random.default_rng(0)), SETTINGS, np.random.default_rng(0))
