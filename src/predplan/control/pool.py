"""The latest steps of every copy, as trajectories that begin where episodes began."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from predplan.control.memories import Arrays
from predplan.control.sampling import Batch
from predplan.control.tasks import BoolArray, IntArray
from predplan.control.trajectories import Trajectories

NAMES = ("observation", "action", "reward", "terminated", "truncated", "begins")


class Pool:
    """Of each copy, rows of its latest episodes, the first of them whole."""

    def __init__(self, copies: int, capacity: int) -> None:
        """capacity, in rows of all copies, is exceeded by the start of an episode, and by a batch that is longer."""
        self._capacity = max(1, capacity // copies)
        self._rows: list[dict[str, NDArray[Any]]] = [{} for _ in range(copies)]

    def add(self, batch: Batch) -> None:
        """The steps of a batch."""
        for copy, old in enumerate(self._rows):
            new = _rows(batch, copy)
            joined = {name: np.concatenate([old[name], new[name]]) if old else new[name] for name in NAMES}
            starts = np.flatnonzero(joined["begins"])
            # A batch that goes on with an episode acted first after the row before its own.
            rows = max(self._capacity, len(new["begins"]) + 1)
            kept = starts[starts <= max(len(joined["begins"]) - rows, 0)][-1]
            self._rows[copy] = {name: one[kept:] for name, one in joined.items()}

    def trajectories(self) -> Trajectories:
        """All episodes, those still running too."""
        return _joined(self._rows)

    def of_batch(self, batch: Batch) -> tuple[Trajectories, IntArray]:
        """The episodes of the batch just added, from their beginnings, and the rows [T, n] after which it acted."""
        parts, rows, at = [], [], 0
        for copy, kept in enumerate(self._rows):
            begins = batch.begins[:-1, copy]
            acted = len(kept["begins"]) - len(begins) - int(begins.sum()) + _steps(begins) - 1
            start = np.flatnonzero(kept["begins"][: acted[0] + 1])[-1]
            parts.append({name: one[start:] for name, one in kept.items()})
            rows.append(acted - start + at)
            at += len(kept["begins"]) - start
        return _joined(parts), np.array(rows).T

    def running(self) -> Trajectories:
        """The latest episode of each copy."""
        every = self.trajectories()
        last = np.cumsum([int(rows["begins"].sum()) for rows in self._rows]) - 1
        return every.take(last)

    def arrays(self) -> Arrays:
        """What the pool holds."""
        return {f"{name}.{copy}": one for copy, rows in enumerate(self._rows) for name, one in rows.items()}

    def restore(self, arrays: Arrays) -> None:
        """Hold that."""
        for copy in range(len(self._rows)):
            self._rows[copy] = {name: arrays[f"{name}.{copy}"] for name in NAMES if f"{name}.{copy}" in arrays}


def _joined(parts: list[dict[str, NDArray[Any]]]) -> Trajectories:
    joined = {name: np.concatenate([part[name] for part in parts]) for name in NAMES}
    begins = joined.pop("begins")
    return Trajectories(**joined, first=np.concatenate([np.flatnonzero(begins), [len(begins)]]))


def _steps(begins: BoolArray) -> IntArray:
    """Rows of the steps, among which each beginning takes a row of its own before its step."""
    rows: IntArray = np.arange(len(begins)) + np.cumsum(begins)
    return rows


def _rows(batch: Batch, copy: int) -> dict[str, NDArray[Any]]:
    """A row for each step, with the action and the observation it led to, and one for the start of each episode."""
    begins = batch.begins[:-1, copy]
    step = _steps(begins)
    start = step[begins] - 1
    count = len(begins) + len(start)
    observation = np.empty((count, batch.after.shape[2]))
    observation[step], observation[start] = batch.after[:, copy], batch.observation[:-1, copy][begins]
    rows: dict[str, NDArray[Any]] = {"observation": observation}
    for name in ("action", "reward", "terminated", "truncated"):
        of_steps = getattr(batch, name)[:, copy]
        rows[name] = np.zeros((count, *of_steps.shape[1:]), of_steps.dtype)
        rows[name][step] = of_steps
    rows["begins"] = np.zeros(count, np.bool_)
    rows["begins"][start] = True
    return rows
