"""Policies: a Gaussian whose mean is a small network of the memory's features, and a value of its own beside it.

A recurrent policy has a gated recurrent unit (GRU) between features and networks. Everything here is float32.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from predplan.control.bounds import check_number, check_whole
from predplan.control.tasks import IntArray
from predplan.errors import InputError

SingleArray: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class NetworkSettings:
    """Sizes and starts."""

    hidden: tuple[int, ...] = (64, 64)
    recurrent: int = 0  # units of the GRU; 0: none
    log_deviation: float = -0.5  # of actions at the start
    prediction: float = 0.0  # weight of the error in foretelling the next features; 0: they are not foretold

    def __post_init__(self) -> None:
        if not all(isinstance(width, int) and width > 0 for width in self.hidden):
            raise InputError(f"hidden: found {self.hidden}, expected widths, whole numbers above 0")
        check_whole(self, "recurrent", least=0)
        check_number(self, "log_deviation")
        check_number(self, "prediction", least=0)


class ActorCritic(nn.Module):
    """Mean and log deviation of actions, and the expected return, of whitened features."""

    core: nn.GRU | None
    actor: nn.Sequential
    critic: nn.Sequential
    value_scale: Tensor

    def __init__(self, features: int, actions: int, settings: NetworkSettings, generator: torch.Generator) -> None:
        super().__init__()
        self.settings = settings
        width = settings.recurrent or features
        self.core = nn.GRU(features, settings.recurrent) if settings.recurrent else None
        self.actor = _layers(width, settings.hidden, actions)
        self.critic = _layers(width, settings.hidden, 1)
        self.predictor = nn.Linear(width + actions, features) if settings.prediction else None
        self.log_deviation = nn.Parameter(torch.full((actions,), settings.log_deviation))
        # Values are learned in units in which returns have mean 0 and deviation 1.
        self.register_buffer("value_scale", torch.tensor([0.0, 1.0]))
        _initialise(self, generator)

    def first_layers(self) -> list[tuple[Tensor, Tensor]]:
        """Weights and biases of what reads the features."""
        if self.core is not None:
            own: dict[str, Tensor] = dict(self.core.named_parameters())
            return [(own["weight_ih_l0"], own["bias_ih_l0"])]
        return [(one.weight, one.bias) for one in (_linear(self.actor)[0], _linear(self.critic)[0])]

    def initial(self, copies: int) -> Tensor:
        """The core's state [n, H] at an episode's start."""
        return torch.zeros(copies, self.settings.recurrent)

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """What actor and critic read [n, ...] of features [n, F], and the core's next state [n, H]."""
        if self.core is None:
            return features, state
        known, following = self.core(features[None], state[None].contiguous())
        return known[0], following[0]

    def unrolled(self, features: Tensor, pieces: Pieces, state: Tensor) -> Tensor:
        """The core's outputs [k, H], of the pieces' rows that are inside, of flat features [T n, F].

        state [n, H] is the core's before row 0 of the batch.
        """
        assert self.core is not None
        start = state[pieces.copy] * pieces.carried[:, None]
        result: Tensor = self.core(features[pieces.rows], start[None].contiguous())[0]
        return result[pieces.inside]

    def known(self, features: Tensor, begins: np.ndarray, state: Tensor) -> Tensor:
        """What actor and critic read [T, n, ...], of features [T, n, F] and begins [T, n]."""
        if self.core is None:
            return features
        length, n = begins.shape
        pieces = cut(begins, np.arange(n))
        unrolled = self.unrolled(features.reshape(length * n, -1), pieces, state)
        flat = torch.zeros(length * n, unrolled.shape[-1]).index_copy(0, pieces.rows[pieces.inside], unrolled)
        return flat.reshape(length, n, -1)

    def acting(self) -> Callable[[SingleArray], SingleArray]:
        """The actor, of arrays [n, ...] -> [n, A]: of few rows, torch's dispatch costs several times the products."""
        layers = [(one.weight.detach().numpy().T, one.bias.detach().numpy()) for one in _linear(self.actor)]

        def mean(known: SingleArray) -> SingleArray:
            for weight, bias in layers[:-1]:
                known = np.tanh(known @ weight + bias)
            weight, bias = layers[-1]
            result: SingleArray = known @ weight + bias
            return result

        return mean

    def values(self, known: Tensor) -> Tensor:
        """Expected return of each, in the task's units."""
        return self.scaled_values(known) * self.value_scale[1] + self.value_scale[0]

    def scaled_values(self, known: Tensor) -> Tensor:
        """The same with mean 0 and deviation 1."""
        value: Tensor = self.critic(known)[..., 0]
        return value

    @property
    def entropy(self) -> float:
        """Of the policy, nat."""
        actions = len(self.log_deviation)
        return float(self.log_deviation.detach().sum()) + 0.5 * actions * float(np.log(2.0 * np.pi * np.e))

    @torch.no_grad()
    def rescale_values(self, mean: float, deviation: float) -> None:
        """Change the units of values, the values staying as they are."""
        old_mean, old = (float(one) for one in self.value_scale)
        last = _linear(self.critic)[-1]
        last.weight *= old / deviation
        last.bias.copy_((old * last.bias + old_mean - mean) / deviation)
        self.value_scale.copy_(torch.tensor([mean, deviation]))


