"""Learning curves by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from predplan.control.curves import learning_curves


def made_row(seed: int, steps: int, value: float | None, **changed: Any) -> dict[str, Any]:
    row = {"task": "hopper", "noise": 0.0, "drop": 0.3, "method": "fm2", "seed": seed, "steps": steps}
    return row | {"return_mean": value, "prediction_error": value} | changed


def test_means_and_errors_over_runs() -> None:
    rows = [made_row(seed, steps, value) for seed in (0, 1) for steps, value in ((0, 2.0 * seed), (100, 4.0 * seed))]
    curve = learning_curves(rows)["hopper", 0.0, 0.3]["fm2"]
    assert (curve.seeds, curve.steps[0], curve.steps[-1]) == (2, 0.0, 100.0)
    np.testing.assert_allclose(curve.mean[[0, 50, 100]], [1.0, 1.5, 2.0])
    np.testing.assert_allclose(curve.error[[0, 50, 100]], [1.0, 1.5, 2.0])


def test_unknown_numbers_are_bridged() -> None:
    rows = [made_row(0, 0, 0.0), made_row(0, 50, None), made_row(0, 75, float("nan")), made_row(0, 100, 1.0)]
    curve = learning_curves(rows)["hopper", 0.0, 0.3]["fm2"]
    np.testing.assert_allclose(curve.mean, np.linspace(0.0, 1.0, 101))
    np.testing.assert_array_equal(curve.error, 0.0)


def test_a_run_that_ended_early_is_not_spared() -> None:
    rows = [made_row(0, steps, 10.0) for steps in (0, 100)] + [made_row(1, 0, 2.0), made_row(1, 40, 50.0)]
    returns = learning_curves(rows)["hopper", 0.0, 0.3]["fm2"]
    assert returns.mean[-1] == 6.0
    errors = learning_curves(rows, "prediction_error")["hopper", 0.0, 0.3]["fm2"]
    assert errors.mean[-1] == 10.0


def test_methods_without_numbers_are_left_out() -> None:
    rows = [made_row(0, 0, 1.0), made_row(0, 0, None, method="gru")]
    assert list(learning_curves(rows)["hopper", 0.0, 0.3]) == ["fm2"]
    assert learning_curves([made_row(0, 0, None)]) == {}
