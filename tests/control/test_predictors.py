from dataclasses import replace

import numpy as np
import pytest

from predplan.control.autoregression import fit_autoregression, predict_next, standardise, window_moments
from predplan.control.innovation import InnovationSettings, suited
from predplan.control.kernel_psr import KernelSettings
from predplan.control.prediction import PredictionError
from predplan.control.predictors import PredictorSettings, learn_predictors, prediction_table
from predplan.control.recurrent_predictor import RecurrentSettings
from predplan.control.refinement import RefinementSettings
from tests.control.systems import example, simulate

SETTINGS = PredictorSettings(
    innovation=InnovationSettings(past=5, future=4, dimension=3),
    refinement=RefinementSettings(epochs=15),
    correction=None,
    kernel=KernelSettings(past=4, future=3, dimension=5, frequencies=40),
    recurrent=RecurrentSettings(hidden=4, epochs=2),
    orders=(2, 12, 40),
    steps=(1, 3),
)


def table(settings: PredictorSettings, drop: float = 0.2) -> list[PredictionError]:
    training, held_out = (simulate(example(), 80, 25, np.random.default_rng(seed), drop) for seed in (1, 2))
    truth = simulate(example(), 80, 25, np.random.default_rng(2)).observation
    predictors = list(learn_predictors(training, settings, np.random.default_rng(3)))
    return prediction_table(predictors, held_out, truth, truth.var(axis=0), settings)


def test_every_predictor_has_its_rows_and_the_refined_filter_is_better() -> None:
    errors = table(SETTINGS)
    names = ["last", "order 2", "order 12", "gru", "kernel", "innovation", "innovation refined"]
    late = "innovation refined at order 12"
    assert [one.predictor for one in errors] == [name for name in names for _ in range(2)] + [late] * 2
    assert [one.steps for one in errors] == [1, 3] * 8
    found = {(one.predictor, one.steps): one for one in errors}
    assert found["last", 1].rows == found["gru", 1].rows == found["innovation", 1].rows == 80 * 15
    assert found["order 12", 1].rows == found[late, 1].rows == 80 * 13
    for steps in (1, 3):
        others = [one.error for one in errors if one.steps == steps and "innovation" not in one.predictor]
        assert found["innovation refined", steps].error < min(others)
        assert found[late, steps].error < found["order 12", steps].error


def test_what_is_left_out_changes_nothing_else() -> None:
    few = table(replace(SETTINGS, kernel=None, recurrent=None))
    assert set(few) < set(table(SETTINGS))


@pytest.mark.parametrize("ahead", [1, 4])
def test_autoregressions_several_steps_ahead_do_not_look_there(ahead: int) -> None:
    data = simulate(example(), 20, 15, np.random.default_rng(4))
    standard = standardise(data)
    model = fit_autoregression(*window_moments(data, 3, standard), standard, 1e-8)
    plain = predict_next(model, data, ahead)
    assert np.isnan(plain[: 3 + ahead - 1]).all()
    assert np.isfinite(plain[3 + ahead - 1 : 15]).all()
    later = data.observation.copy()
    later[5] = 9.0
    changed = np.abs(predict_next(model, data.with_observation(later), ahead) - plain)[3 + ahead - 1 : 15].max(axis=1)
    assert np.flatnonzero(changed > 1e-9)[0] + 3 + ahead - 1 == 5 + ahead


def test_tasks_have_their_settings() -> None:
    assert suited("walker2d", 8) == InnovationSettings(past=8, future=5, dimension=16)
    assert suited("Ant-v5", 13).dimension == 26
