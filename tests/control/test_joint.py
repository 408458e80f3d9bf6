from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.advantages import AdvantageSettings, prepare
from predplan.control.differentiable import LEARNED
from predplan.control.environments import EnvironmentSettings
from predplan.control.filtering import filter_trajectories
from predplan.control.joint import (
    VRPG,
    Alternating,
    AlternatingSettings,
    Joint,
    JointSettings,
    Normaliser,
    VRPGSettings,
    unroll,
    whiten_states,
)
from predplan.control.learner import Learner
from predplan.control.linear_filter import LinearFilter, gains, radius
from predplan.control.pool import Pool
from predplan.control.ppo import PPOSettings
from predplan.control.sampling import Batch
from predplan.control.trajectories import Trajectories
from predplan.control.whitening import no_whitening
from predplan.errors import PredplanError
from tests.control.learners import CARTPOLE, SWIMMER, collect, learned_filter, sampler, seeing_network, uneven
from tests.control.systems import exact_filter, example, simulate

LOSSY = replace(CARTPOLE, noise=0.2, drop=0.2)


def taught(settings: EnvironmentSettings, window: int = 0) -> tuple[Learner, Batch, Pool]:
    """A learner with a filter, the second batch of its sampler, and the pool that ends with it."""
    model = learned_filter(settings)
    made = sampler(settings, 5, window, model=model)
    network = seeing_network(made.memory.size, made.environments.action_size)
    pool = Pool(5, 10_000)
    pool.add(collect(made, network, 10)[0])
    batch, learner = collect(made, network, 25)
    pool.add(batch)
    learner.model = model
    learner.see(batch.features[:-1], 1e4, 1e-3)
    return learner, batch, pool


@pytest.mark.parametrize("clip", [1e6, 1.5])
def test_unrolled_is_what_the_filter_gives(clip: float) -> None:
    data = uneven(simulate(example(), 5, 12, np.random.default_rng(0), 0.3), [1, 9, 4, 12, 7])
    model = replace(exact_filter(example()), initial_covariance=np.eye(3), limit=clip)
    learner, *_ = taught(CARTPOLE)
    learner.model = model
    joint = Joint(learner, JointSettings(), with_policy=False)
    expected = filter_trajectories(model, data)
    before, after, prediction, inside = unroll(joint.filter, model, data)
    for found, wanted in ((before, expected.state), (after, expected.after), (prediction, expected.prediction)):
        np.testing.assert_allclose(found.detach().transpose(0, 1)[inside.T], wanted, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY, SWIMMER])
