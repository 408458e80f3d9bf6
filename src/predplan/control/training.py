"""Learning a policy: explore, learn a filter, then batches, updates and refits, until the steps are spent.

The first batch is acted blindly, by the Gaussian that every policy starts as. A filter is learned from it, and as the
policy's mean is then still 0 whatever it is told, the first update may use it as well: exploring costs nothing. All
that a training is in the middle of can be put away and gone on with exactly.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch

from predplan.control.adopting import adopt, states_at_end
from predplan.control.autoregression import Standard
from predplan.control.bounds import check_whole
from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.innovation import InnovationSettings
from predplan.control.joint import VRPG, Alternating, AlternatingSettings, VRPGSettings
from predplan.control.learner import Learner, Update
from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import Arrays, Memory, Predictive, Window, under
from predplan.control.methods import FilterSettings, Method
from predplan.control.moments import Moments
from predplan.control.networks import ActorCritic
from predplan.control.pool import Pool
from predplan.control.ppo import PPO, PPOSettings
from predplan.control.refitting import Known, learn_filter, random_filter
from predplan.control.sampling import Batch, Episodes, Sampler, replay
from predplan.control.tasks import FloatArray
from predplan.control.trpo import TRPO, TRPOSettings
from predplan.control.whitening import Statistics, Whitening, no_statistics, no_whitening
from predplan.errors import PredplanError


@dataclass(frozen=True)
class Schedule:
    """How much, and in what portions."""

    steps: int = 100_000  # of the environment, the first, blind batch included
    copies: int = 32  # of the environment, side by side
    length: int = 64  # steps of each in a batch

    def __post_init__(self) -> None:
        check_whole(self, "steps", "copies", "length")


@dataclass(frozen=True)
class Progress:
    """What a batch and its update brought."""

    update: int
    steps: int  # of the environment so far
    episodes: int  # that ended in this batch
    return_mean: float  # of these; NaN if none
    return_std: float
    length_mean: float  # steps
    prediction_error: float  # one step ahead, share of the exploration's variance; NaN: nothing was predicted
    policy_kl: float  # by which the update moved the policy
    refit_kl: float  # by which a refit did, or would have; NaN: none
    refitted: bool
    entropy: float  # nat
    value_error: float  # share of the variance of returns that the critic had missed
    skipped: int  # filter and gradient steps that were not finite, so far
    cpu_s: float  # so far


class Diverged(PredplanError):  # noqa: N818 -- what happened, no fault of the program
    """Learning led to numbers that are not finite."""


class Training:
    """One run, in the middle."""

    def __init__(self, task: EnvironmentSettings, method: Method, schedule: Schedule, seed: int) -> None:
        """Steps nothing yet. Raises InputError as EnvironmentSettings and Schedule."""
        self.task, self.method, self.schedule, self.seed = task, method, schedule, seed
        self._acting, self._learning, worlds = np.random.default_rng(seed).spawn(3)
        weights = torch.Generator().manual_seed(int(np.random.default_rng(seed).integers(2**62)))
        self.environments = Environments(task, schedule.copies, worlds)
        self._centre = np.zeros(self.environments.observation_size)
        actions = self.environments.action_size
        memory = Window(schedule.copies, max(method.window, 1), self._centre, actions)
        self.sampler = Sampler(self.environments, memory, method.network.recurrent)
        size = self._predictive_size() if method.filter else memory.size
        network = ActorCritic(size, actions, method.network, weights)
        self.learner = Learner(network, no_statistics(size), no_whitening(size))
        self._update = make_update(method, self.learner)
        self._pool = Pool(schedule.copies, _rows(method.filter, task))
        self._known: Known | None = None
        self._variance: FloatArray | None = None
        self.updates = self.steps = self._skipped = 0
        self._cpu = 0.0

    @property
    def done(self) -> bool:
        """Whether the steps are spent."""
        return self.steps >= self.schedule.steps

    def advance(self) -> Progress:
        """A batch, an update and, where it is due, a refit. Raises Diverged."""
        began = time.process_time()
        batch, episodes = self._first() if self.updates == 0 else self._next()
        self.steps += batch.steps
        self.updates += 1
        self.learner.see(batch.features[:-1], self.method.whitening_rows, self.method.floor)
        report = self._update(self.learner, batch, self._pool, self._learning)
        self._skipped += report.skipped
        refitted, moved = self._refit()
        self._follow_model()
        self._check()
        self._cpu += time.process_time() - began
        assert self._variance is not None
        error = np.nanmean(batch.error / self._variance) if np.isfinite(batch.error).any() else np.nan
        some = len(episodes.returns) > 0
        return Progress(
            update=self.updates,
            steps=self.steps,
            episodes=len(episodes.returns),
            return_mean=float(episodes.returns.mean()) if some else np.nan,
            return_std=float(episodes.returns.std()) if some else np.nan,
            length_mean=float(episodes.lengths.mean()) if some else np.nan,
            prediction_error=float(error),
            policy_kl=report.divergence,
            refit_kl=moved,
            refitted=refitted,
            entropy=report.entropy,
            value_error=report.missed,
            skipped=self._skipped + self._skipped_by_filter(),
            cpu_s=self._cpu,
        )

    def put_away(self) -> tuple[Arrays, dict[str, Any]]:
        """All that is needed to go on exactly from here: arrays by name, and what JSON can hold."""
        learner = self.learner
        parts: dict[str, Arrays] = {
            "environments": dict(self.environments.arrays()),
            "sampler": self.sampler.arrays(),
            "pool": self._pool.arrays(),
            "update": self._update.arrays(),
            "network": {name: one.numpy() for name, one in learner.network.state_dict().items()},
            "statistics": _arrays(learner.statistics),
            "whitening": _arrays(learner.whitening),
        }
        if learner.model is not None:
            parts["model"] = _arrays(learner.model)
        if self._known is not None:
            parts["standard"], parts["moments"] = _arrays(self._known.standard), _arrays(self._known.moments)
        if self._variance is not None:
            parts["variance"] = {"explored": self._variance}
        arrays = {f"{part}.{name}": np.array(one) for part, named in parts.items() for name, one in named.items()}
        generators = [self._acting, self._learning, *self.environments.generators()]
        return arrays, {
            "generators": [one.bit_generator.state for one in generators],
            "updates": self.updates,
            "steps": self.steps,
            "skipped": self._skipped,
            "cpu_s": self._cpu,
            "past": self._known.past if self._known else 0,
        }

    def take_up(self, arrays: Arrays, rest: dict[str, Any]) -> None:
        """Go on from what `put_away` gave, of the same task, method, schedule and seed."""
        self.updates, self.steps = int(rest["updates"]), int(rest["steps"])
        self._skipped, self._cpu = int(rest["skipped"]), float(rest["cpu_s"])
        learner = self.learner
        learner.statistics = Statistics(**_fields(under(arrays, "statistics")))
        learner.whitening = Whitening(**_fields(under(arrays, "whitening")))
        weights = under(arrays, "network")
        learner.network.load_state_dict({name: torch.from_numpy(np.array(one)) for name, one in weights.items()})
        if model := under(arrays, "model"):
            learner.model = LinearFilter(**_fields(model))
            self.sampler.memory = self._predictive(learner.model)
        if moments := under(arrays, "moments"):
            standard = Standard(**_fields(under(arrays, "standard")))
            self._known = Known(standard, int(rest["past"]), Moments(**_fields(moments)))
        if variance := under(arrays, "variance"):
            self._variance = np.array(variance["explored"], np.float64)
        self._update = make_update(self.method, learner)
        self._update.restore(learner, under(arrays, "update"))
        self._pool.restore(under(arrays, "pool"))
        self.environments.restore(under(arrays, "environments"))
        self.sampler.restore(under(arrays, "sampler"))
        generators = [self._acting, self._learning, *self.environments.generators()]
        for generator, state in zip(generators, rest["generators"], strict=True):
            generator.bit_generator.state = state

    def _first(self) -> tuple[Batch, Episodes]:
        """The blind batch; a predictive memory is made of it."""
        size = self.sampler.memory.size
        blind = ActorCritic(
            size, self.environments.action_size, replace(self.method.network, recurrent=0), torch.Generator()
        )
        if self.method.filter is None:
            blind = self.learner.network
        batch, episodes = self.sampler.collect(blind, no_whitening(size), self.schedule.length, self._acting)
        self._variance = np.maximum(np.nanvar(batch.after, axis=(0, 1)), 1e-12)
        if self.method.filter is None:
            return batch, episodes
        self._pool.add(batch)
        settings, explored = self._innovation(self.method.filter), self._pool.trajectories()
        if self.method.filter.random:
            self.learner.model = random_filter(explored, settings.dimension, self._learning)
        else:
            self.learner.model, self._known = learn_filter(explored, settings, None, 100)
        self.sampler.memory = self._predictive(self.learner.model)
        return replay(self.sampler.memory, batch), episodes

    def _next(self) -> tuple[Batch, Episodes]:
        batch, episodes = self.sampler.collect(
            self.learner.network, self.learner.whitening, self.schedule.length, self._acting
        )
        if self.method.filter:
            self._pool.add(batch)
        return batch, episodes

    def _refit(self) -> tuple[bool, float]:
        """Learn the filter anew, where that is due and the policy stays what it was; whether, and how far it moves."""
        settings = self.method.filter
        if settings is None or settings.refit_every == 0 or self.updates % settings.refit_every:
            return False, np.nan
        trajectories = self._pool.trajectories()
        model, self._known = learn_filter(
            trajectories, self._innovation(settings), self._known, settings.gap_iterations
        )
        order = self._learning.permutation(len(trajectories.lengths))
        enough = int(np.searchsorted(np.cumsum(trajectories.lengths[order]), settings.compared)) + 1
        compared = trajectories.take(np.sort(order[:enough]))
        method = self.method
        adoption = adopt(
            self.learner, model, compared, method.window, self._centre, settings.most_divergence, method.floor
        )
        return adoption.accepted, adoption.divergence

    def _follow_model(self) -> None:
        """Where the learner's model is another now, filter the running episodes with it from their beginnings."""
        memory = self.sampler.memory
        if not isinstance(memory, Predictive) or self.learner.model is None or memory.model is self.learner.model:
            return
        memory.model = self.learner.model
        memory.state = replace(states_at_end(memory.model, self._pool.running()), skipped=memory.state.skipped)
        self.sampler.begin_anew()

    def _skipped_by_filter(self) -> int:
        memory = self.sampler.memory
        return int(memory.state.skipped.sum()) if isinstance(memory, Predictive) else 0

    def _check(self) -> None:
        for name, one in self.learner.network.named_parameters():
            if not bool(torch.isfinite(one).all()):
                raise Diverged(f"{name} is not finite after update {self.updates}, {self.steps} steps")

    def _predictive_size(self) -> int:
        assert self.method.filter is not None
        o, actions = self.environments.observation_size, self.environments.action_size
        size: int = self._innovation(self.method.filter).dimension + self.method.window * (o + 1 + actions)
        return size

    def _innovation(self, settings: FilterSettings) -> InnovationSettings:
        dimension = settings.dimension or 2 * self.environments.observation_size
        return replace(settings.innovation, dimension=dimension)

    def _predictive(self, model: LinearFilter) -> Memory:
        n, actions = self.schedule.copies, self.environments.action_size
        window = Window(n, self.method.window, self._centre, actions) if self.method.window else None
        return Predictive(n, model, actions, window)


def make_update(method: Method, learner: Learner) -> Update:
    """The update that the method's settings are of."""
    match method.update:
        case PPOSettings():
            return PPO(learner, method.update)
        case TRPOSettings():
            return TRPO(learner, method.update)
        case VRPGSettings():
            return VRPG(learner, method.update)
        case AlternatingSettings():
            return Alternating(learner, method.update)


def _arrays(record: Any) -> Arrays:
    return {one.name: np.array(getattr(record, one.name)) for one in fields(record)}


def _fields(arrays: Arrays) -> dict[str, Any]:
    """The fields that `_arrays` took apart; an array of no axes was a number."""
    return {name: one.item() if one.ndim == 0 else np.array(one) for name, one in arrays.items()}


def _rows(settings: FilterSettings | None, task: EnvironmentSettings) -> int:
    if settings is None:
        return 0
    return settings.gap_rows if task.drop > 0.0 else settings.rows
