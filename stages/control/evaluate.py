"""Play the learned policies of the first seed: what their mean actions are worth, and a recording of each."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.files import write_json
from predplan.control.environments import Environments
from predplan.control.policies import PolicyActor
from predplan.control.policy_files import load_policy
from predplan.control.rollout_files import write_rollouts
from predplan.control.rollouts import evaluate, record
from predplan.errors import InputError
from predplan.parallel import run
from stages.common import TaskStage, run_stage

COPIES, RECORDED = 16, 2
"""Episodes side by side, and episodes that are recorded."""


def main(stage: TaskStage) -> None:
    policies = stage.path("policies")
    if not policies.is_dir():
        raise InputError(f"{policies}: no such folder; make it again: dvc repro train@{stage.name}")
    folders = sorted(path for path in policies.iterdir() if path.is_dir())
    stage.path("rollouts").mkdir(parents=True, exist_ok=True)
    work = partial(play, stage=stage)
    found = run(work, folders, workers=stage.settings.workers, scheduler=stage.settings.scheduler)
    write_json(stage.result("evaluations.json"), list(found))


def play(folder: Path, stage: TaskStage) -> dict[str, Any]:
    """Record a policy; what it is worth, as plain data."""
    learned, control = load_policy(folder), stage.settings.control
    copies = min(control.episodes, COPIES)
    with Environments(learned.task, copies, np.random.default_rng(control.seed)) as environments:
        found = evaluate(environments, PolicyActor(learned, copies), control.episodes)
    with Environments(learned.task, RECORDED, np.random.default_rng(control.seed)) as environments:
        recorded = record(environments, PolicyActor(learned, RECORDED), RECORDED)
    provenance = stage.provenance(folder / "policy.json", policy=folder.name)
    write_rollouts(stage.path("rollouts") / f"{folder.name}.mcap", recorded, learned.name, provenance)
    return {
        "task": learned.task.task,
        "noise": learned.task.noise,
        "drop": learned.task.drop,
        "method": learned.name,
        "seed": 0,
        "episodes": control.episodes,
        "return_mean": found.mean,
        "return_standard_error": found.standard_error,
        "length_mean": float(found.lengths.mean()),
        "terminated": found.terminated,
        "prediction_error": found.prediction_error,
    }


if __name__ == "__main__":
    run_stage(TaskStage, main)