def test_gradients_of_both_losses_are_finite_differences(
    settings: EnvironmentSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By each of the filter's parameters, through time, the gains as they were."""
    learner, batch, pool = taught(settings)
    model = learner.model
    assert model is not None
    lesson = prepare(batch, learner.network, learner.whitening, AdvantageSettings())
    trajectories, rows = pool.of_batch(batch)
    joint = Joint(learner, JointSettings(), with_policy=False)
    learner.network.double()
    monkeypatch.setattr(torch.Tensor, "float", torch.Tensor.double)  # differences of single precision say little
    drawn, advantage = lesson.drawn.double(), lesson.advantage.double()

    settled, K = model.K.copy(), dict(joint.filter.named_parameters())["K"]

    def moved_gains(model: LinearFilter, trajectories: Trajectories) -> np.ndarray:
        """K_t = constant + K."""
        change = K.detach().numpy() - settled
        return gains(model, trajectories) + change * trajectories.seen[:, None, None]

    monkeypatch.setattr("predplan.control.joint.gains", moved_gains)

    def losses() -> tuple[torch.Tensor, torch.Tensor]:
        return joint._losses(learner, model, trajectories, rows, drawn, advantage)

    generator = np.random.default_rng(0)
    for which in (0, 1):
        gradients = torch.autograd.grad(losses()[which], [getattr(joint.filter, name) for name in LEARNED])
        for name, gradient in zip(LEARNED, gradients, strict=True):
            parameter = getattr(joint.filter, name)
            direction = torch.from_numpy(generator.standard_normal(parameter.shape))
            step = 1e-7
            ends = []
            for sign in (1.0, -1.0):
                with torch.no_grad():
                    parameter.add_(direction, alpha=sign * step)
                    ends.append(float(losses()[which].detach()))
                    parameter.sub_(direction, alpha=sign * step)
            slope = float((gradient * direction).sum())
            assert (ends[0] - ends[1]) / (2.0 * step) == pytest.approx(slope, rel=1e-4, abs=1e-7), name
    assert float(losses()[0].detach()) == pytest.approx(
        -float((lesson.log_probability * lesson.advantage).mean()), rel=1e-3
    )


def test_losses_are_of_what_was_seen_and_done() -> None:
    learner, batch, pool = taught(LOSSY)
    model = learner.model
    assert model is not None
    lesson = prepare(batch, learner.network, learner.whitening, AdvantageSettings())
    trajectories, rows = pool.of_batch(batch)
    joint = Joint(learner, JointSettings(), with_policy=True)
    policy, prediction = joint._losses(learner, model, trajectories, rows, lesson.drawn, lesson.advantage)
    expected = filter_trajectories(model, trajectories).prediction
    errors = ((trajectories.observation - expected) / model.scale)[trajectories.seen]
    assert float(prediction.detach()) == pytest.approx(float((errors**2).sum(axis=1).mean()), rel=1e-9)
    gain = (lesson.log_probability * lesson.advantage).mean()
    assert float(policy.detach()) == pytest.approx(-float(gain), rel=1e-4, abs=1e-6)


def test_gradients_are_brought_to_mean_square_1() -> None:
    """Eq. 5.10, over many gradients of two very different sizes."""
    generator = torch.Generator().manual_seed(0)
    normaliser, squares = Normaliser(0.1), []
    for _ in range(400):
        first, second = 1e4 * torch.randn(7, generator=generator), 1e-5 * torch.randn(3, generator=generator)
        scales = normaliser(first, second)
        squares.append([float((scales[0] * first).square().sum()), float((scales[1] * second).square().sum())])
    np.testing.assert_allclose(np.mean(squares, axis=0), 1.0, atol=0.1)


def test_the_average_is_of_squares_and_corrected_for_its_start() -> None:
    vectors = [torch.tensor([3.0, 4.0]), torch.tensor([1.0, 0.0]), torch.tensor([0.0, 2.0])]
    normaliser, squares = Normaliser(0.25), np.array([25.0, 1.0, 4.0])
    for n, vector in enumerate(vectors, 1):
        weights = 0.25 * 0.75 ** np.arange(n)[::-1]
        scale, same = normaliser(vector, vector)
        assert scale == same == pytest.approx((weights @ squares[:n] / weights.sum()) ** -0.5)
    other = Normaliser(0.25)
    other.restore(normaliser.arrays())
    assert other(vectors[0], vectors[1]) == normaliser(vectors[0], vectors[1])
    assert all(np.isfinite(Normaliser(0.1)(torch.zeros(2), torch.zeros(2))))


def test_states_are_whitened_as_features_are() -> None:
    learner, batch, _ = taught(CARTPOLE)
    states = batch.features[:-1].reshape(-1, batch.features.shape[2])
    found = whiten_states(torch.from_numpy(states), learner.whitening, states.shape[1])
    np.testing.assert_allclose(found, learner.whitening(states), rtol=1e-6, atol=1e-6)


def test_a_policy_that_is_told_of_more_than_states_is_named() -> None:
    learner, batch, pool = taught(CARTPOLE, window=1)
    with pytest.raises(PredplanError, match="the policy is told of 8 numbers, the state has 4"):
        VRPG(learner, VRPGSettings())(learner, batch, pool, np.random.default_rng(0))
    learner.model = None
    with pytest.raises(PredplanError, match="joint updates need a predictive state"):
        VRPG(learner, VRPGSettings())(learner, batch, pool, np.random.default_rng(0))


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY])
def test_joint_steps_lessen_both_losses(settings: EnvironmentSettings) -> None:
    learner, batch, pool = taught(settings)
    model = learner.model
    assert model is not None
    lesson = prepare(batch, learner.network, learner.whitening, AdvantageSettings())
    trajectories, rows = pool.of_batch(batch)
    joint = Joint(learner, JointSettings(rate=1e-4, steps=20), with_policy=True)
    given = (trajectories, rows, lesson.drawn, lesson.advantage)
    before = [float(one.detach()) for one in joint._losses(learner, model, *given)]
    changed, skipped = joint.steps(learner, batch, pool, lesson.drawn, lesson.advantage)
    learner.model = changed
    after = [float(one.detach()) for one in Joint(learner, JointSettings(), True)._losses(learner, changed, *given)]
    assert skipped == 0
    assert sum(after) < sum(before)
    assert radius(changed) < 1.0


def test_a_filter_without_weight_learns_from_reward_alone() -> None:
    """prediction=0: scaling what was observed less changes nothing but through the policy."""
    learner, batch, pool = taught(CARTPOLE)
    lesson = prepare(batch, learner.network, learner.whitening, AdvantageSettings())
    settings = JointSettings(prediction=0.0, rate=1e-5, steps=1)
    joint = Joint(learner, settings, with_policy=False)
    trajectories, rows = pool.of_batch(batch)
    model = learner.model
    assert model is not None
    policy, _ = joint._losses(learner, model, trajectories, rows, lesson.drawn, lesson.advantage)
    gradient = joint._adam.gradient(policy)
    joint.steps(learner, batch, pool, lesson.drawn, lesson.advantage)
    moved = torch.from_numpy(joint.arrays()["adam.first"]).float() / 0.1
    expected = gradient / gradient.norm()
    torch.testing.assert_close(moved, expected, rtol=1e-3, atol=1e-5)


