"""What updates have in common: returns to go, advantages, and the critic's targets of a batch.

Generalised advantage estimation (Schulman et al. 2016). An episode that the horizon cut goes on at the value of where
it was cut; one that is still running at the batch's end, at the value of where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from predplan.control.bounds import check_number
from predplan.control.networks import ActorCritic, log_probability
from predplan.control.sampling import Batch
from predplan.control.tasks import FloatArray
from predplan.control.whitening import Whitening


@dataclass(frozen=True)
class AdvantageSettings:
    """How far ahead rewards count."""

    discount: float = 0.99  # γ
    trace: float = 0.95  # λ: 1 is Monte Carlo, 0 one step

    def __post_init__(self) -> None:
        check_number(self, "discount", "trace", least=0, most=1)


@dataclass(frozen=True)
class Lesson:
    """A batch as updates read it; all float32."""

    features: Tensor  # [T, n, F] whitened
    begins: np.ndarray  # [T, n]
    core: Tensor  # [n, H]
    mean: Tensor  # [T, n, A] of the policy that acted
    log_deviation: Tensor  # [A] of the same
    drawn: Tensor  # [T, n, A]
    log_probability: Tensor  # [T, n] of drawn
    advantage: Tensor  # [T, n] of mean 0 and deviation 1
    target: Tensor  # [T, n] in the critic's units
    missed: float  # share of the targets' variance that the critic missed


def prepare(batch: Batch, network: ActorCritic, whitening: Whitening, settings: AdvantageSettings) -> Lesson:
    """Estimate advantages under the critic as it is, whose units are then those of this batch's returns."""
    advantage, target, value = estimate(batch, network, whitening, settings)
    centre, deviation = float(target.mean()), max(float(target.std()), 1e-3)
    network.rescale_values(centre, deviation)
    mean, drawn = torch.from_numpy(batch.mean), torch.from_numpy(batch.drawn)
    log_deviation = network.log_deviation.detach().clone()
    return Lesson(
        features=whitened(batch.features[:-1], whitening),
        begins=batch.begins[:-1],
        core=batch.core,
        mean=mean,
        log_deviation=log_deviation,
        drawn=drawn,
        log_probability=log_probability(mean, log_deviation, drawn),
        advantage=torch.from_numpy((advantage - advantage.mean()) / (advantage.std() + 1e-8)).float(),
        target=torch.from_numpy((target - centre) / deviation).float(),
        missed=float(np.var(target - value) / max(float(np.var(target)), 1e-12)),
    )


@torch.no_grad()
def estimate(
    batch: Batch, network: ActorCritic, whitening: Whitening, settings: AdvantageSettings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Advantages, targets of the critic and its values, all [T, n]."""
    known = network.known(whitened(batch.features, whitening), batch.begins, batch.core)
    values = network.values(known).double().numpy()
    following = np.where(batch.begins[1:], 0.0, values[1:])
    if len(batch.cut_features):
        last = network.step(whitened(batch.cut_features, whitening), batch.cut_core)[0]
        following[batch.truncated] = network.values(last).double().numpy()
    error = batch.reward + settings.discount * following - values[:-1]
    advantage, later = np.empty_like(error), np.zeros(error.shape[1])
    goes_on = settings.discount * settings.trace * ~batch.begins[1:]
    for t in reversed(range(len(error))):
        later = error[t] + goes_on[t] * later
        advantage[t] = later
    return advantage, advantage + values[:-1], values[:-1]


def whitened(features: FloatArray, whitening: Whitening) -> Tensor:
    """float32 [..., F] of the memory's features [..., F]."""
    flat = whitening(features.reshape(-1, features.shape[-1]))
    return torch.from_numpy(flat.reshape(features.shape).astype(np.float32))
