"""A GRU that foretells observations: what a network of the same memory makes of the same data.

    h_t = GRU([ō_{t-1}, ō_{t-1} - ō_{t-2}, seen_{t-1}, a_t], h_{t-1}),    ô_t = ō_{t-1} + W h_t + b

ō is the last observation seen. All is standardised, increments by their own spread, and what is learned is an
increment: without this a GRU predicts noiseless positions ten times worse. It is trained by Adam on pieces of
trajectories, halving its rate and stopping where it no longer improves on trajectories held out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from predplan.control.autoregression import hold_last, standardise
from predplan.control.bounds import check_number, check_whole
from predplan.control.pieces import Pieces, cut
from predplan.control.refinement import hold_out
from predplan.control.tasks import FloatArray, IntArray
from predplan.control.trajectories import Trajectories


@dataclass(frozen=True)
class RecurrentSettings:
    """How the GRU is trained."""

    hidden: int = 64  # units
    epochs: int = 300  # at most
    rate: float = 3e-3  # of Adam, at first
    batch: int = 20  # pieces
    rows: int = 150  # of a piece
    clip: float = 1.0  # of the gradient's norm
    share: float = 0.2  # of trajectories, held out
    patience: int = 20  # epochs without a better one until the rate is halved; three times, then it ends

    def __post_init__(self) -> None:
        check_whole(self, "hidden", "epochs", "batch", "rows", "patience")
        check_number(self, "rate", above=0)
        check_number(self, "clip", above=0, finite=False)
        check_number(self, "share", above=0, below=1)


WARM = 10
"""Rows of a piece that goes on from another before its predictions count: its memory starts empty."""
HALVED = 3
"""Times that the rate is halved."""


class RecurrentPredictor(torch.nn.Module):
    """Predictions of what was learned, float32."""

    def __init__(self, actions: int, standard: tuple[FloatArray, FloatArray, FloatArray], hidden: int) -> None:
        """standard: shift and scale [O] of observations, and scale [O] of standardised increments."""
        super().__init__()
        shift, scale, increment = standard
        self.shift, self.scale = shift, scale
        self.increment = torch.from_numpy(increment.astype(np.float32))
        self.gru = torch.nn.GRU(2 * len(shift) + 1 + actions, hidden)
        self.out = torch.nn.Linear(hidden, len(shift))
        torch.nn.init.zeros_(self.out.weight)
        torch.nn.init.zeros_(self.out.bias)

    def forward(self, held: Tensor, seen: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Predictions [T, n, O], standardised, and hidden states [T, n, H], each after its row's inputs.

        held [T, n, O] is the last observation before each row, standardised; seen [T, n]: the row before has one.
        """
        step = torch.cat([torch.zeros_like(held[:1]), held[1:] - held[:-1]])
        states, _ = self.gru(self._inputs(held, step, seen, action))
        return held + self.out(states) * self.increment, states

    def predict(self, trajectories: Trajectories, ahead: int = 1) -> FloatArray:
        """Predictions [n, O] of each row from what came up to `ahead` rows before it; NaN in a trajectory's first rows.

        Several steps ahead its own predictions stand for what was not yet seen, and the actions between are known.
        """
        pieces = cut(trajectories, int(trajectories.lengths.max()), self.shift, self.scale)
        held, seen, action = self.inputs(trajectories, pieces)
        with torch.no_grad():
            found, states = self(held, seen, action)
            step = found - held
            state = states.reshape(1, -1, states.shape[2])
            found, step = (one.reshape(1, -1, one.shape[2]) for one in (found, step))
            for extra in range(1, ahead):
                later = torch.roll(action, -extra, dims=0).reshape(1, -1, action.shape[2])
                inputs = self._inputs(found, step, torch.ones(1, found.shape[1]), later)
                _, state = self.gru(inputs, state)
                step = self.out(state) * self.increment
                found = found + step
        flat = found.reshape(held.shape).numpy().astype(np.float64) * self.scale + self.shift
        result = np.full_like(trajectories.observation, np.nan)
        for e, (first, length) in enumerate(zip(trajectories.first[:-1], trajectories.lengths, strict=True)):
            result[first + ahead - 1 : first + length] = flat[: max(length - ahead + 1, 0), e]
        return result

    def inputs(self, trajectories: Trajectories, pieces: Pieces) -> tuple[Tensor, Tensor, Tensor]:
        """held, seen and action, as `forward` takes them; before a trajectory's first row the mean was held, unseen."""
        start = (trajectories.age == 0)[:, None]
        held = (hold_last(trajectories, self.shift) - self.shift) / self.scale
        held = np.where(start, 0.0, np.roll(held, 1, axis=0))
        seen = ~start[:, 0] & np.roll(trajectories.seen, 1)
        parts = (held[pieces.rows], seen[pieces.rows], trajectories.action[pieces.rows])
        first, second, third = (torch.from_numpy(part.astype(np.float32)) for part in parts)
        return first, second, third

    def _inputs(self, held: Tensor, step: Tensor, seen: Tensor, action: Tensor) -> Tensor:
        return torch.cat([held, step / self.increment, seen[..., None], action], dim=2)