def test_steps_to_a_filter_that_is_not_stable_are_not_kept() -> None:
    learner, batch, pool = taught(CARTPOLE)
    lesson = prepare(batch, learner.network, learner.whitening, AdvantageSettings())
    joint = Joint(learner, JointSettings(rate=3.0, steps=3), with_policy=False)
    model, skipped = joint.steps(learner, batch, pool, lesson.drawn, lesson.advantage)
    assert skipped > 0
    assert radius(model) < 1.0
    joint = Joint(learner, JointSettings(steps=2), with_policy=True)
    before = [one.detach().clone() for one in learner.network.parameters()]
    model, skipped = joint.steps(learner, batch, pool, lesson.drawn, lesson.advantage * torch.nan)
    assert skipped == 2
    assert model is learner.model
    assert all(torch.equal(one, other) for one, other in zip(learner.network.parameters(), before, strict=True))


def test_the_policy_does_not_move_with_a_filter_that_is_not_kept() -> None:
    learner, batch, pool = taught(CARTPOLE)
    lesson = prepare(batch, learner.network, learner.whitening, AdvantageSettings())
    joint = Joint(learner, JointSettings(rate=3.0, steps=1), with_policy=True)
    before = [one.detach().clone() for one in learner.network.parameters()]
    model, skipped = joint.steps(learner, batch, pool, lesson.drawn, lesson.advantage)
    assert (model, skipped) == (learner.model, 1)
    assert all(torch.equal(one, other) for one, other in zip(learner.network.parameters(), before, strict=True))
    gentle = Joint(learner, JointSettings(rate=1e-4, steps=1), with_policy=True)
    assert gentle.steps(learner, batch, pool, lesson.drawn, lesson.advantage)[1] == 0
    assert not all(torch.equal(one, other) for one, other in zip(learner.network.parameters(), before, strict=True))


def test_stability_is_of_errors_not_of_the_system() -> None:
    model = exact_filter(example())
    assert radius(model) < 1.0
    assert radius(replace(model, A=1.2 * np.eye(3), K=np.zeros((3, 2)))) >= 1.0
    unstable = replace(model, A=1.2 * np.eye(3), C=np.eye(3)[:2], K=1.2 * np.eye(3)[:, :2])
    assert radius(unstable) >= 1.0
    assert radius(replace(unstable, A=np.diag([1.2, 1.2, 0.5]))) < 1.0
    assert radius(replace(model, A=np.full((3, 3), np.nan))) >= 1.0


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY])
@pytest.mark.parametrize("kind", ["vrpg", "alternating", "alternating-ppo"])
def test_updates_go_on_the_same_after_they_were_put_away(settings: EnvironmentSettings, kind: str) -> None:
    learner, batch, pool = taught(settings)
    other, *_ = taught(settings)

    def made(learner: Learner) -> VRPG | Alternating:
        if kind == "vrpg":
            return VRPG(learner, VRPGSettings())
        return Alternating(
            learner, AlternatingSettings() if kind == "alternating" else AlternatingSettings(PPOSettings())
        )

    update = made(learner)
    for _ in range(2):
        report = update(learner, batch, pool, np.random.default_rng(0))
        assert np.isfinite(report.divergence)
    other.network.load_state_dict(learner.network.state_dict())
    other.statistics, other.whitening, other.model = learner.statistics, learner.whitening, learner.model
    again = made(other)
    again.restore(other, {name: one.copy() for name, one in update.arrays().items()})
    for one, made_by in ((learner, update), (other, again)):
        made_by(one, batch, pool, np.random.default_rng(1))
    for name, value in learner.network.state_dict().items():
        assert torch.equal(value, other.network.state_dict()[name]), name
    assert learner.model is not None
    assert other.model is not None
    for array, same in zip(learner.model.arrays(), other.model.arrays(), strict=True):
        np.testing.assert_array_equal(array, same)


def test_alternating_steps_of_the_filter_leave_the_policy_nearly_what_it_was() -> None:
    learner, batch, pool = taught(CARTPOLE)
    settings = AlternatingSettings(PPOSettings(rate=1e-12), JointSettings(policy=0.01, rate=1e-3, steps=5))
    first = learner.model
    before = actions(learner, pool)
    Alternating(learner, settings)(learner, batch, pool, np.random.default_rng(0))
    assert learner.model is not first
    np.testing.assert_allclose(actions(learner, pool), before, atol=0.2)


def actions(learner: Learner, pool: Pool) -> np.ndarray:
    """The policy's means over the pool."""
    assert learner.model is not None
    after = filter_trajectories(learner.model, pool.trajectories()).after
    with torch.no_grad():
        means: np.ndarray = learner.network.actor(torch.from_numpy(learner.whitening(after)).float()).numpy()
        return means


def test_nothing_is_whitened_for_a_state_alone() -> None:
    states = torch.randn(5, 3, dtype=torch.float64)
    torch.testing.assert_close(whiten_states(states, no_whitening(3), 3), states.float())
