import numpy as np
import pytest

from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings
from predplan.control.prediction import predict_ahead
from predplan.control.predictors import PredictorSettings, learn_predictors, prediction_table
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
    settings = PredictorSettings(
        innovation=InnovationSettings(past=15, future=8, dimension=3),
        refinement=None,
        correction=None,
        kernel=None,
        recurrent=None,
        steps=(1, 3),
    )
    predictors = list(learn_predictors(training, settings, np.random.default_rng(3)))
    errors = {
        (one.predictor, one.steps): one
        for one in prediction_table(predictors, held_out, truth, truth.var(axis=0), settings)
    }
    names = ["last", *(f"order {order}" for order in (1, 2, 5, 10, 20)), "innovation"]
    assert [one.name for one in predictors] == names
    assert errors["innovation", 1].error < min(errors[name, 1].error for name in names[:-1])
    assert errors["innovation", 3].error > errors["innovation", 1].error
    assert errors["innovation", 1].rows == errors["last", 1].rows
