"""Learn with every method in every condition from every seed; an interrupted stage goes on where it was.

Runs lie in the folder `runs`, which DVC knows nothing of: those that are done are not repeated, whatever made the
stage run again. After a change to the code that learns, remove the folder.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from predplan.artifacts.tables import write_rows
from predplan.control.run_files import finished_rows, run_name
from predplan.control.running import Order
from predplan.control.tables import FINISHED, LEARNING, RUNS
from predplan.parallel import run
from stages.common import TaskStage, run_stage
from stages.control.ordered import orders, policy_name

POLICY = ("filter.json", "filter.safetensors", "network.safetensors", "policy.json")


def main(stage: TaskStage) -> None:
    collect(stage, orders(stage))


def collect(stage: TaskStage, ordered: Sequence[Order]) -> None:
    """Tables of these runs, after those that are not done were made; policies of the first seed."""
    work = partial(learn, folder=stage.path("runs"), every=stage.settings.control.every)
    found = run(work, ordered, workers=stage.settings.workers, scheduler=stage.settings.scheduler)
    learning: list[Mapping[str, Any]] = []
    runs: list[Mapping[str, Any]] = []
    for order, (curve, row) in zip(ordered, found, strict=True):
        learning += curve
        runs.append(row)
        if sys.stderr.isatty():
            told = (
                f"{len(runs)}/{len(ordered)} {run_name(order)}: mean return {row['mean_return']:.1f}, {row['reason']}"
            )
            sys.stderr.write(told + "\n")
        if order.seed == 0 and row["reason"] == FINISHED:
            keep_policy(stage.path("runs") / run_name(order), stage.path("policies") / policy_name(order))
    stage.path("policies").mkdir(parents=True, exist_ok=True)
    provenance = stage.provenance(settings=stage.task)
    write_rows(stage.path("learning.parquet"), LEARNING, learning, provenance)
    write_rows(stage.path("runs.parquet"), RUNS, runs, provenance)


def learn(order: Order, folder: Path, every: int) -> tuple[list[Mapping[str, Any]], Mapping[str, Any]]:
    """One run, in a folder of its own."""
    return finished_rows(folder / run_name(order), order, every)


def keep_policy(run_folder: Path, kept: Path) -> None:
    """Copy a run's policy."""
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    for name in POLICY:
        if (run_folder / name).exists():
            shutil.copyfile(run_folder / name, kept / name)


if __name__ == "__main__":
    run_stage(TaskStage, main)
