"""Filters of predictive states: what all of them offer.

A filter's state q_t says what is expected of the observations from o_t on, whatever actions are taken. It is updated
by an action and the observation that it led to; where that observation is missing, by the action alone. States stay
finite: a step that would not be is skipped, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from predplan.control.tasks import BoolArray, FloatArray, IntArray
from predplan.control.trajectories import Trajectories


@dataclass(frozen=True)
class FilterState:
    """States of n copies."""

    mean: FloatArray  # [n, p] q
    covariance: FloatArray  # [n, p, p] P; [n, 0, 0] where a filter has none
    skipped: IntArray  # [n] steps that were skipped since the start: their numbers were not finite

    def take(self, rows: IntArray | BoolArray) -> FilterState:
        """Those copies."""
        return FilterState(self.mean[rows], self.covariance[rows], self.skipped[rows])

    def put(self, rows: IntArray | BoolArray, other: FilterState) -> FilterState:
        """The same with those copies in the states of another."""
        mean, covariance, skipped = self.mean.copy(), self.covariance.copy(), self.skipped.copy()
        mean[rows], covariance[rows], skipped[rows] = other.mean, other.covariance, other.skipped
        return FilterState(mean, covariance, skipped)


class PredictiveModel(Protocol):
    """What learned a filter. Observations are in the task's units, actions in [-1, 1]; all functions are pure."""

    @property
    def state_size(self) -> int:
        """p."""

    @property
    def observation_size(self) -> int:
        """O."""

    def initial(self, copies: int) -> FilterState:
        """States before o_0."""

    def update(self, state: FilterState, action: FloatArray, observation: FloatArray) -> FilterState:
        """q' of q, a [n, A] and o [n, O]; rows of o that are not finite are missing."""

    def predict(self, state: FilterState, action: FloatArray) -> FloatArray:
        """E[o | q, a] [n, O]."""


@dataclass(frozen=True)
class Filtered:
    """A filter's way through trajectories of n rows."""

    state: FloatArray  # [n, p] q_t, before o_t; what is known of q_t is what came up to t - 1
    after: FloatArray  # [n, p] q_{t + 1}, which o_t is part of: what a policy acts on
    prediction: FloatArray  # [n, O] of o_t given q_t and a_t
    skipped: int  # steps that were skipped


def filter_trajectories(model: PredictiveModel, trajectories: Trajectories) -> Filtered:
    """Filter all trajectories side by side."""
    n, longest = len(trajectories.observation), int(trajectories.lengths.max())
    before = np.empty((n, model.state_size))
    after, prediction = np.empty_like(before), np.empty((n, model.observation_size))
    # Longest first: those still running are the first of them.
    order = np.argsort(-trajectories.lengths, kind="stable")
    first, lengths = trajectories.first[:-1][order], trajectories.lengths[order]
    state, skipped = model.initial(len(order)), 0
    for step in range(longest):
        running = int(np.searchsorted(-lengths, -step, side="left"))
        if running < len(state.mean):
            skipped += int(state.skipped[running:].sum())
            state = state.take(np.arange(running))
        rows = first[:running] + step
        action = trajectories.action[rows]
        before[rows], prediction[rows] = state.mean, model.predict(state, action)
        state = model.update(state, action, trajectories.observation[rows])
        after[rows] = state.mean
    return Filtered(before, after, prediction, skipped + int(state.skipped.sum()))
