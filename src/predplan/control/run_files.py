"""Runs as folders: what was learned, how learning went, and what it goes on from when it was interrupted.

checkpoint.safetensors   written every so many updates
learning.parquet         a row an update
runs.parquet             the run in one row; written last, so that a run that has it is done
policy.json, ...         the policy (`policy_files`), unless learning diverged
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from predplan.artifacts.provenance import Provenance
from predplan.control.policy_files import save_policy
from predplan.control.records import learning_rows, run_row
from predplan.control.running import Order, Run, run
from predplan.control.tables import FINISHED, LEARNING, RUNS, write_rows
from predplan.control.training import Progress
from predplan.errors import InputError

CHECKPOINT, CURVE, ROW = "checkpoint.safetensors", "learning.parquet", "runs.parquet"


def run_into(folder: Path, order: Order, every: int = 20, report: Callable[[Progress], None] | None = None) -> Run:
    """Learn, going on from the folder's checkpoint where there is one, and leave everything in the folder.

    Raises InputError as `running.run`, or where the folder is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; expected a folder to write to")
    found = run(order, folder / CHECKPOINT, every, report)
    provenance = Provenance(_params(order), order.seed)
    write_rows(folder / CURVE, LEARNING, learning_rows(found), provenance)
    if found.reason == FINISHED:
        save_policy(folder, found.learned)
    write_rows(folder / ROW, RUNS, [run_row(found)], provenance)
    return found


def _params(order: Order) -> dict[str, object]:
    """Plain data; threads change nothing that is learned."""
    task = {name: value for name, value in asdict(order.task).items() if name != "threads"}
    return {"task": task, "method": order.method, "schedule": asdict(order.schedule)}
