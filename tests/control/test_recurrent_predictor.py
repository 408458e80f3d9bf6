import numpy as np
import pytest

from predplan.control.prediction import normalised_error
from predplan.control.recurrent_predictor import RecurrentPredictor, RecurrentSettings, train_recurrent
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError
from tests.control.systems import example, kalman_predictions, simulate

SETTINGS = RecurrentSettings(hidden=8, epochs=60, rows=20)


@pytest.fixture(scope="module")
def data() -> Trajectories:
    return simulate(example(), 150, 30, np.random.default_rng(0), 0.2)


@pytest.fixture(scope="module")
def model(data: Trajectories) -> RecurrentPredictor:
    return train_recurrent(data, SETTINGS, np.random.default_rng(1))


def test_it_learns_most_of_what_can_be_foretold(model: RecurrentPredictor) -> None:
    held_out = simulate(example(), 100, 30, np.random.default_rng(2), 0.2)
    exact = kalman_predictions(example(), held_out)
    rows, variance = held_out.seen & (held_out.age >= 10), np.nanvar(held_out.observation, axis=0)
    best, found = (
        normalised_error(one, held_out.observation, rows, variance) for one in (exact, model.predict(held_out))
    )
    assert best < found < best + 0.3 * (1 - best)


@pytest.mark.parametrize("ahead", [1, 3])
def test_predictions_use_what_came_up_to_so_many_rows_before(
    model: RecurrentPredictor, data: Trajectories, ahead: int
) -> None:
    some = data.take(np.arange(3))
    plain = model.predict(some, ahead)
    for row in (5, 35, 70):
        later = some.observation.copy()
        later[row] = 9.0
        changed = np.abs(model.predict(some.with_observation(later), ahead) - plain).max(axis=1) > 1e-7
        assert not changed[: row + ahead].any()
        assert changed[row + ahead]
        assert not changed[30 * (row // 30 + 1) :].any()
    assert np.isnan(plain[: ahead - 1]).all()
    assert np.isfinite(plain[ahead - 1 : 30]).all()


def test_several_steps_ahead_it_takes_its_own_word(model: RecurrentPredictor) -> None:
    """With predictions in place of what was seen, the next one is that of two steps ahead."""
    some = simulate(example(), 4, 12, np.random.default_rng(3))
    one, two = model.predict(some), model.predict(some, 2)
    for row in (4, 17, 30):
        replaced = some.observation.copy()
        replaced[row] = one[row]
        np.testing.assert_allclose(model.predict(some.with_observation(replaced))[row + 1], two[row + 1], atol=1e-5)


def test_same_seed_same_predictions(data: Trajectories) -> None:
    some = data.take(np.arange(20))
    quick = RecurrentSettings(hidden=4, epochs=3)
    first, second = (train_recurrent(some, quick, np.random.default_rng(4)).predict(some) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_bad_settings_are_said(data: Trajectories) -> None:
    with pytest.raises(InputError, match="expected at least 2"):
        train_recurrent(data.take(np.array([0])), SETTINGS, np.random.default_rng(5))
