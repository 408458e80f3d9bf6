"""The control branch's tables: their schemas, and rows to and from files.

A run is named by the columns of RUN: task, condition (noise and drop), method and seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import pyarrow as pa

from predplan.artifacts.tables import Column, TableSchema

Row: TypeAlias = Mapping[str, Any]
"""A table's row, by the columns of its schema."""

CONDITION = ("task", "noise", "drop")
RUN = (*CONDITION, "method", "seed")
FINISHED, DIVERGED = "finished", "diverged"

_TASK = Column("task", pa.string(), "1", "name of the task")
_NOISE = Column("noise", pa.float64(), "1", "standard deviation of the observation noise, in each coordinate's scale")
_DROP = Column("drop", pa.float64(), "1", "chance that an observation is lost")
_CONDITION = (_TASK, _NOISE, _DROP)
_METHOD = Column("method", pa.string(), "1", "name of the method")
_SEED = Column("seed", pa.int64(), "1", "seed of the run; equal seeds of a condition share exploration and starts")
_CPU = Column("cpu_s", pa.float64(), "s", "processor time of the run so far, exploration included")
_SEEDS = Column("seeds", pa.int32(), "1", "runs of the method")

LEARNING = TableSchema(
    "learning",
    "train",
    (
        *_CONDITION,
        _METHOD,
        _SEED,
        Column("update", pa.int32(), "1", "updates done; the first follows the exploration"),
        Column("steps", pa.int64(), "1", "environment steps so far, exploration included"),
        Column("episodes", pa.int32(), "1", "episodes that ended in this batch"),
        Column("return_mean", pa.float64(), "1", "mean return of the episodes that ended in this batch", True),
        Column("return_std", pa.float64(), "1", "standard deviation of their returns", True),
        Column("length_mean", pa.float64(), "1", "mean of their lengths in steps", True),
        Column(
            "prediction_error",
            pa.float64(),
            "1",
            "mean square error one step ahead in this batch, each coordinate over its variance in the exploration",
            True,
        ),
        Column(
            "policy_kl", pa.float64(), "nat", "mean divergence of the policy before the update from that after", True
        ),
        Column("entropy", pa.float64(), "nat", "mean entropy of the policy's actions", True),
        Column("value_error", pa.float64(), "1", "mean square error of the value over the variance of returns", True),
        Column("skipped", pa.int64(), "1", "steps of the filter skipped in this batch: their numbers were not finite"),
        _CPU,
    ),
)
RUNS = TableSchema(
    "runs",
    "train",
    (
        *_CONDITION,
        _METHOD,
        _SEED,
        Column("steps", pa.int64(), "1", "environment steps, exploration included"),
        Column(
            "mean_return",
            pa.float64(),
            "1",
            "mean return over training: area under return against steps, exploration included, over steps",
        ),
        Column("final_return", pa.float64(), "1", "mean return over the last tenth of the steps"),
        Column("steps_to_threshold", pa.int64(), "1", "steps until the batch's mean return passed the threshold", True),
        Column("reason", pa.string(), "1", "finished, or diverged and how"),
        _CPU,
    ),
)
PREDICTION = TableSchema(
    "prediction",
    "initialise",
    (
        *_CONDITION,
        _SEED,
        Column("predictor", pa.string(), "1", "name of what predicts"),
        Column("steps", pa.int32(), "1", "steps ahead; the actions between are known"),
        Column(
            "error",
            pa.float64(),
            "1",
            "mean square error on held-out exploration, each coordinate over its variance: 1 is the mean's",
        ),
        Column("rows", pa.int64(), "1", "observations compared"),
    ),
)
COMPARISONS = TableSchema(
    "comparisons",
    "compare-policies",
    (
        *_CONDITION,
        _METHOD,
        Column("other", pa.string(), "1", "name of the method it is held against"),
        Column("measure", pa.string(), "1", "the column of runs that is compared"),
        _SEEDS,
        Column("other_seeds", pa.int32(), "1", "runs of the other"),
        Column("difference", pa.float64(), "as the measure", "mean of the method less that of the other"),
        Column(
            "standard_error", pa.float64(), "as the measure", "standard error of the difference, as in Welch's t", True
        ),
        Column("t", pa.float64(), "1", "Welch's t", True),
        Column("welch_p", pa.float64(), "1", "its p-value, two-sided", True),
        Column("holm_p", pa.float64(), "1", "the same by Holm's correction for the others of the condition", True),
        Column("pairs", pa.int32(), "1", "seeds that both have"),
        Column("permutation_p", pa.float64(), "1", "p-value of flipping the signs of paired differences", True),
        Column("verdict", pa.string(), "1", "better, worse or no difference by holm_p; too few seeds"),
    ),
)
SUMMARY = TableSchema(
    "control summary",
    "compare-policies",
    (
        *_CONDITION,
        _METHOD,
        _SEEDS,
        Column("mean_return", pa.float64(), "1", "mean over runs of the mean return over training"),
        Column("standard_error", pa.float64(), "1", "its standard error over runs; null for one run", True),
        Column("final_return", pa.float64(), "1", "mean over runs of the mean return over the last tenth of the steps"),
        Column("final_standard_error", pa.float64(), "1", "its standard error over runs; null for one run", True),
        Column("reached", pa.int32(), "1", "runs that passed the threshold"),
        Column(
            "steps_to_threshold", pa.float64(), "1", "median steps until then; runs that never did count as last", True
        ),
        Column("diverged", pa.int32(), "1", "runs that diverged"),
        Column("steps", pa.float64(), "1", "mean steps of a run"),
        Column("cpu_s", pa.float64(), "s", "mean processor time of a run"),
    ),
)
