"""Whole runs: from a checkpoint where there is one, to the last step or to where learning diverged."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from predplan.artifacts.tensors import read_tensors, write_tensors
from predplan.control.bounds import check_whole
from predplan.control.environments import EnvironmentSettings
from predplan.control.learned import Learned
from predplan.control.memories import under
from predplan.control.methods import find_method
from predplan.control.training import Diverged, Progress, Schedule, Training
from predplan.errors import InputError

KIND = "predplan training"
THRESHOLDS = {"cartpole": 195.0}
"""Mean returns at which a task counts as solved."""
SMOOTHED = 5
"""Batches whose mean return is held against the threshold."""


@dataclass(frozen=True)
class Order:
    """What is to be learned."""

    task: EnvironmentSettings
    method: str
    schedule: Schedule
    seed: int

    def __post_init__(self) -> None:
        find_method(self.method)
        check_whole(self, "seed", least=0)

    def sheet(self) -> dict[str, object]:
        """All that decides what is learned, as JSON gives it back; threads change nothing."""
        task = {name: value for name, value in asdict(self.task).items() if name != "threads"}
        whole = {
            "task": task,
            "method": self.method,
            "settings": asdict(find_method(self.method)),
            "schedule": asdict(self.schedule),
            "seed": self.seed,
        }
        return dict(json.loads(json.dumps(whole, allow_nan=False)))


@dataclass(frozen=True)
class Run:
    """What came of it."""

    order: Order
    progress: list[Progress]
    learned: Learned
    reason: str  # 'finished', or 'diverged: ...'


def run(
    order: Order, checkpoint: Path | None = None, every: int = 20, report: Callable[[Progress], None] | None = None
) -> Run:
    """Learn. With a checkpoint, go on from it, put everything away every so many updates, and at the end.

    Raises InputError for an unknown task or method, and where the checkpoint is damaged or of another order.
    """
    if every < 1:
        raise InputError(f"every: found {every}, expected at least 1")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        training = Training(order.task, find_method(order.method), order.schedule, order.seed)
        with training.environments:
            progress = _resume(training, order, checkpoint) if checkpoint and checkpoint.exists() else []
            reason = "finished"
            while not training.done:
                try:
                    # What is not finite is skipped and counted, or ends the run: warnings would say no more.
                    with np.errstate(all="ignore"):
                        progress.append(training.advance())
                except Diverged as error:
                    reason = f"diverged: {error}"
                    break
                if report:
                    report(progress[-1])
                if checkpoint and (training.updates % every == 0 or training.done):
                    _put_away(training, order, progress, checkpoint)
            return Run(order, progress, _learned(training, order), reason)
    finally:
        torch.set_num_threads(threads)


def steps_to_threshold(progress: Sequence[Progress], task: str) -> int | None:
    """Steps after which the mean return of SMOOTHED batches reached the task's threshold; None: never, or none is set.

    Returns of batches in which no episode ended are those of the batches around them.
    """
    returns = np.array([one.return_mean for one in progress])
    known = np.isfinite(returns)
    if task not in THRESHOLDS or len(returns) < SMOOTHED or not known.any():
        return None
    steps = np.array([one.steps for one in progress], np.float64)
    filled = np.interp(steps, steps[known], returns[known])
    smooth = np.convolve(filled, np.full(SMOOTHED, 1.0 / SMOOTHED), mode="valid")
    passed = np.flatnonzero(smooth >= THRESHOLDS[task])
    return int(steps[passed[0] + SMOOTHED - 1]) if len(passed) else None


def _learned(training: Training, order: Order) -> Learned:
    learner, environments = training.learner, training.environments
    return Learned(
        order.task,
        order.method,
        training.method,
        environments.observation_size,
        environments.action_size,
        learner.network,
        learner.whitening,
        learner.model,
    )


def _put_away(training: Training, order: Order, progress: list[Progress], path: Path) -> None:
    arrays, rest = training.put_away()
    columns = {f"progress.{name}": np.array([getattr(one, name) for one in progress]) for name in asdict(progress[0])}
    write_tensors(path, arrays | columns, KIND, {"order": order.sheet(), "training": rest})


def _resume(training: Training, order: Order, path: Path) -> list[Progress]:
    arrays, sheet = read_tensors(path, KIND)
    found = sheet.get("order", {})
    for name, wanted in order.sheet().items():
        if found.get(name) != wanted:
            raise InputError(f"{path}: {name}: found {found.get(name)}, expected {wanted}; choose another folder")
    columns = {name: one.tolist() for name, one in under(arrays, "progress").items()}
    rest = {name: one for name, one in arrays.items() if not name.startswith("progress.")}
    try:
        training.take_up(rest, sheet["training"])
        return [Progress(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: damaged: {error!r}") from error
