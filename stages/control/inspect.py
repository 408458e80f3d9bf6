"""Make a recording, to be opened in Rerun, of each rollout and of the tables of a task."""

from __future__ import annotations

import shutil

from predplan.inspection import record
from stages.common import TaskStage, run_stage

TABLES = ("learning", "runs", "prediction")


def main(stage: TaskStage) -> None:
    folder = stage.path("recordings")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in TABLES:
        record(stage.path(f"{name}.parquet"), folder / f"{name}.rrd")
    for rollouts in sorted(stage.path("rollouts").glob("*.mcap")):
        record(rollouts, folder / f"{rollouts.stem}.rrd")


if __name__ == "__main__":
    run_stage(TaskStage, main)
