import numpy as np
import pytest
import torch
from torch import Tensor

from predplan.control.advantages import Lesson, prepare
from predplan.control.learner import Learner
from predplan.control.networks import divergence, log_probability
from predplan.control.pool import Pool
from predplan.control.trpo import TRPO, TRPOSettings, conjugate_gradients, natural_step
from tests.control.learners import CARTPOLE, SWIMMER, collect, sampler, seeing_network

NO_HISTORY = Pool(1, 1)


def lesson_of(recurrent: int, task: str = "cartpole", seed: int = 5) -> tuple[Lesson, Learner]:
    made = sampler(CARTPOLE if task == "cartpole" else SWIMMER, 6, 2, recurrent)
    network = seeing_network(made.memory.size, made.environments.action_size, recurrent)
    batch, learner = collect(made, network, 40, seed)
    return prepare(batch, network, learner.whitening, TRPOSettings().advantages), learner


def measured(learner: Learner, lesson: Lesson) -> tuple[float, float]:
    """Mean advantage by probability ratios, and mean divergence."""
    network = learner.network
    with torch.no_grad():
        mean = network.actor(network.known(lesson.features, lesson.begins, lesson.core))
        ratio = torch.exp(log_probability(mean, network.log_deviation, lesson.drawn) - lesson.log_probability)
        apart = divergence(lesson.mean, lesson.log_deviation, mean, network.log_deviation)
        return float((ratio * lesson.advantage).mean()), float(apart.mean())


@pytest.mark.parametrize("size", [1, 4, 8])
def test_conjugate_gradients_solve_a_system_in_as_many_steps_as_it_has_unknowns(size: int) -> None:
    generator = np.random.default_rng(size)
    root = generator.standard_normal((size, size))
    matrix = torch.from_numpy(root @ root.T + np.eye(size))
    right = torch.from_numpy(generator.standard_normal(size))
    found = conjugate_gradients(lambda vector: matrix @ vector, right, size + 1)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-6, atol=1e-8)


def test_conjugate_gradients_leave_nothing_as_nothing() -> None:
    def never(vector: Tensor) -> Tensor:
        raise AssertionError("0 is solved without a product")

    assert not conjugate_gradients(never, torch.zeros(3), 5).any()


@pytest.mark.parametrize("task", ["cartpole", "swimmer"])
@pytest.mark.parametrize("recurrent", [0, 5])
@pytest.mark.parametrize("bound", [1e-4, 0.01, 0.3])
def test_a_step_keeps_the_bound_and_makes_the_policy_better(task: str, recurrent: int, bound: float) -> None:
    lesson, learner = lesson_of(recurrent, task)
    before, _ = measured(learner, lesson)
    moved = natural_step(learner.network, lesson, TRPOSettings(bound=bound))
    after, apart = measured(learner, lesson)
    assert 0.05 * bound < moved <= bound
    assert apart == pytest.approx(moved, rel=1e-3, abs=1e-7)
    assert after > before


def test_a_small_step_is_along_the_inverse_fisher_matrix_times_the_gradient() -> None:
    """The matrix is that of outer products of grad log p, whose mean over actions is known for a Gaussian."""
    lesson, learner = lesson_of(0)
    network = learner.network
    parameters = [network.log_deviation, *network.actor.parameters()]
    known = lesson.features.flatten(0, 1)
    mean = network.actor(known)
    probability = log_probability(mean, network.log_deviation, lesson.drawn.flatten(0, 1))
    gradient = flat(
        torch.autograd.grad((probability * lesson.advantage.flatten()).mean(), parameters, retain_graph=True)
    )
    slopes = torch.stack(
        [flat(torch.autograd.grad(one, parameters, retain_graph=True, allow_unused=True)) for one in mean]
    )
    fisher = slopes.T @ slopes / len(mean) * torch.exp(-2.0 * network.log_deviation.detach())
    fisher[0, 0] += 2.0  # of the log deviation
    damping = 0.1
    expected = torch.linalg.solve(fisher + damping * torch.eye(len(fisher)), gradient)
    start = torch.nn.utils.parameters_to_vector(parameters).detach().clone()
    natural_step(network, lesson, TRPOSettings(bound=1e-6, damping=damping, solver_iterations=200))
    step = torch.nn.utils.parameters_to_vector(parameters).detach() - start
    assert float(torch.nn.functional.cosine_similarity(step, expected, dim=0)) > 0.999


def test_nothing_moves_where_no_step_is_good() -> None:
    lesson, learner = lesson_of(0)
    before = [one.detach().clone() for one in learner.network.parameters()]
    for advantage in (torch.zeros_like(lesson.advantage), torch.full_like(lesson.advantage, torch.nan)):
        hopeless = Lesson(**{**vars(lesson), "advantage": advantage})
        assert natural_step(learner.network, hopeless, TRPOSettings()) == 0.0
        for one, other in zip(learner.network.parameters(), before, strict=True):
            assert torch.equal(one, other)


@pytest.mark.parametrize("recurrent", [0, 5])
def test_an_update_learns_values_too(recurrent: int) -> None:
    made = sampler(CARTPOLE, 6, 2, recurrent)
    batch, learner = collect(made, seeing_network(made.memory.size, 1, recurrent), 40)
    network, settings = learner.network, TRPOSettings(minibatch=40)
    lesson = prepare(batch, network, learner.whitening, settings.advantages)

    def error() -> float:
        with torch.no_grad():
            known = network.known(lesson.features, lesson.begins, lesson.core)
            return float(((network.scaled_values(known) - lesson.target) ** 2).mean())

    before = error()
    report = TRPO(learner, settings)(learner, batch, NO_HISTORY, np.random.default_rng(0))
    assert 0.0 < report.divergence <= 0.01
    assert report.skipped == 0
    assert error() < before


def flat(tensors: tuple[Tensor | None, ...]) -> Tensor:
    """One vector; the log deviation, of one action, has no part in the mean."""
    return torch.cat([torch.zeros(1) if one is None else one.reshape(-1) for one in tensors])
