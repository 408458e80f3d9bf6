"""What learns: a policy's network, the whitening before it, and the model that its memory filters with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import Arrays
from predplan.control.networks import ActorCritic
from predplan.control.pool import Pool
from predplan.control.sampling import Batch
from predplan.control.whitening import Statistics, Whitening, carry_over, whiten


@dataclass
class Learner:
    """Changed by updates."""

    network: ActorCritic
    statistics: Statistics  # of features
    whitening: Whitening
    model: LinearFilter | None = None

    def see(self, features: np.ndarray, most: float, floor: float) -> None:
        """Whiten by features [..., F] too, the policy and its values staying what they are."""
        self.statistics = self.statistics.updated(features.reshape(-1, features.shape[-1]), most)
        fresh = whiten(self.statistics, floor)
        for weight, bias in self.network.first_layers():
            carry_over(weight, bias, self.whitening.matrix, self.whitening.offset, fresh)
        self.whitening = fresh


@dataclass(frozen=True)
class UpdateReport:
    """What an update did."""

    divergence: float  # KL of the policy before from that after, mean over the batch
    missed: float  # share of the variance of returns that the critic had missed
    entropy: float  # of the policy after, nat
    skipped: int  # gradient steps whose numbers were not finite


class Update(Protocol):
    """Of policy, values and model, by a batch."""

    def __call__(self, learner: Learner, batch: Batch, history: Pool, generator: np.random.Generator) -> UpdateReport:
        """Change the learner. history ends with the batch, and holds its episodes from their beginnings."""

    def arrays(self) -> Arrays:
        """All that is needed to go on from here."""

    def restore(self, learner: Learner, arrays: Arrays) -> None:
        """Go on from there, with the learner as it was then."""
