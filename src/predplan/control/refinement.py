"""Refinement of a linear filter by gradients through time (BPTT), its parameters fitted to what it predicts.

Two-stage regression makes the filter's one-step map right on states of stage 1; refinement makes its predictions
right on the states that it has itself. The loss is the mean square error of predictions of what was seen, each
coordinate over its variance, each row as much as it can be foretold at its age: S's trace over S_t's. Gains are those
of the parameters at every step, and gradients go through their recursion too (`riccati`): taken as constants, they
point elsewhere where trajectories are shorter than gains take to settle.

Adam needs hundreds of epochs here and breaks where observations are nearly exact; descent by L-BFGS in natural
coordinates needs tens of a few ms each. A step that would not be finite, or whose filter would not forget (spectral
radius of A - K C from 1 on), is rejected and counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from predplan.control.bounds import check_number, check_whole
from predplan.control.coordinates import ALL, Coordinates
from predplan.control.descent import DescentSettings, Step, descend
from predplan.control.differentiable import LEARNED, filter_rows
from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings, fit_innovation
from predplan.control.linear_filter import LinearFilter, radius
from predplan.control.pieces import cut
from predplan.control.riccati import differentiable_gains
from predplan.control.tasks import BoolArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError

SAME_STARTS = 5
"""Epochs for which pieces of trajectories start in the same states: each change costs an evaluation."""


@dataclass(frozen=True)
class RefinementSettings:
    """How far to refine."""

    epochs: int = 40  # steps at most, each from all of the data
    rows: int = 150  # through which gradients go back
    share: float = 0.2  # of trajectories, held out to say when to stop
    patience: int = 15  # epochs without a better one on what is held out
    least_age: int = 5  # of the rows that count; younger ones would draw the filter to what no filter can know yet
    descent: DescentSettings = field(default_factory=DescentSettings)

    def __post_init__(self) -> None:
        check_whole(self, "rows", "patience")
        check_whole(self, "epochs", "least_age", least=0)
        check_number(self, "share", above=0, below=1)


@dataclass(frozen=True)
class Epoch:
    """One step; the first is the start."""

    epoch: int
    training: float  # loss, over the start's
    validation: float  # loss on what was held out, over the start's
    slope: float  # norm of the gradient in natural coordinates; NaN at the start
    rejected: int  # steps tried that were not finite or did not forget


@dataclass(frozen=True)
class Refinement:
    """What came of it."""

    model: LinearFilter
    best: int  # the epoch that was taken
    curve: tuple[Epoch, ...]

    @property
    def rejected(self) -> int:
        """Steps tried in all that were not finite or did not forget."""
        return sum(epoch.rejected for epoch in self.curve)


def refine(
    model: LinearFilter,
    trajectories: Trajectories,
    settings: RefinementSettings,
    generator: np.random.Generator,
) -> Refinement:
    """The filter of the epoch that predicts best what was held out, the start among them.

    To be told the truth by what is held out, `model` must not have been learned from it: `fit_refined` sees to that.
    Raises InputError for fewer than two trajectories.
    """
    training, held_out = hold_out(trajectories, settings.share, generator)
    return _refine(model, training, held_out, settings)


def fit_refined(
    trajectories: Trajectories,
    innovation: InnovationSettings,
    settings: RefinementSettings,
    generator: np.random.Generator,
) -> Refinement:
    """Learn by regression and refine, with all trajectories in the end.

    What is held out says how many epochs are best for a filter learned and refined without it. A filter learned from
    everything is then refined so far: it had 1 / (1 - share) times the data. The curve is the first one's.
    Raises InputError as `fit_innovation` and `refine`.
    """
    training, held_out = hold_out(trajectories, settings.share, generator)
    found = _refine(fit_innovation(training, innovation), training, held_out, settings)
    start = fit_innovation(trajectories, innovation)
    models = [start, *(model for model, _ in islice(_epochs(start, trajectories, settings), found.best))]
    return replace(found, model=_Loss(start, trajectories, settings).sized(models[-1]))


def hold_out(
    trajectories: Trajectories, share: float, generator: np.random.Generator
) -> tuple[Trajectories, Trajectories]:
    """All but a share of the trajectories, and that share; each has at least one. Raises InputError for fewer."""
    count = len(trajectories.lengths)
    if count < 2:
        raise InputError(f"trajectories: found {count}, expected at least 2, of which one is held out")
    order, kept = generator.permutation(count), min(max(1, round(share * count)), count - 1)
    return trajectories.take(np.sort(order[kept:])), trajectories.take(np.sort(order[:kept]))


def _refine(
    model: LinearFilter,
    training: Trajectories,
    held_out: Trajectories,
    settings: RefinementSettings,
) -> Refinement:
    judge = _Loss(model, held_out, settings)
    start = judge.of(model)
    best, lowest, curve = 0, 1.0, [Epoch(0, 1.0, 1.0, float("nan"), 0)]
    for number, (candidate, step) in enumerate(_epochs(model, training, settings), 1):
        epoch = Epoch(number, step.value, judge.of(candidate) / start, step.slope, step.undefined)
        curve.append(epoch)
        if epoch.validation < lowest:
            best, lowest, model = number, epoch.validation, candidate
        if number - best >= settings.patience:
            break
    return Refinement(_Loss(model, training, settings).sized(model), best, tuple(curve))


def _epochs(
    model: LinearFilter, trajectories: Trajectories, settings: RefinementSettings
) -> Iterator[tuple[LinearFilter, Step]]:
    """The filter after each step."""
    coordinates, loss = Coordinates(model), _Loss(model, trajectories, settings)
    start, bound = loss.of(model), max(1.0, radius(model))
    known: dict[int, tuple[float, Tensor] | None] = {}

    def evaluate(point: Tensor) -> tuple[float, Tensor] | None:
        if id(point) not in known:
            known.clear()
            known[id(point)] = _value_and_gradient(point)
        return known[id(point)]

    def _value_and_gradient(point: Tensor) -> tuple[float, Tensor] | None:
        with np.errstate(all="ignore"):
            if not radius(coordinates.model(point)) < bound:
                return None
        point = point.clone().requires_grad_()
        value = loss(coordinates.parameters(point)) / start
        (gradient,) = torch.autograd.grad(value, point)
        if not (torch.isfinite(value) and torch.isfinite(gradient).all()):
            return None
        return float(value.detach()), gradient

    origin = torch.zeros(coordinates.size, dtype=torch.float64)
    for number, step in enumerate(islice(descend(evaluate, origin, settings.descent), settings.epochs), 1):
        model = coordinates.model(step.point)
        if number % SAME_STARTS == 0 and loss.go_on_from(model):
            known.clear()
        yield model, step


class _Loss:
    """Mean square error of what a filter predicts of trajectories, as far as it could be foretold at the start."""

    def __init__(self, model: LinearFilter, trajectories: Trajectories, settings: RefinementSettings) -> None:
        self._pieces = cut(trajectories, settings.rows, model.shift, model.scale)
        self._trajectories, self._limit = trajectories, model.limit
        self._goes_on = bool((trajectories.age[self._pieces.first] > 0).any())
        self._start = torch.zeros(len(self._pieces.first), model.state_size, dtype=torch.float64)
        self.go_on_from(model)
        every_age = np.ones((1, int(trajectories.lengths.max())), np.bool_)
        foretold = _gains(_tensors(model), every_age)[1][0].diagonal(dim1=1, dim2=2).sum(dim=1)
        foretold[: min(settings.least_age, len(foretold) - 1)] = torch.inf
        weight = (float(np.trace(model.S)) / foretold)[self._pieces.age][self._pieces.seen]
        self._weight = weight / (weight.sum() * len(model.S))

    def __call__(self, parameters: dict[str, Tensor]) -> Tensor:
        """Of parameters by name."""
        error, _ = self._errors(parameters)
        return (self._weight[:, None] * error**2).sum()

    def of(self, model: LinearFilter) -> float:
        """Of a filter. Pieces start where it goes on from."""
        self.go_on_from(model)
        return float(self(_tensors(model)))

    def go_on_from(self, model: LinearFilter) -> bool:
        """Start pieces that are not a trajectory's first in this filter's states; whether there are any."""
        if self._goes_on:
            states = filter_trajectories(model, self._trajectories).state[self._pieces.first]
            self._start = torch.from_numpy(states)
        return self._goes_on

    def sized(self, model: LinearFilter) -> LinearFilter:
        """The filter with S and P_0 times one number, which makes e' S_t⁻¹ e right on average. Gains do not change."""
        error, total = self._errors(_tensors(model))
        square = (error * torch.linalg.solve(total, error)).sum(dim=1).mean()
        factor = float(square) / error.shape[1]
        return replace(model, S=factor * model.S, initial_covariance=factor * model.initial_covariance)

    def _errors(self, parameters: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Innovations [s, O] of the rows that were seen, and S_t [s, O, O]."""
        pieces = self._pieces
        gain, total = _gains(parameters, pieces.ways)
        gain = gain[pieces.way, pieces.age] * pieces.seen[..., None, None]
        # The recursion's own derivative by K is of gains that are constant beside it: here they are not.
        learned = {name: parameters[name] for name in LEARNED} | {"K": parameters["K"].detach()}
        given = (self._start, pieces.action, pieces.observation, gain, pieces.reset)
        before, _ = filter_rows(learned, given, self._limit)
        expected = before @ learned["C"].T + pieces.action @ learned["D"].T + learned["d"]
        error = (pieces.observation - expected)[pieces.seen]
        return error, total[pieces.way, pieces.age][pieces.seen]


def _gains(parameters: dict[str, Tensor], ways: BoolArray) -> tuple[Tensor, Tensor]:
    A, K, C, S, start = (parameters[name] for name in ("A", "K", "C", "S", "initial_covariance"))
    return differentiable_gains(A, K, C, S, start, ways)


def _tensors(model: LinearFilter) -> dict[str, Tensor]:
    return {name: torch.from_numpy(np.array(getattr(model, name), np.float64)) for name in ALL}
