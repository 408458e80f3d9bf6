"""Explore a task with blind actions: trajectories to learn predictors from, and others to compare them on."""

from __future__ import annotations

import numpy as np

from predplan.artifacts.mcap import write_recording
from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.exploration import ExplorationSettings, explore
from predplan.control.trajectories import to_steps
from stages.common import TaskStage, run_stage

COPIES = 50
"""Episodes side by side."""


def main(stage: TaskStage) -> None:
    task, seed = stage.task, stage.settings.control.seed
    parts = (("training", task.explored), ("held_out", task.held_out))
    for (part, count), generator in zip(parts, np.random.default_rng(seed).spawn(len(parts)), strict=True):
        wanted = ExplorationSettings(count, task.least_length, task.explored_length)
        settings = EnvironmentSettings(task.task, horizon=task.horizon)
        with Environments(settings, min(count, COPIES), generator) as environments:
            found = explore(environments, wanted, generator)
            steps = to_steps(found.trajectories, environments.step_duration)
        provenance = stage.provenance(part=part, task=task.task, trajectories=count, steps_taken=found.steps)
        write_recording(stage.path(f"exploration-{part}.mcap"), provenance, steps=steps)


if __name__ == "__main__":
    run_stage(TaskStage, main)
