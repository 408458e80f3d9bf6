"""All predictors of one condition: learned from a task's exploration, compared on trajectories held out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
from predplan.control.prediction import PredictionError, normalised_error, predict_ahead
from predplan.control.recurrent_predictor import RecurrentSettings, train_recurrent
from predplan.control.refinement import RefinementSettings, fit_refined
from predplan.control.tasks import BoolArray, FloatArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError

Predict = Callable[[Trajectories, int], FloatArray]
"""Predictions [n, O] of each row from what came up to so many rows before; NaN where there is none."""


@dataclass(frozen=True)
class Predictor:
    """What was learned to predict."""

    name: str
    predict: Predict
    model: PredictiveModel | None = None  # where it is a filter


@dataclass(frozen=True)
class PredictorSettings:
    """Which predictors are compared, and how each is learned; None leaves one out."""

    innovation: InnovationSettings = field(default_factory=InnovationSettings)
    refinement: RefinementSettings | None = field(default_factory=RefinementSettings)
    kernel: KernelSettings | None = field(default_factory=KernelSettings)
    correction: CorrectionSettings | None = field(default_factory=CorrectionSettings)  # of the refined filter
    recurrent: RecurrentSettings | None = field(default_factory=RecurrentSettings)
    orders: tuple[int, ...] = (1, 2, 5, 10, 20)  # of autoregressions
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
    predictors: Sequence[Predictor],
    held_out: Trajectories,
    truth: FloatArray,
    variance: FloatArray,
    settings: PredictorSettings,
) -> list[PredictionError]:
    """Errors of every predictor on held_out, which was observed as what they were learned from.

    truth [n, O] is what a perfect sensor would have seen of held_out, variance [O] the exploration's. An order above
    least_age has fewer rows than the others: there the last predictor's error on its rows follows, under "... at order
    K".
    """
    errors: list[PredictionError] = []
    late: list[tuple[str, int, BoolArray]] = []
    for one in predictors:
        for ahead in settings.steps:
            rows = held_out.age >= settings.least_age + ahead - 1
            prediction = one.predict(held_out, ahead)
            there = rows & np.isfinite(prediction).all(axis=1)
            if not there.any():
                continue
            errors.append(_error(one.name, ahead, prediction, truth, there, variance))
            if there.sum() < rows.sum():
                late.append((one.name, ahead, there))
    last = predictors[-1]
    for order, ahead, there in late:
        errors.append(_error(f"{last.name} at {order}", ahead, last.predict(held_out, ahead), truth, there, variance))
    return errors


def learn_predictors(
    training: Trajectories, settings: PredictorSettings, generator: np.random.Generator
) -> Iterator[Predictor]:
    """Predictors, each learned when it is its turn, with a generator of its own; filters come last."""
    kernel, recurrent, refinement, correction = generator.spawn(4)
    yield Predictor("last", _last(training))
    standard = standardise(training)
    filled = training.with_observation(hold_last(training, standard.shift))
    for order in settings.orders:
        if order < training.lengths.max():
            model = fit_autoregression(*window_moments(filled, order, standard), standard, settings.lam)
            yield Predictor(f"order {order}", _regression(model, order))
    if settings.recurrent:
        yield Predictor("gru", train_recurrent(training, settings.recurrent, recurrent).predict)
    if settings.kernel:
        yield _filter("kernel", fit_kernel(training, settings.kernel, kernel))
    yield _filter("innovation", fit_innovation(training, settings.innovation))
    if settings.refinement:
        refined = fit_refined(training, settings.innovation, settings.refinement, refinement).model
        yield _filter("innovation refined", refined)
        if settings.correction:
            yield _filter("innovation corrected", fit_correction(refined, training, settings.correction, correction))


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


def _filter(name: str, model: PredictiveModel) -> Predictor:
    return Predictor(name, partial(predict_ahead, model), model)


def _error(
    name: str, ahead: int, prediction: FloatArray, truth: FloatArray, rows: BoolArray, variance: FloatArray
) -> PredictionError:
    return PredictionError(name, ahead, normalised_error(prediction, truth, rows, variance), int(rows.sum()))
