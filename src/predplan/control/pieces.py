"""Trajectories cut into pieces side by side, as arrays of torch: what gradients through time are taken over.

Gradients do not go from a piece to the one before it: they are truncated there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from predplan.control.tasks import BoolArray, FloatArray, IntArray
from predplan.control.trajectories import Trajectories


@dataclass(frozen=True)
class Pieces:
    """n pieces, padded to T rows with their last. Observations are standardised."""

    rows: IntArray  # [T, n] of the trajectories
    action: Tensor  # [T, n, A]
    observation: Tensor  # [T, n, O], NaN where missing
    reset: Tensor  # [T, n] a trajectory's first row
    seen: Tensor  # [T, n] whether there is an observation
    ways: BoolArray  # [m, longest] ways in which trajectories were seen
    way: Tensor  # [T, n] which of them a row's trajectory was
    age: Tensor  # [T, n] rows since the trajectory's first

    @property
    def first(self) -> IntArray:
        """Row [n] of the trajectories that each begins with."""
        first: IntArray = self.rows[0]
        return first


def cut(trajectories: Trajectories, rows: int, shift: FloatArray, scale: FloatArray) -> Pieces:
    """Pieces of at most so many rows, those of a trajectory as long as each other; shift and scale [O] standardise."""
    first, lengths = _edges(trajectories, rows)
    steps = np.arange(lengths.max())[:, None]
    index, inside = first + np.minimum(steps, lengths - 1), steps < lengths
    ways, way = _ways(trajectories)
    observation = (trajectories.observation - shift) / scale
    there = trajectories.seen[index] & inside

    def tensor(values: FloatArray | IntArray | BoolArray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values))

    return Pieces(
        rows=index,
        action=tensor(trajectories.action[index]),
        observation=tensor(np.where(there[..., None], observation[index], np.nan)),
        reset=tensor((trajectories.age == 0)[index] & inside),
        seen=tensor(there),
        ways=ways,
        way=tensor(way[index]),
        age=tensor(trajectories.age[index]),
    )


def _edges(trajectories: Trajectories, rows: int) -> tuple[IntArray, IntArray]:
    """First rows and lengths of pieces."""
    first, lengths = [], []
    for start, length in zip(trajectories.first[:-1], trajectories.lengths, strict=True):
        edges = np.linspace(0, length, -(-length // rows) + 1).astype(np.int64)
        first.append(start + edges[:-1])
        lengths.append(np.diff(edges))
    return np.concatenate(first), np.concatenate(lengths)


def _ways(trajectories: Trajectories) -> tuple[BoolArray, IntArray]:
    """Rows seen [m, longest] of each trajectory, one for all where nothing is missing, and whose each row is [n]."""
    longest, count = int(trajectories.lengths.max()), len(trajectories.lengths)
    if trajectories.seen.all():
        return np.ones((1, longest), np.bool_), np.zeros(len(trajectories.observation), np.int64)
    owner = np.repeat(np.arange(count), trajectories.lengths)
    ways = np.zeros((count, longest), np.bool_)
    ways[owner, trajectories.age] = trajectories.seen
    return ways, owner
