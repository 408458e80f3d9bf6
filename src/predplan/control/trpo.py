"""Trust region policy optimisation (Schulman et al. 2015): the natural gradient as far as a divergence allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor, nn

from predplan.control.adam import Adam
from predplan.control.advantages import AdvantageSettings, Lesson, prepare
from predplan.control.bounds import check_number, check_whole
from predplan.control.learner import Learner, UpdateReport
from predplan.control.memories import Arrays
from predplan.control.networks import ActorCritic, divergence, log_probability
from predplan.control.pool import Pool
from predplan.control.ppo import pick
from predplan.control.sampling import Batch


@dataclass(frozen=True)
class TRPOSettings:
    """One update."""

    bound: float = 0.01  # on the mean divergence
    solver_iterations: int = 10  # of conjugate gradients
    damping: float = 0.1  # added to the Fisher matrix
    shorter: float = 0.8  # times the step's length, until the bound holds and the policy is better
    tries: int = 10  # of lengths
    rate: float = 1e-3  # of Adam, for values
    epochs: int = 10  # of values
    minibatch: int = 256  # steps, of values
    largest_gradient: float = 0.5
    advantages: AdvantageSettings = field(default_factory=AdvantageSettings)

    def __post_init__(self) -> None:
        check_number(self, "bound", "damping", "rate", above=0)
        check_number(self, "shorter", above=0, below=1)
        check_number(self, "largest_gradient", above=0, finite=False)
        check_whole(self, "solver_iterations", "tries", "epochs", "minibatch")


class TRPO:
    """Values are learned by Adam, which goes on from update to update."""

    def __init__(self, learner: Learner, settings: TRPOSettings) -> None:
        self._settings, self._adam = settings, Adam(learner.network.critic, settings.rate)

    def __call__(self, learner: Learner, batch: Batch, history: Pool, generator: np.random.Generator) -> UpdateReport:
        """A natural step of the policy, a core included, then values by regression."""
        settings, network = self._settings, learner.network
        lesson = prepare(batch, network, learner.whitening, settings.advantages)
        moved = natural_step(network, lesson, settings)
        skipped = fit_values(network, lesson, self._adam, settings, generator)
        return UpdateReport(moved, lesson.missed, network.entropy, skipped)

    def arrays(self) -> Arrays:
        """Adam's."""
        return self._adam.arrays()

    def restore(self, learner: Learner, arrays: Arrays) -> None:
        """Adam's."""
        self._adam.restore(arrays)


def natural_step(network: ActorCritic, lesson: Lesson, settings: TRPOSettings) -> float:
    """Change policy and core; the divergence that it made, 0 where no step was good.

    Steps are along F⁻¹ g, F the Fisher matrix, long enough to make half the step's squared length in F the bound. A
    line search shortens them. Halved, steps on windows and GRUs used a quarter of the bound (median over CartPole's
    updates); shortened to .8 they use three quarters, and all policies learn in fewer steps.
    """
    parameters = [network.log_deviation, *network.actor.parameters()]
    parameters += [] if network.core is None else network.core.parameters()
    every = np.arange(lesson.advantage.numel() if network.core is None else lesson.advantage.shape[1])

    def measured() -> tuple[Tensor, Tensor]:
        part = pick(lesson, network, every)
        mean = network.actor(part.known)
        ratio = torch.exp(log_probability(mean, network.log_deviation, part.drawn) - part.log_probability)
        apart = divergence(part.mean, lesson.log_deviation, mean, network.log_deviation)
        return (ratio * part.advantage).mean(), apart.mean()

    gain, apart = measured()
    gradient = _flat(torch.autograd.grad(gain, parameters, retain_graph=True))
    slope = _flat(torch.autograd.grad(apart, parameters, create_graph=True))

    def fisher(vector: Tensor) -> Tensor:
        product = torch.autograd.grad((slope * vector).sum(), parameters, retain_graph=True)
        return _flat(product) + settings.damping * vector

    direction = conjugate_gradients(fisher, gradient, settings.solver_iterations)
    length = float(direction @ fisher(direction))
    if not (np.isfinite(length) and length > 0.0):
        return 0.0
    step = direction * (2.0 * settings.bound / length) ** 0.5
    start, before = nn.utils.parameters_to_vector(parameters).detach().clone(), float(gain.detach())
    with torch.no_grad():
        for _ in range(settings.tries):
            _put(start + step, parameters)
            gain, apart = measured()
            if float(apart) <= settings.bound and float(gain) > before:
                return float(apart)
            step = settings.shorter * step
        _put(start, parameters)
    return 0.0


def conjugate_gradients(product: Callable[[Tensor], Tensor], right: Tensor, iterations: int) -> Tensor:
    """x [n] of F x = right [n], F symmetric and positive definite, given as its product with a vector [n]."""
    solution, residual = torch.zeros_like(right), right.clone()
    direction, square = residual.clone(), float(residual @ residual)
    for _ in range(iterations):
        if square < 1e-20:
            break
        along = product(direction)
        length = square / float(direction @ along)
        solution += length * direction
        residual -= length * along
        following = float(residual @ residual)
        direction = residual + following / square * direction
        square = following
    return solution


def fit_values(
    network: ActorCritic, lesson: Lesson, adam: Adam, settings: TRPOSettings, generator: np.random.Generator
) -> int:
    """Regress the critic on its targets, what it reads taken as given; steps that were skipped."""
    with torch.no_grad():
        known = network.known(lesson.features, lesson.begins, lesson.core).flatten(0, 1)
    target, skipped = lesson.target.flatten(), 0
    parts = max(1, round(len(target) / settings.minibatch))
    for _ in range(settings.epochs):
        for rows in np.array_split(generator.permutation(len(target)), parts):
            index = torch.from_numpy(rows)
            error = ((network.scaled_values(known[index]) - target[index]) ** 2).mean()
            skipped += not adam.step(0.5 * error, settings.largest_gradient)
    return skipped


def _flat(tensors: tuple[Tensor, ...]) -> Tensor:
    return torch.cat([one.reshape(-1) for one in tensors])


def _put(vector: Tensor, parameters: list[nn.Parameter]) -> None:
    """Into the parameters' own memory: last digits of products depend on where numbers lie, and a resumption would."""
    at = 0
    for one in parameters:
        one.copy_(vector[at : at + one.numel()].view_as(one))
        at += one.numel()