def log_probability(mean: Tensor, log_deviation: Tensor, action: Tensor) -> Tensor:
    """log N(action; mean, exp(log_deviation)²) [...] of [..., A]."""
    scaled = (action - mean) * torch.exp(-log_deviation)
    constant = 0.5 * np.log(2.0 * np.pi) * action.shape[-1]
    result: Tensor = -0.5 * (scaled**2).sum(-1) - log_deviation.sum() - constant
    return result


def divergence(mean: Tensor, log_deviation: Tensor, other: Tensor, other_log_deviation: Tensor) -> Tensor:
    """KL(N(mean) || N(other)) [...] of means [..., A]."""
    variance, other_variance = torch.exp(2.0 * log_deviation), torch.exp(2.0 * other_log_deviation)
    terms = (variance + (mean - other) ** 2) / (2.0 * other_variance) + other_log_deviation - log_deviation - 0.5
    return terms.sum(-1)


@dataclass(frozen=True)
class Pieces:
    """Rows of a batch [T, n], flattened, as episodes side by side: what a core is unrolled over at once."""

    rows: Tensor  # [L, m] flat row of each piece's steps; past its end, its last row
    inside: Tensor  # [L, m] whether the piece goes so far
    copy: Tensor  # [m]
    carried: Tensor  # [m] 1 where the piece goes on from the batch before, 0 where an episode begins


def cut(begins: np.ndarray, copies: IntArray) -> Pieces:
    """Pieces of those copies of a batch, where begins [T, n] says that an episode starts at a row."""
    length, n = begins.shape
    starts, ends, owners = [], [], []
    for copy in copies:
        edges = np.flatnonzero(begins[:, copy])
        edges = edges if len(edges) and edges[0] == 0 else np.concatenate([[0], edges])
        starts.append(edges)
        ends.append(np.concatenate([edges[1:], [length]]))
        owners.append(np.full(len(edges), copy))
    start, end, owner = (np.concatenate(one).astype(np.int64) for one in (starts, ends, owners))
    order = np.argsort(-(end - start), kind="stable")
    start, end, owner = start[order], end[order], owner[order]
    step = start + np.arange(int((end - start).max()))[:, None]
    rows = np.minimum(step, end - 1) * n + owner
    carried = ~begins[start, owner]
    return Pieces(
        torch.from_numpy(rows),
        torch.from_numpy(step < end),
        torch.from_numpy(owner),
        torch.from_numpy(carried.astype(np.float32)),
    )


def _linear(layers: nn.Sequential) -> list[nn.Linear]:
    return [one for one in layers if isinstance(one, nn.Linear)]


def _layers(inputs: int, hidden: tuple[int, ...], outputs: int) -> nn.Sequential:
    parts: list[nn.Module] = []
    for width in hidden:
        parts += [nn.Linear(inputs, width), nn.Tanh()]
        inputs = width
    return nn.Sequential(*parts, nn.Linear(inputs, outputs))


@torch.no_grad()
def _initialise(module: ActorCritic, generator: torch.Generator) -> None:
    """Orthogonal weights and biases of 0; the policy's mean starts at 0: blind, and the same for all policies."""
    for name, parameter in module.named_parameters():
        if parameter.ndim == 2:
            nn.init.orthogonal_(parameter, gain=1.0 if "core" in name else 2.0**0.5, generator=generator)
        elif "bias" in name:
            parameter.zero_()
    _linear(module.actor)[-1].weight.zero_()
    _linear(module.critic)[-1].weight.div_(2.0**0.5)
