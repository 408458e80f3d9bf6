"""Tables of the runs of a task that are done, however many are still to come, and what the report needs of them.

    python -m stages.control.done thesis/params.yaml hopper

For a branch that takes days: `train` goes on in the background, and this tells of what there is.
"""

from __future__ import annotations

from predplan.control.run_files import run_name
from predplan.errors import PredplanError
from stages.common import TaskStage, run_stage
from stages.control import compare
from stages.control.ordered import orders
from stages.control.train import collect


def main(stage: TaskStage) -> None:
    done = [order for order in orders(stage) if (stage.path("runs") / run_name(order) / "runs.parquet").exists()]
    if not done:
        raise PredplanError(f"{stage.path('runs')} has no run that is done; expected one at least")
    collect(stage, done)
    compare.main(stage)


if __name__ == "__main__":
    run_stage(TaskStage, main)
