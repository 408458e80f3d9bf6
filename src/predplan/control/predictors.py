"""All predictors on one task's held-out trajectories: the table of prediction errors of one condition."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from predplan.control.autoregression import (
    Autoregression,
    fit_autoregression,
    hold_last,
    predict_next,
    standardise,
    window_moments,
)
from predplan.control.bounds import check_number, check_whole
from predplan.control.correction import CorrectionSettings, fit_correction
from predplan.control.filtering import PredictiveModel
from predplan.control.innovation import InnovationSettings, fit_innovation
from predplan.control.kernel_psr import KernelSettings, fit_kernel
from predplan.control.prediction import ORDERS, PredictionError, normalised_error, predict_ahead
from predplan.control.recurrent_predictor import RecurrentSettings, train_recurrent
from predplan.control.refinement import RefinementSettings, fit_refined
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError

Predict = Callable[[Trajectories, int], FloatArray]
"""Predictions [n, O] of each row from what came up to so many rows before; NaN where there is none."""


@dataclass(frozen=True)
class PredictorSettings:
    """Which predictors are compared, and how each is learned; None leaves one out."""

    innovation: InnovationSettings = field(default_factory=InnovationSettings)
    refinement: RefinementSettings | None = field(default_factory=RefinementSettings)
    kernel: KernelSettings | None = field(default_factory=KernelSettings)
    correction: CorrectionSettings | None = field(default_factory=CorrectionSettings)  # of the refined filter
    recurrent: RecurrentSettings | None = field(default_factory=RecurrentSettings)
    orders: tuple[int, ...] = ORDERS
    lam: float = 1e-8  # of the autoregressions' ridge
    steps: tuple[int, ...] = (1, 5, 10)  # ahead
    least_age: int = 10  # of the rows that are compared

    def __post_init__(self) -> None:
        for name in ("orders", "steps"):
            values = getattr(self, name)
            if not all(isinstance(value, int) and value > 0 for value in values):
                raise InputError(f"{name}: found {values}, expected whole numbers above 0")
        check_number(self, "lam", least=0)
        check_whole(self, "least_age", least=0)
        if self.correction and not self.refinement:
            raise InputError("correction: it is of the refined filter; expected refinement as well, found None")


def prediction_table(
    training: Trajectories,
    held_out: Trajectories,
    truth: FloatArray,
    variance: FloatArray,
    settings: PredictorSettings,
    generator: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> list[PredictionError]:
    """Errors of every predictor learned from training, on held_out, both observed alike; progress is told its name.

    truth [n, O] is what a perfect sensor would have seen of held_out, variance [O] the exploration's. An order above
    least_age has fewer rows than the others: there the last filter's error on its rows follows, under "... at order K".
    """
    errors: list[PredictionError] = []
    late: list[tuple[str, int, np.ndarray]] = []
    name, predict = "", _last(training)
    for name, predict in predictors(training, settings, generator):
        if progress:
            progress(name)
        for ahead in settings.steps:
            rows = held_out.age >= settings.least_age + ahead - 1
            prediction = predict(held_out, ahead)
            there = rows & np.isfinite(prediction).all(axis=1)
            if not there.any():
                continue
            errors.append(_error(name, ahead, prediction, truth, there, variance))
            if there.sum() < rows.sum():
                late.append((name, ahead, there))
    for order, ahead, there in late:
        errors.append(_error(f"{name} at {order}", ahead, predict(held_out, ahead), truth, there, variance))
    return errors


def predictors(
    training: Trajectories, settings: PredictorSettings, generator: np.random.Generator
) -> Iterator[tuple[str, Predict]]:
    """Names and predictors, each learned when it is its turn, with a generator of its own; filters come last."""
    kernel, recurrent, refinement, correction = generator.spawn(4)
    yield "last", _last(training)
    standard = standardise(training)
    filled = training.with_observation(hold_last(training, standard.shift))
    for order in settings.orders:
        if order < training.lengths.max():
            model = fit_autoregression(*window_moments(filled, order, standard), standard, settings.lam)
            yield f"order {order}", _regression(model, order)
    if settings.recurrent:
        yield "gru", train_recurrent(training, settings.recurrent, recurrent).predict
    if settings.kernel:
        yield "kernel", _filter(fit_kernel(training, settings.kernel, kernel))
    yield "innovation", _filter(fit_innovation(training, settings.innovation))
    if settings.refinement:
        found = fit_refined(training, settings.innovation, settings.refinement, refinement)
        yield "innovation refined", _filter(found.model)
        if settings.correction:
            corrected = fit_correction(found.model, training, settings.correction, correction)
            yield "innovation corrected", _filter(corrected)


def _last(training: Trajectories) -> Predict:
    """The last observation seen."""
    shift = standardise(training).shift

    def predict(held_out: Trajectories, ahead: int) -> FloatArray:
        held = np.roll(hold_last(held_out, shift), ahead, axis=0)
        return np.where((held_out.age >= ahead)[:, None], held, np.nan)

    return predict


def _regression(model: Autoregression, order: int) -> Predict:
    """Nothing is predicted of trajectories that are all too short for it."""

    def predict(held_out: Trajectories, ahead: int) -> FloatArray:
        if held_out.lengths.max() < order + ahead:
            return np.full_like(held_out.observation, np.nan)
        return predict_next(model, held_out, ahead)

    return predict


def _filter(model: PredictiveModel) -> Predict:
    return partial(predict_ahead, model)


def _error(
    name: str, ahead: int, prediction: FloatArray, truth: FloatArray, rows: np.ndarray, variance: FloatArray
) -> PredictionError:
    return PredictionError(name, ahead, normalised_error(prediction, truth, rows, variance), int(rows.sum()))
