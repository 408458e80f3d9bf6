"""Policies, samplers and batches of real tasks, small enough to be checked number by number."""

from dataclasses import replace

import numpy as np
import torch

from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.learner import Learner
from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import Memory, Predictive, Window
from predplan.control.methods import FilterSettings
from predplan.control.networks import ActorCritic, NetworkSettings
from predplan.control.pool import Pool
from predplan.control.refitting import learn_filter
from predplan.control.sampling import Batch, Sampler
from predplan.control.trajectories import Trajectories
from predplan.control.whitening import no_statistics, no_whitening

CARTPOLE = EnvironmentSettings("cartpole", threads=1, horizon=7)
"""Short enough for episodes to be cut by the horizon as well as to end by themselves."""
SWIMMER = EnvironmentSettings("swimmer", threads=1, horizon=12)


def seeing_network(features: int, actions: int, recurrent: int = 0, seed: int = 0) -> ActorCritic:
    """A small policy whose mean and value depend on what it is told."""
    network = ActorCritic(features, actions, NetworkSettings((16,), recurrent), torch.Generator().manual_seed(seed))
    with torch.no_grad():
        last = network.actor[-1]
        assert isinstance(last, torch.nn.Linear)
        torch.nn.init.normal_(last.weight, std=0.3, generator=torch.Generator().manual_seed(seed + 1))
    return network


def sampler(
    settings: EnvironmentSettings,
    copies: int = 4,
    window: int = 2,
    recurrent: int = 0,
    model: LinearFilter | None = None,
    seed: int = 0,
) -> Sampler:
    """Copies told of a window, or of a filter's state and a window, 0 for none."""
    environments = Environments(settings, copies, np.random.default_rng(seed))
    return Sampler(environments, memory(environments, window, model), recurrent)


def memory(environments: Environments, window: int, model: LinearFilter | None = None) -> Memory:
    """What `sampler` remembers with."""
    copies, o, actions = environments.copies, environments.observation_size, environments.action_size
    last = Window(copies, window, np.zeros(o), actions) if window else None
    if model is not None:
        return Predictive(copies, model, actions, last)
    assert last is not None
    return last


def learned_filter(settings: EnvironmentSettings, copies: int = 8, length: int = 60) -> LinearFilter:
    """A filter of a blind policy's steps."""
    made = sampler(settings, copies)
    pool = Pool(copies, 100_000)
    pool.add(collect(made, seeing_network(made.memory.size, made.environments.action_size), length)[0])
    o = made.environments.observation_size
    found = replace(FilterSettings().innovation, dimension=2 * o)
    return learn_filter(pool.trajectories(), found, None, 20)[0]


def collect(made: Sampler, network: ActorCritic, length: int, seed: int = 5) -> tuple[Batch, Learner]:
    """A batch, and the learner that it is of: whitened by it, outputs being what they were."""
    whitening = no_whitening(made.memory.size)
    batch, _ = made.collect(network, whitening, length, np.random.default_rng(seed))
    return batch, Learner(network, no_statistics(made.memory.size), whitening)


def uneven(trajectories: Trajectories, lengths: list[int]) -> Trajectories:
    """The first rows of each trajectory, as many as lengths say."""
    rows = np.concatenate([start + np.arange(n) for start, n in zip(trajectories.first[:-1], lengths, strict=True)])
    return Trajectories(
        trajectories.observation[rows],
        trajectories.action[rows],
        trajectories.reward[rows],
        trajectories.terminated[rows],
        trajectories.truncated[rows],
        np.concatenate([[0], np.cumsum(lengths)]),
    )
