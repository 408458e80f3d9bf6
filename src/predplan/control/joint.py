"""Policy and filter changed by gradients, through time (Algorithms 9 and 10 of chapter 5).

    L = a_1 l_1 / |l_1'| + a_2 l_2 / |l_2'|

with l_1 the policy gradient's loss and l_2 the filter's squared prediction error; |l'|² is an exponential average of
the squared norm of each gradient, corrected for its start (Eq. 5.10, read as one average of the total). Both are
differentiated through the filter from the beginning of each episode.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from predplan.control.adam import Adam
from predplan.control.adopting import adopt
from predplan.control.advantages import prepare
from predplan.control.bounds import check_number, check_whole
from predplan.control.differentiable import DifferentiableFilter
from predplan.control.learner import Learner, UpdateReport
from predplan.control.linear_filter import LinearFilter, gains, radius
from predplan.control.memories import Arrays, under
from predplan.control.networks import divergence, log_probability
from predplan.control.pool import Pool
from predplan.control.ppo import PPO, PPOSettings
from predplan.control.sampling import Batch
from predplan.control.tasks import BoolArray, IntArray
from predplan.control.trajectories import Trajectories
from predplan.control.trpo import TRPO, TRPOSettings, fit_values
from predplan.control.whitening import Whitening
from predplan.errors import InputError, PredplanError


@dataclass(frozen=True)
class JointSettings:
    """Weights of both losses and steps along their sum."""

    policy: float = 1.0  # a_1
    prediction: float = 1.0  # a_2; 0: the filter serves reward alone
    averaging: float = 0.1  # β of the gradients' average squares
    rate: float = 1e-3  # of Adam, for filter and policy
    steps: int = 5  # along the gradient, an update
    largest_gradient: float = 1.0

    def __post_init__(self) -> None:
        check_number(self, "policy", "prediction", least=0)
        if self.policy + self.prediction == 0.0:
            raise InputError("policy, prediction: found 0 and 0, expected one at least above 0")
        check_number(self, "averaging", above=0, most=1)
        check_number(self, "rate", above=0)
        check_number(self, "largest_gradient", above=0, finite=False)
        check_whole(self, "steps")


@dataclass(frozen=True)
class VRPGSettings:
    """Joint policy gradients with variance normalisation."""

    joint: JointSettings = JointSettings()
    values: TRPOSettings = field(default_factory=TRPOSettings)  # how values are regressed


@dataclass(frozen=True)
class AlternatingSettings:
    """An update of the policy on the states as they are, then steps of the filter."""

    policy: TRPOSettings | PPOSettings = field(default_factory=TRPOSettings)
    joint: JointSettings = JointSettings(policy=0.01, rate=1e-4, steps=5)
    most_divergence: float = 0.03  # KL by which the filter's steps may move the policy
    floor: float = 1e-5  # of the whitening

    def __post_init__(self) -> None:
        check_number(self, "most_divergence", least=0, finite=False)
        check_number(self, "floor", above=0, most=1)


class Normaliser:
    """Average squared norms of two gradients."""

    def __init__(self, averaging: float) -> None:
        self._averaging, self._squares, self._weight = averaging, np.zeros(2), 0.0

    def __call__(self, first: Tensor, second: Tensor) -> tuple[float, float]:
        """What to multiply either gradient by, so that its square is 1 on average."""
        beta = self._averaging
        self._squares = (1.0 - beta) * self._squares + beta * np.array([float(first @ first), float(second @ second)])
        self._weight = (1.0 - beta) * self._weight + beta
        scale = 1.0 / np.sqrt(np.maximum(self._squares / self._weight, 1e-24))
        return float(scale[0]), float(scale[1])

    def arrays(self) -> Arrays:
        """Squares, and the weight of all averaged so far."""
        return {"squares": self._squares, "weight": np.array([self._weight])}

    def restore(self, arrays: Arrays) -> None:
        """Go on from those."""
        self._squares, self._weight = np.array(arrays["squares"], np.float64), float(arrays["weight"][0])


class Joint:
    """Steps of filter and, where it is one of the modules, policy."""

    def __init__(self, learner: Learner, settings: JointSettings, with_policy: bool) -> None:
        if learner.model is None:
            raise PredplanError("joint updates need a predictive state")
        self._settings = settings
        self.filter = DifferentiableFilter(learner.model)
        self._parts = torch.nn.ModuleList([self.filter, learner.network.actor] if with_policy else [self.filter])
        if with_policy:
            self._parts.register_parameter("log_deviation", learner.network.log_deviation)
        self._adam, self._normaliser = Adam(self._parts, settings.rate), Normaliser(settings.averaging)

    def steps(
        self, learner: Learner, batch: Batch, history: Pool, drawn: Tensor, advantage: Tensor
    ) -> tuple[LinearFilter, int]:
        """The model after the settings' steps, and how many were skipped.

        drawn [T, n, A] and advantage [T, n] are of the batch, the last that history holds. A step to a filter that is
        not stable (spectral radius of A - K C from 1 on) is taken back, the policy's part too: it was meant for that
        filter.
        """
        assert learner.model is not None
        self.filter.load_state_dict(DifferentiableFilter(learner.model).state_dict())
        self.filter.limit = learner.model.limit
        trajectories, rows = history.of_batch(batch)
        model, skipped = learner.model, 0
        for _ in range(self._settings.steps):
            policy_loss, prediction_loss = self._losses(learner, model, trajectories, rows, drawn, advantage)
            first, second = self._adam.gradient(policy_loss), self._adam.gradient(prediction_loss)
            scales = self._normaliser(first, second)
            total = self._settings.policy * scales[0] * first + self._settings.prediction * scales[1] * second
            kept = {name: one.clone() for name, one in self._parts.state_dict().items()}
            moved = self._adam.follow(total, self._settings.largest_gradient)
            changed = self.filter.to_model(model)
            if not (moved and radius(changed) < 1.0):
                self._parts.load_state_dict(kept)
                skipped += 1
                continue
            model = changed
        return model, skipped

    def _losses(
        self,
        learner: Learner,
        model: LinearFilter,
        trajectories: Trajectories,
        rows: IntArray,
        drawn: Tensor,
        advantage: Tensor,
    ) -> tuple[Tensor, Tensor]:
        p = model.state_size
        _, after, prediction, inside = unroll(self.filter, model, trajectories)
        flat = after.transpose(0, 1)[inside.T]
        network, whitening = learner.network, learner.whitening
        own = torch.from_numpy(rows.reshape(-1))
        mean = network.actor(whiten_states(flat[own], whitening, p)).reshape(drawn.shape)
        gain = (log_probability(mean, network.log_deviation, drawn) * advantage).mean()
        seen = torch.from_numpy(trajectories.seen)
        observed = torch.from_numpy(np.nan_to_num(trajectories.observation))
        scale = torch.from_numpy(model.scale)
        error = ((prediction.transpose(0, 1)[inside.T] - observed) / scale)[seen]
        return -gain, (error**2).sum(-1).mean()

    def arrays(self) -> Arrays:
        """Adam's and the normaliser's."""
        own = {f"adam.{name}": one for name, one in self._adam.arrays().items()}
        return own | {f"normaliser.{name}": one for name, one in self._normaliser.arrays().items()}

    def restore(self, arrays: Arrays) -> None:
        """The same."""
        self._adam.restore(under(arrays, "adam"))
        self._normaliser.restore(under(arrays, "normaliser"))


class VRPG:
    """One joint gradient a step, and values by regression."""

    def __init__(self, learner: Learner, settings: VRPGSettings) -> None:
        self._settings = settings
        self._joint: Joint | None = None
        self._values = Adam(learner.network.critic, settings.values.rate)

    def __call__(self, learner: Learner, batch: Batch, history: Pool, generator: np.random.Generator) -> UpdateReport:
        """Steps of both, at the advantages that the critic gives before them."""
        self._joint = self._joint or Joint(learner, self._settings.joint, with_policy=True)
        network = learner.network
        lesson = prepare(batch, network, learner.whitening, self._settings.values.advantages)
        learner.model, skipped = self._joint.steps(learner, batch, history, lesson.drawn, lesson.advantage)
        skipped += fit_values(network, lesson, self._values, self._settings.values, generator)
        with torch.no_grad():
            mean = network.actor(lesson.features)
            moved = float(divergence(lesson.mean, lesson.log_deviation, mean, network.log_deviation).mean())
        return UpdateReport(moved, lesson.missed, network.entropy, skipped)

    def arrays(self) -> Arrays:
        """Of the joint steps and of values."""
        joint = self._joint.arrays() if self._joint else {}
        own = {f"joint.{name}": one for name, one in joint.items()}
        return own | {f"values.{name}": one for name, one in self._values.arrays().items()}

    def restore(self, learner: Learner, arrays: Arrays) -> None:
        """The same."""
        if learner.model is not None:
            self._joint = Joint(learner, self._settings.joint, with_policy=True)
            self._joint.restore(under(arrays, "joint"))
        self._values.restore(under(arrays, "values"))


class Alternating:
    """The policy's own update, then the filter's, which the policy follows as it follows a refit."""

    def __init__(self, learner: Learner, settings: AlternatingSettings) -> None:
        self._settings = settings
        self._joint: Joint | None = None
        policy = settings.policy
        self._policy: PPO | TRPO = PPO(learner, policy) if isinstance(policy, PPOSettings) else TRPO(learner, policy)

    def __call__(self, learner: Learner, batch: Batch, history: Pool, generator: np.random.Generator) -> UpdateReport:
        """Advantages of the filter's steps are those under the critic after the policy's update."""
        settings = self._settings
        self._joint = self._joint or Joint(learner, settings.joint, with_policy=False)
        report = self._policy(learner, batch, history, generator)
        lesson = prepare(batch, learner.network, learner.whitening, settings.policy.advantages)
        model, skipped = self._joint.steps(learner, batch, history, lesson.drawn, lesson.advantage)
        trajectories, _ = history.of_batch(batch)
        nothing = np.zeros(model.observation_size)
        adopt(learner, model, trajectories, 0, nothing, settings.most_divergence, settings.floor)
        return UpdateReport(report.divergence, report.missed, report.entropy, report.skipped + skipped)

    def arrays(self) -> Arrays:
        """Of both updates."""
        joint = self._joint.arrays() if self._joint else {}
        own = {f"joint.{name}": one for name, one in joint.items()}
        return own | {f"policy.{name}": one for name, one in self._policy.arrays().items()}

    def restore(self, learner: Learner, arrays: Arrays) -> None:
        """The same."""
        if learner.model is not None:
            self._joint = Joint(learner, self._settings.joint, with_policy=False)
            self._joint.restore(under(arrays, "joint"))
        self._policy.restore(learner, under(arrays, "policy"))


def unroll(
    module: DifferentiableFilter, model: LinearFilter, trajectories: Trajectories
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The filter over all trajectories side by side: before, after [L, E, p], prediction [L, E, O], inside [L, E].

    Rows inside, trajectory by trajectory, are the trajectories' rows. Gains are those of the model.
    """
    longest, count = int(trajectories.lengths.max()), len(trajectories.lengths)
    step = np.arange(longest)[:, None]
    inside: BoolArray = step < trajectories.lengths
    rows = np.minimum(trajectories.first[:-1] + step, trajectories.first[1:] - 1)
    reset = np.zeros((longest, count), np.bool_)
    reset[0] = True
    before, after, prediction = module(
        torch.zeros(count, model.state_size, dtype=torch.float64),
        torch.from_numpy(trajectories.action[rows]),
        torch.from_numpy(trajectories.observation[rows]),
        torch.from_numpy(gains(model, trajectories)[rows]),
        torch.from_numpy(reset),
    )
    return before, after, prediction, torch.from_numpy(inside)


def whiten_states(states: Tensor, whitening: Whitening, size: int) -> Tensor:
    """float32 features [m, p] of states [m, p], differentiable. Raises PredplanError if a policy is told of more."""
    if len(whitening.mean) != size:
        raise PredplanError(f"joint updates: the policy is told of {len(whitening.mean)} numbers, the state has {size}")
    white = (states - torch.from_numpy(whitening.mean)) @ torch.from_numpy(whitening.matrix).T
    return white.clamp(-10.0, 10.0).float()