def train_recurrent(
    trajectories: Trajectories,
    settings: RecurrentSettings,
    generator: np.random.Generator,
) -> RecurrentPredictor:
    """Train the GRU. Raises InputError as `hold_out`."""
    training, held_out = hold_out(trajectories, settings.share, generator)
    model = _fresh(training, settings, generator)
    learning, judging = (_batch(model, one, settings.rows) for one in (training, held_out))
    optimiser = torch.optim.Adam(model.parameters(), settings.rate)
    best, lowest, waited, halved = _copy(model), np.inf, 0, 0
    for _ in range(settings.epochs):
        order = generator.permutation(learning.held.shape[1])
        for chosen in np.array_split(order, -(-len(order) // settings.batch)):
            loss = learning.take(chosen).loss(model)
            optimiser.zero_grad()
            torch.autograd.backward(loss)
            norm = torch.nn.utils.clip_grad_norm_(model.parameters(), settings.clip)
            if torch.isfinite(norm):
                optimiser.step()
        with torch.no_grad():
            error = float(judging.loss(model))
        waited += 1
        if error < lowest:
            best, lowest, waited = _copy(model), error, 0
        if waited >= settings.patience:
            if halved == HALVED:
                break
            model.load_state_dict(best)
            halved, waited = halved + 1, 0
            optimiser = torch.optim.Adam(model.parameters(), settings.rate * 0.5**halved)
    model.load_state_dict(best)
    return model


@dataclass(frozen=True)
class _Batch:
    held: Tensor  # [T, n, O]
    seen: Tensor  # [T, n]
    action: Tensor  # [T, n, A]
    target: Tensor  # [T, n, O], 0 where it does not count
    counts: Tensor  # [T, n]
    increment: Tensor  # [O]

    def take(self, which: IntArray) -> _Batch:
        """Those pieces."""
        one = torch.from_numpy(which)
        inputs = (self.held[:, one], self.seen[:, one], self.action[:, one])
        return _Batch(*inputs, self.target[:, one], self.counts[:, one], self.increment)

    def loss(self, model: RecurrentPredictor) -> Tensor:
        """Mean square error in units of increments' variance, averaged over coordinates."""
        prediction, _ = model(self.held, self.seen, self.action)
        error = (prediction - self.target) / self.increment.mean()
        mean: Tensor = (error**2 * self.counts[..., None]).sum() / (self.counts.sum() * len(self.increment))
        return mean


def _batch(model: RecurrentPredictor, trajectories: Trajectories, rows: int) -> _Batch:
    pieces = cut(trajectories, rows, model.shift, model.scale)
    warm = pieces.age - pieces.age[0] >= torch.where(pieces.age[0] > 0, WARM, 0)
    counts = pieces.seen & warm & (pieces.age > 0)
    target = torch.where(counts[..., None], pieces.observation, 0.0)
    inputs = model.inputs(trajectories, pieces)
    return _Batch(*inputs, target.float(), counts.float(), model.increment)


def _fresh(
    trajectories: Trajectories, settings: RecurrentSettings, generator: np.random.Generator
) -> RecurrentPredictor:
    standard = standardise(trajectories)
    held = standard(hold_last(trajectories, standard.shift))
    steps = np.diff(held, axis=0)[trajectories.age[1:] > 0]
    spread = np.maximum(steps.std(axis=0), 1e-6)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(generator.integers(2**31)))
        actions = trajectories.action.shape[1]
        return RecurrentPredictor(actions, (standard.shift, standard.scale, spread), settings.hidden)


def _copy(model: RecurrentPredictor) -> dict[str, Tensor]:
    return {name: values.clone() for name, values in model.state_dict().items()}
