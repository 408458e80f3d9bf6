"""Proximal policy optimisation in minibatches (Schulman et al. 2017), for policies with and without a core."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from predplan.control.adam import Adam
from predplan.control.advantages import AdvantageSettings, Lesson, prepare
from predplan.control.bounds import check_number, check_whole
from predplan.control.learner import Learner, UpdateReport
from predplan.control.memories import Arrays
from predplan.control.networks import ActorCritic, cut, divergence, log_probability
from predplan.control.pool import Pool
from predplan.control.sampling import Batch


@dataclass(frozen=True)
class PPOSettings:
    """One update."""

    rate: float = 1e-3  # of Adam
    epochs: int = 10
    minibatch: int = 256  # steps; with a core, as many copies as come nearest
    clip: float = 0.2  # of probability ratios
    most_divergence: float = 0.05  # epochs end beyond it
    largest_gradient: float = 0.5  # norm
    advantages: AdvantageSettings = field(default_factory=AdvantageSettings)

    def __post_init__(self) -> None:
        check_number(self, "rate", "clip", above=0)
        check_number(self, "most_divergence", "largest_gradient", above=0, finite=False)
        check_whole(self, "epochs", "minibatch")


class PPO:
    """Adam goes on from update to update."""

    def __init__(self, learner: Learner, settings: PPOSettings) -> None:
        self._settings, self._adam = settings, Adam(learner.network, settings.rate)

    def __call__(self, learner: Learner, batch: Batch, history: Pool, generator: np.random.Generator) -> UpdateReport:
        """Epochs of minibatches, until the policy has moved by the divergence allowed."""
        settings, network = self._settings, learner.network
        lesson = prepare(batch, network, learner.whitening, settings.advantages)
        skipped, moved = 0, 0.0
        for _ in range(settings.epochs):
            moved = 0.0
            for rows in self._minibatches(lesson, network, generator):
                part = pick(lesson, network, rows)
                mean = network.actor(part.known)
                ratio = torch.exp(log_probability(mean, network.log_deviation, part.drawn) - part.log_probability)
                clipped = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
                gain = torch.minimum(ratio * part.advantage, clipped * part.advantage).mean()
                error = ((network.scaled_values(part.known) - part.target) ** 2).mean()
                with torch.no_grad():
                    apart = divergence(part.mean, lesson.log_deviation, mean, network.log_deviation)
                    moved += float(apart.sum()) / batch.steps
                loss = 0.5 * error - gain
                if network.predictor is not None:
                    loss = loss + network.settings.prediction * foretelling_error(network, lesson, part)
                skipped += not self._adam.step(loss, settings.largest_gradient)
            if moved > settings.most_divergence:
                break
        return UpdateReport(moved, lesson.missed, network.entropy, skipped)

    def _minibatches(
        self, lesson: Lesson, network: ActorCritic, generator: np.random.Generator
    ) -> list[NDArray[np.int64]]:
        steps, n = lesson.advantage.numel(), lesson.advantage.shape[1]
        parts = max(1, round(steps / self._settings.minibatch))
        if network.core is None:
            return np.array_split(generator.permutation(steps), parts)
        return np.array_split(generator.permutation(n), min(parts, n))

    def arrays(self) -> Arrays:
        """Adam's."""
        return self._adam.arrays()

    def restore(self, learner: Learner, arrays: Arrays) -> None:
        """Adam's."""
        self._adam.restore(arrays)


@dataclass(frozen=True)
class Part:
    """Steps of a lesson, and what actor and critic read there."""

    index: Tensor  # [m] among the lesson's steps, flattened
    known: Tensor  # [m, ...]
    mean: Tensor  # [m, A]
    drawn: Tensor  # [m, A]
    log_probability: Tensor  # [m]
    advantage: Tensor  # [m]
    target: Tensor  # [m]


def pick(lesson: Lesson, network: ActorCritic, rows: NDArray[np.int64]) -> Part:
    """Those steps [m] of the lesson flattened from [T, n]; with a core rows are copies, and all of their steps."""
    features = lesson.features.flatten(0, 1)
    if network.core is None:
        index = torch.from_numpy(rows)
        known = features[index]
    else:
        pieces = cut(lesson.begins, np.sort(rows))
        known, index = network.unrolled(features, pieces, lesson.core), pieces.rows[pieces.inside]
    flat = [one.flatten(0, 1)[index] for one in (lesson.mean, lesson.drawn)]
    return Part(
        index,
        known,
        *flat,
        *(one.flatten()[index] for one in (lesson.log_probability, lesson.advantage, lesson.target)),
    )


def foretelling_error(network: ActorCritic, lesson: Lesson, part: Part) -> Tensor:
    """Mean square error of the next features, where the episode goes on within the lesson (§5.8's regularised GRU)."""
    assert network.predictor is not None
    n = lesson.begins.shape[1]
    goes_on = torch.from_numpy(~lesson.begins).flatten()
    following = part.index + n
    inside = following < len(goes_on)
    inside[inside.clone()] = goes_on[following[inside]]
    action = part.drawn.clamp(-1.0, 1.0)
    expected = network.predictor(torch.cat([part.known, action], dim=-1))[inside]
    error: Tensor = ((expected - lesson.features.flatten(0, 1)[following[inside]]) ** 2).mean()
    return error
