"""Tables of speeds: sampling and training on this machine, and whole trainings beside a peer's."""

from __future__ import annotations

import pyarrow as pa

from predplan.artifacts.tables import Column, TableSchema

_STAGE, _RUNNER = "bench", "make"
_TASK = Column("task", pa.string(), "1", "name of the task, positions observed exactly")

SPEEDS = TableSchema(
    "control speeds",
    _STAGE,
    (
        _TASK,
        Column("threads", pa.int32(), "1", "threads that step MuJoCo"),
        Column("raw", pa.float64(), "1/s", "steps of all copies by the wall's clock, MuJoCo alone"),
        Column("sampling", pa.float64(), "1/s", "the same with a policy on predictive states"),
        Column("training", pa.float64(), "1/s", "steps of a whole training by the processor's clock"),
    ),
    _RUNNER,
)
PEERS = TableSchema(
    "control peers",
    _STAGE,
    (
        _TASK,
        Column("learner", pa.string(), "1", "rpsp, or a peer's name"),
        Column("seed", pa.int64(), "1", "seed of the run"),
        Column("steps", pa.int64(), "1", "environment steps that were to be made"),
        Column("mean_return", pa.float64(), "1", "mean return over training, as in the table `runs`"),
        Column("final_return", pa.float64(), "1", "mean return over the last tenth of the steps"),
        Column("cpu_s", pa.float64(), "s", "processor time of the run"),
    ),
    _RUNNER,
)
