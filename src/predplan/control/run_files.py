"""Runs as folders: what was learned, how learning went, and what it goes on from when it was interrupted.

checkpoint.safetensors   written every so many updates
learning.parquet         a row an update
runs.parquet             the run in one row; written last, so that a run that has it is done
policy.json, ...         the policy (`policy_files`), unless learning diverged
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_rows, write_rows
from predplan.control.policy_files import save_policy
from predplan.control.records import learning_rows, run_row
from predplan.control.running import Order, Run, run
from predplan.control.tables import FINISHED, LEARNING, RUNS, Row
from predplan.control.training import Progress
from predplan.errors import InputError

CHECKPOINT, CURVE, ROW = "checkpoint.safetensors", "learning.parquet", "runs.parquet"


def run_into(folder: Path, order: Order, every: int = 20, report: Callable[[Progress], None] | None = None) -> Run:
    """Learn, going on from the folder's checkpoint where there is one, and leave everything in the folder.

    Raises InputError as `running.run`, or where the folder is a file or would lie in one.
    """
    there = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    if there.exists() and not there.is_dir():
        raise InputError(f"{there} is a file; expected a folder to write to")
    found = run(order, folder / CHECKPOINT, every, report)
    params = {name: value for name, value in order.sheet().items() if name in ("task", "method", "schedule")}
    provenance = Provenance(params, order.seed)
    write_rows(folder / CURVE, LEARNING, learning_rows(found), provenance)
    if found.reason == FINISHED:
        save_policy(folder, found.learned)
    write_rows(folder / ROW, RUNS, [run_row(found)], provenance)
    return found


def finished_rows(folder: Path, order: Order, every: int = 20) -> tuple[list[Row], Row]:
    """Rows of the tables `learning` and `runs`: from the folder where the run is done, else after it was.

    What only an interrupted run needs is then removed. A run that diverged is done as well.
    """
    if not (folder / ROW).exists():
        run_into(folder, order, every)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    (row,) = read_rows(folder / ROW, RUNS)
    return list(read_rows(folder / CURVE, LEARNING)), row


def run_name(order: Order) -> str:
    """A folder's name for the run: another one wherever anything that was ordered is another."""
    sheet = {name: value for name, value in order.sheet().items() if name != "seed"}
    digest = hashlib.sha256(json.dumps(sheet, sort_keys=True).encode()).hexdigest()
    return f"{order.method}-noise{order.task.noise:g}-drop{order.task.drop:g}-seed{order.seed}-{digest[:8]}"
