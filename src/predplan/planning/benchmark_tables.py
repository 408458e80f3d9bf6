"""The table of plans of MotionBenchMaker's problems, and its summary: a row a planner, and ratios to one of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import pyarrow as pa

from predplan.artifacts.tables import Column, TableSchema
from predplan.planning.benchmarks import Measured
from predplan.planning.robots import FloatArray

_STAGE, _RUNNER = "bench", "make"
_PLANNER = Column("planner", pa.string(), "1", "name of the planner")
_RATIO = "median over problems that both solve of the planner's value over that of the reference"

PLANS = TableSchema(
    "motion-bench plans",
    _STAGE,
    (
        _PLANNER,
        Column("family", pa.string(), "1", "MotionBenchMaker's set"),
        Column("number", pa.int32(), "1", "the problem's number in its set"),
        Column("seed", pa.int32(), "1", "seed of the planner's random numbers"),
        Column("solved", pa.bool_(), "1", "the planner says it has found a path"),
        Column("certified", pa.bool_(), "1", "the whole path is proved free of collision and within joint limits"),
        Column("note", pa.string(), "1", "where the path came from; what it touches where; why there is none"),
        Column("time_s", pa.float64(), "s", "until the path was there, by the wall's clock, one core, warm"),
        Column("cpu_s", pa.float64(), "s", "the same by the processor's clock"),
        Column("preparation_s", pa.float64(), "s", "bringing the problem into the planner's form; not in time_s"),
        Column("conversion_s", pa.float64(), "s", "reading the scene and the request; not in time_s"),
        Column("pieces", pa.int32(), "1", "polynomial pieces of the path; of a polyline, segments"),
        Column("length_rad", pa.float64(), "rad", "length in configuration space; nan without a path, as below"),
        Column("velocity_cost", pa.float64(), "rad2", "half the mean of squared velocity, s in [0, 1], 101 samples"),
        Column("acceleration_cost", pa.float64(), "rad2", "half the mean of squared acceleration, likewise"),
        Column("clearance_m", pa.float64(), "m", "smallest distance to obstacles and between links at 501 samples"),
        Column("duration_s", pa.float64(), "s", "rest to rest within velocity and acceleration limits"),
        Column("line_s", pa.float64(), "s", "the same of the straight line, through whatever is in the way"),
    ),
    _RUNNER,
)
SUMMARY = TableSchema(
    "motion-bench summary",
    _STAGE,
    (
        _PLANNER,
        Column("runs", pa.int32(), "1", "problems times seeds"),
        Column("solved", pa.float64(), "1", "share that the planner says it solved"),
        Column("certified", pa.float64(), "1", "share proved free of collision and within joint limits"),
        Column("time_s", pa.float64(), "s", "median wall time of solved ones; nan without any, as below"),
        Column("time_p95_s", pa.float64(), "s", "95th percentile of the same"),
        Column("cpu_s", pa.float64(), "s", "median processor time of solved ones"),
        Column("cpu_p95_s", pa.float64(), "s", "95th percentile of the same"),
        Column("preparation_s", pa.float64(), "s", "median time of bringing a problem into the planner's form"),
        Column("conversion_s", pa.float64(), "s", "median time of reading a scene and a request"),
        Column("length_rad", pa.float64(), "rad", "median of solved ones, as the following"),
        Column("velocity_cost", pa.float64(), "rad2", "half the mean of squared velocity"),
        Column("acceleration_cost", pa.float64(), "rad2", "half the mean of squared acceleration"),
        Column("clearance_m", pa.float64(), "m", "smallest clearance"),
        Column("duration_s", pa.float64(), "s", "duration"),
        Column("both", pa.int32(), "1", "runs that the planner and the reference solve"),
        Column("length_ratio", pa.float64(), "1", _RATIO),
        Column("acceleration_ratio", pa.float64(), "1", _RATIO),
        Column("duration_ratio", pa.float64(), "1", _RATIO),
        Column("time_ratio", pa.float64(), "1", "the reference's median wall time over the planner's"),
    ),
    _RUNNER,
)


def rows_of(measured: Iterable[Measured]) -> list[dict[str, Any]]:
    """Rows of PLANS."""
    return [asdict(each) for each in measured]


def measured_of(rows: Iterable[Mapping[str, Any]]) -> list[Measured]:
    """What rows of PLANS say."""
    return [Measured(**{field.name: row[field.name] for field in fields(Measured)}) for row in rows]


def summarise(plans: Sequence[Measured], reference: str) -> list[dict[str, Any]]:
    """Rows of SUMMARY, planners in their order; ratios are to `reference` and nan where that has not run."""
    planners = list(dict.fromkeys(plan.planner for plan in plans))
    by_planner = {planner: [plan for plan in plans if plan.planner == planner] for planner in planners}
    return [_row(planner, mine, by_planner.get(reference, [])) for planner, mine in by_planner.items()]


def _row(planner: str, plans: Sequence[Measured], reference: Sequence[Measured]) -> dict[str, Any]:
    solved = [plan for plan in plans if plan.solved]
    others = {(plan.family, plan.number, plan.seed): plan for plan in reference if plan.solved}
    pairs = [(plan, others[key]) for plan in solved if (key := (plan.family, plan.number, plan.seed)) in others]
    medians = ("length_rad", "velocity_cost", "acceleration_cost", "clearance_m", "duration_s", "time_s", "cpu_s")
    mine, theirs = ([pair[side] for pair in pairs] for side in range(2))
    return {
        "planner": planner,
        "runs": len(plans),
        "solved": len(solved) / len(plans),
        "certified": sum(plan.certified for plan in plans) / len(plans),
        **{name: _quantile(_values(solved, name), 0.5) for name in medians},
        **{f"{name}_p95_s": _quantile(_values(solved, f"{name}_s"), 0.95) for name in ("time", "cpu")},
        "preparation_s": _quantile(_values(plans, "preparation_s"), 0.5),
        "conversion_s": _quantile(_values(plans, "conversion_s"), 0.5),
        "both": len(pairs),
        "length_ratio": _ratio(mine, theirs, "length_rad"),
        "acceleration_ratio": _ratio(mine, theirs, "acceleration_cost"),
        "duration_ratio": _ratio(mine, theirs, "duration_s"),
        "time_ratio": _quantile(_values(list(others.values()), "time_s"), 0.5)
        / _quantile(_values(solved, "time_s"), 0.5),
    }


def _ratio(mine: Sequence[Measured], theirs: Sequence[Measured], name: str) -> float:
    ours, other = _values(mine, name), _values(theirs, name)
    # A straight line has no acceleration; where neither has any they are equal.
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where((ours < 1e-9) & (other < 1e-9), 1.0, ours / other)
    return _quantile(ratios, 0.5)


def _values(plans: Sequence[Measured], name: str) -> FloatArray:
    return np.array([getattr(plan, name) for plan in plans], dtype=np.float64)


def _quantile(values: FloatArray, share: float) -> float:
    kept = values[~np.isnan(values)]
    return float(np.quantile(kept, share)) if len(kept) else float("nan")
