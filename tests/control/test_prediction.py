import numpy as np
import pytest

from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings, fit_innovation
from predplan.control.prediction import baseline_errors, filter_errors, predict_ahead
from tests.control.systems import exact_filter, example, simulate


@pytest.mark.parametrize("ahead", [1, 2, 5])
def test_several_steps_ahead_is_the_filter_without_what_came_between(ahead: int) -> None:
    system = example()
    data = simulate(system, 3, 12, np.random.default_rng(0), 0.2)
    model = exact_filter(system)
    found = predict_ahead(model, data, ahead)
    for first, end in zip(data.first[:-1], data.first[1:], strict=True):
        for t in range(first, end):
            if t - first < ahead - 1:
                assert np.isnan(found[t]).all()
                continue
            observation = data.observation.copy()
            observation[t - ahead + 1 : t] = np.nan
            expected = filter_trajectories(model, data.with_observation(observation)).prediction[t]
            np.testing.assert_allclose(found[t], expected, atol=1e-12)


@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_a_learned_filter_beats_every_autoregression_on_a_noisy_system(drop: float) -> None:
    system = example()
    training, held_out = (simulate(system, 200, 50, np.random.default_rng(seed), drop) for seed in (1, 2))
    truth = simulate(system, 200, 50, np.random.default_rng(2)).observation
    variance = truth.var(axis=0)
    errors = baseline_errors(training, held_out, truth, variance)
    model = fit_innovation(training, InnovationSettings(past=15, future=8, dimension=3))
    found = filter_errors("learned", model, held_out, truth, variance, (1, 3))
    assert [one.predictor for one in errors] == ["last", *(f"order {order}" for order in (1, 2, 5, 10, 20))]
    assert found[0].error < min(one.error for one in errors)
    assert found[1].error > found[0].error
    assert found[0].rows == errors[0].rows
