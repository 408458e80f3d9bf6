import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.control.autoregression import fit_autoregression, hold_last, predict_next, standardise, window_moments
from predplan.control.innovation import expected_future
from predplan.control.trajectories import Trajectories
from predplan.control.windows import make_windows, window_rows
from predplan.errors import InputError


def made(lengths: list[int], observations: int = 2, actions: int = 1, seed: int = 0) -> Trajectories:
    generator, n = np.random.default_rng(seed), sum(lengths)
    return Trajectories(
        observation=generator.standard_normal((n, observations)),
        action=generator.standard_normal((n, actions)),
        reward=np.zeros(n),
        terminated=np.zeros(n, np.bool_),
        truncated=np.zeros(n, np.bool_),
        first=np.cumsum([0, *lengths]),
    )


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(1, 12), min_size=1, max_size=5), st.integers(1, 4), st.integers(1, 4))
def test_windows_are_those_of_a_loop(lengths: list[int], past: int, future: int) -> None:
    trajectories = made(lengths)
    expected = []
    for first, end in zip(trajectories.first[:-1], trajectories.first[1:], strict=True):
        for t in range(first, end):
            if t - past >= first and t + future < end:
                expected.append(
                    (
                        t,
                        [trajectories.observation[t - k] for k in range(past, 0, -1)],
                        [trajectories.action[t - k] for k in range(past, 0, -1)],
                        [trajectories.observation[t + k] for k in range(future)],
                        [trajectories.action[t + k] for k in range(future)],
                        [trajectories.observation[t + k + 1] for k in range(future)],
                        [trajectories.action[t + k + 1] for k in range(future)],
                    )
                )
    if not expected:
        with pytest.raises(InputError, match="the longest has"):
            make_windows(trajectories, past, future)
        return
    found = make_windows(trajectories, past, future)
    windows = [f"{window}_{what}" for window in ("past", "future", "shifted") for what in ("observation", "action")]
    names = ["rows", *windows]
    for name, values in zip(names, zip(*expected, strict=True), strict=True):
        np.testing.assert_array_equal(getattr(found, name), np.array(values), err_msg=name)


def test_windows_of_no_rows_are_refused() -> None:
    with pytest.raises(InputError, match="past 0"):
        window_rows(made([5]), 0, 1)
    with pytest.raises(InputError, match="future: found 0"):
        make_windows(made([5]), 1, 0)


def test_autoregression_is_least_squares() -> None:
    trajectories = made([30, 25], seed=1)
    standard = standardise(trajectories)
    model = fit_autoregression(*window_moments(trajectories, 2, standard), standard, 0.0)
    rows = window_rows(trajectories, 2, 0)
    inputs = np.array(
        [
            [
                *trajectories.observation[t - 2],
                *trajectories.observation[t - 1],
                *trajectories.action[t - 2 : t + 1, 0],
                1,
            ]
            for t in rows
        ]
    )
    weights = np.linalg.lstsq(inputs, trajectories.observation[rows], rcond=None)[0]
    prediction = predict_next(model, trajectories)
    np.testing.assert_allclose(prediction[rows], inputs @ weights, atol=1e-9)
    assert np.isnan(np.delete(prediction, rows, axis=0)).all()


def test_the_expected_future_is_the_autoregression_rolled_forward() -> None:
    trajectories = made([60], observations=2, actions=1, seed=2)
    standard = standardise(trajectories)
    model = fit_autoregression(*window_moments(trajectories, 3, standard), standard, 0.0)
    generator = np.random.default_rng(3)
    observation, action = generator.standard_normal((3, 2)), generator.standard_normal((3, 1))
    window = np.concatenate([observation.ravel(), action.ravel()])
    futures = (expected_future(model, 4) @ window).reshape(4, 2)
    for k in range(4):
        following = model.past @ np.concatenate([observation[-3:].ravel(), action[-3:].ravel()])
        np.testing.assert_allclose(futures[k], following, atol=1e-12)
        observation, action = np.concatenate([observation, following[None]]), np.concatenate([action, np.zeros((1, 1))])


def test_what_is_missing_is_held_within_its_trajectory() -> None:
    trajectories = made([4, 3])
    observation = trajectories.observation.copy()
    observation[[0, 2, 4, 5]] = np.nan
    held = hold_last(trajectories.with_observation(observation), np.array([7.0, 8.0]))
    np.testing.assert_array_equal(held[0], [7.0, 8.0])
    np.testing.assert_array_equal(held[2], observation[1])
    np.testing.assert_array_equal(held[4:6], [[7.0, 8.0]] * 2)
    np.testing.assert_array_equal(held[[1, 3, 6]], observation[[1, 3, 6]])
