from dataclasses import replace

import numpy as np
import pytest

from predplan.control.correction import CorrectionSettings, fit_correction
from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings, fit_innovation
from predplan.control.prediction import predict_ahead
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError
from tests.control.systems import example, simulate

SETTINGS = CorrectionSettings(frequencies=60)
INNOVATION = InnovationSettings(past=8, future=4, dimension=3)


def bent(trajectories: int, seed: int, share: float = 0.5) -> Trajectories:
    """Observations to which a nonlinear function of what the system does is added."""
    data = simulate(example(), trajectories, 30, np.random.default_rng(seed), 0.1)
    return data.with_observation(data.observation + share * np.cos(1.5 * data.action) * [1.0, -1.0])


def error(model: object, data: Trajectories) -> float:
    prediction = filter_trajectories(model, data).prediction  # type: ignore[arg-type]
    rows = data.seen & (data.age >= 5)
    return float(np.mean((prediction - data.observation)[rows] ** 2))


def test_what_is_nonlinear_is_learned_and_states_stay() -> None:
    data, held_out = bent(150, 0), bent(100, 1)
    model = fit_innovation(data, INNOVATION)
    corrected = fit_correction(model, data, SETTINGS, np.random.default_rng(2))
    assert error(corrected, held_out) < 0.8 * error(model, held_out)
    np.testing.assert_array_equal(
        filter_trajectories(corrected, held_out).after, filter_trajectories(model, held_out).after
    )
    several = predict_ahead(corrected, held_out, 3)
    assert np.isfinite(several[held_out.age >= 2]).all()


def test_where_all_is_linear_hardly_anything_is_added() -> None:
    data, held_out = bent(100, 3, 0.0), bent(100, 4, 0.0)
    model = fit_innovation(data, INNOVATION)
    corrected = fit_correction(model, data, SETTINGS, np.random.default_rng(5))
    assert error(corrected, held_out) < 1.01 * error(model, held_out)


def test_what_is_added_is_bounded_wherever_states_go() -> None:
    data = bent(60, 6)
    model = fit_innovation(data, INNOVATION)
    corrected = fit_correction(model, data, SETTINGS, np.random.default_rng(7))
    most = np.abs(corrected.weights).sum(axis=0) * model.scale
    state = corrected.initial(50)
    far = replace(state, mean=1e3 * np.random.default_rng(8).standard_normal(state.mean.shape))
    action = np.ones((50, 1))
    added = corrected.predict(far, action) - model.predict(far, action)
    assert (np.abs(added) <= most * (1 + 1e-9)).all()


def test_same_seed_same_weights_and_bad_settings_are_said() -> None:
    data = bent(30, 9)
    model = fit_innovation(data, INNOVATION)
    first, second = (fit_correction(model, data, SETTINGS, np.random.default_rng(10)).weights for _ in range(2))
    assert first.tobytes() == second.tobytes()
    with pytest.raises(InputError, match="no observation 99 rows"):
        fit_correction(model, data, replace(SETTINGS, least_age=99), np.random.default_rng(11))
