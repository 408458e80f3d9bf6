"""Learn a filter from the exploration, in each condition, and compare what it foretells with other predictors."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.mcap import read_steps
from predplan.artifacts.tables import write_rows
from predplan.control.correction import CorrectionSettings
from predplan.control.environments import EnvironmentSettings
from predplan.control.exploration import degraded
from predplan.control.innovation import suited
from predplan.control.kernel_psr import KernelSettings
from predplan.control.linear_filter import LinearFilter
from predplan.control.models import save_model
from predplan.control.predictors import PredictorSettings, learn_predictors, prediction_table
from predplan.control.records import prediction_rows
from predplan.control.recurrent_predictor import RecurrentSettings
from predplan.control.refinement import RefinementSettings
from predplan.control.tables import PREDICTION
from predplan.control.tasks import find_task
from predplan.control.trajectories import Trajectories, from_steps
from predplan.parallel import run
from stages.common import TaskStage, run_stage
from stages.control.ordered import condition_name
from stages.settings import ConditionSettings

Rows = list[dict[str, Any]]


def main(stage: TaskStage) -> None:
    task = stage.task
    files = [stage.path(f"exploration-{part}.mcap") for part in ("training", "held_out")]
    training, held_out = (from_steps(read_steps(path, maker=f"dvc repro explore@{stage.name}")) for path in files)
    work = partial(learn, stage=stage, training=training, held_out=held_out)
    found = run(work, task.conditions, workers=stage.settings.workers, scheduler=stage.settings.scheduler)
    rows = [row for each in found for row in each]
    write_rows(stage.path("prediction.parquet"), PREDICTION, rows, stage.provenance(*files, settings=task))


def learn(condition: ConditionSettings, stage: TaskStage, training: Trajectories, held_out: Trajectories) -> Rows:
    """Save the condition's filter, the refined one where it is compared; rows of errors."""
    task, seed = stage.task, stage.settings.control.seed
    known = find_task(task.task)
    scale = np.array(known.scale) if known else training.observation.std(axis=0)
    variance, truth = training.observation.var(axis=0), held_out.observation
    noise, losses, _, learning = np.random.default_rng(seed).spawn(4)
    worse = degraded(training, condition.noise, condition.drop, scale, noise)
    seen = degraded(held_out, condition.noise, condition.drop, scale, losses)
    settings = PredictorSettings(
        innovation=suited(task.task, truth.shape[1]),
        refinement=RefinementSettings() if "refined" in task.predictors else None,
        kernel=KernelSettings() if "kernel" in task.predictors else None,
        correction=CorrectionSettings() if "corrected" in task.predictors else None,
        recurrent=RecurrentSettings() if "gru" in task.predictors else None,
    )
    predictors = list(learn_predictors(worse, settings, learning))
    filters = [one.model for one in predictors if isinstance(one.model, LinearFilter)]
    save_model(folder_of(stage, condition), filters[-1])
    errors = prediction_table(predictors, seen, truth, variance, settings)
    observed = EnvironmentSettings(task.task, condition.noise, condition.drop, scale=tuple(map(float, scale)))
    return prediction_rows(observed, seed, errors)


def folder_of(stage: TaskStage, condition: ConditionSettings) -> Path:
    """Where the condition's filter lies."""
    return stage.path("filters") / condition_name(condition)


if __name__ == "__main__":
    run_stage(TaskStage, main)
