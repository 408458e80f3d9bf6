"""Compare the methods of a task: means, tests, and what the report draws."""

from __future__ import annotations

import shutil

from predplan.artifacts.files import write_json, write_whole
from predplan.artifacts.tables import read_rows, write_rows
from predplan.control.comparing import compare_all, summarise
from predplan.control.curves import learning_curves
from predplan.control.tables import COMPARISONS, LEARNING, RUNS, SUMMARY
from stages.common import TaskStage, run_stage

TOLD = ("learning.parquet", "runs.parquet", "prediction.parquet")


def main(stage: TaskStage) -> None:
    runs = read_rows(stage.path("runs.parquet"), RUNS)
    summary = summarise(runs)
    provenance = stage.provenance(stage.path("runs.parquet"))
    write_rows(stage.result("comparisons.parquet"), COMPARISONS, compare_all(runs), provenance)
    write_rows(stage.result("summary.parquet"), SUMMARY, summary, provenance)
    for name in TOLD:
        with write_whole(stage.result(name)) as temporary:
            shutil.copyfile(stage.path(name), temporary)
    returns = {
        method: [row["mean_return"] for row in summary if row["method"] == method] for method in stage.task.methods
    }
    metrics = {method: round(sum(each) / len(each), 2) for method, each in returns.items() if each}
    write_json(stage.result("metrics.json"), {"return": metrics})
    lines = ["steps,return,method"]
    for (_, noise, drop), methods in learning_curves(read_rows(stage.path("learning.parquet"), LEARNING)).items():
        for method, curve in methods.items():
            name = f"{method} noise {noise:g} drop {drop:g}"
            pairs = zip(curve.steps.tolist(), curve.mean.tolist(), strict=True)
            lines += [f"{steps:.0f},{value:.6g},{name}" for steps, value in pairs]
    with write_whole(stage.result("curve.csv")) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run_stage(TaskStage, main)
