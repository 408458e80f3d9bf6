"""A policy goes on with another filter, doing as nearly as it can what it did.

States of two filters of one process are, nearly, linear functions of each other. Regressing the old features on the
new ones gives the first layer of the network its new weights; what regression leaves over moves the policy, and where
that is too far the new filter is rejected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from predplan.control.advantages import whitened
from predplan.control.filtering import FilterState, filter_trajectories
from predplan.control.learner import Learner
from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import predictive_features
from predplan.control.networks import divergence
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories
from predplan.control.whitening import Whitening, carry_over, no_statistics, whiten


@dataclass(frozen=True)
class Adoption:
    """What became of a new filter."""

    accepted: bool
    divergence: float  # KL of the policy with the old filter from that with the new one


def adopt(
    learner: Learner,
    model: LinearFilter,
    trajectories: Trajectories,
    window: int,
    centre: FloatArray,
    most_divergence: float,
    floor: float,
) -> Adoption:
    """Put the model in place of the learner's, unless the policy would move by more than most_divergence (nat).

    Features of both filters are compared on the trajectories, with a window of so many rows around centre [O]; the
    divergence is the mean over rows of KL(old policy || new policy). floor is the new whitening's. A model with states
    of another size, or that are not finite, is rejected with a divergence that is infinite.
    """
    assert learner.model is not None
    if model.state_size != learner.model.state_size:
        return Adoption(False, float("inf"))
    network = learner.network
    old, new = (
        predictive_features(filter_trajectories(one, trajectories), trajectories, window, centre)
        for one in (learner.model, model)
    )
    if not np.isfinite(new).all():
        return Adoption(False, float("inf"))
    statistics = no_statistics(new.shape[1]).updated(new, 1.0)
    fresh = whiten(statistics, floor)
    kept = {name: one.clone() for name, one in network.state_dict().items()}
    matrix, offset = _regress(new, old)
    begins = np.zeros((len(new), 1), np.bool_)
    begins[trajectories.first[:-1]] = True

    def mean(features: FloatArray, whitening: Whitening) -> Tensor:
        known = network.known(whitened(features, whitening)[:, None], begins, network.initial(1))
        result: Tensor = network.actor(known)
        return result

    with torch.no_grad():
        before = mean(old, learner.whitening)
        for weight, bias in network.first_layers():
            known = learner.whitening
            carry_over(weight, bias, known.matrix @ matrix, known.matrix @ offset + known.offset, fresh)
        after = mean(new, fresh)
        apart = float(divergence(before, network.log_deviation, after, network.log_deviation).mean())
    if not apart <= most_divergence:
        network.load_state_dict(kept)
        return Adoption(False, apart)
    learner.model, learner.statistics, learner.whitening = model, statistics, fresh
    return Adoption(True, apart)


def states_at_end(model: LinearFilter, trajectories: Trajectories) -> FilterState:
    """Of each trajectory, after its last row."""
    first, lengths = trajectories.first[:-1], trajectories.lengths
    state = model.initial(len(lengths))
    for step in range(int(lengths.max())):
        running = np.flatnonzero(lengths > step)
        rows = first[running] + step
        moved = model.update(state.take(running), trajectories.action[rows], trajectories.observation[rows])
        state = moved if len(running) == len(lengths) else state.put(running, moved)
    return state


def _regress(inputs: FloatArray, outputs: FloatArray, ridge: float = 1e-6) -> tuple[FloatArray, FloatArray]:
    """Matrix and offset of outputs ~ matrix inputs + offset; the ridge is relative to each input's variance."""
    centre, target = inputs.mean(axis=0), outputs.mean(axis=0)
    scale = np.maximum(inputs.std(axis=0), 1e-12)
    x, y = (inputs - centre) / scale, outputs - target
    gram = x.T @ x / len(x) + ridge * np.eye(x.shape[1])
    matrix = np.linalg.solve(gram, x.T @ y / len(x)).T / scale
    return matrix, target - matrix @ centre
