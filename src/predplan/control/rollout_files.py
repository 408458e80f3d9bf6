"""Rollouts as recordings: steps, joints, bodies, and a ghost of the robot where it was expected to be.

A file shows itself: it needs no simulator to be looked at.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.mcap import (
    JOINT_STATES,
    UNKNOWN_MAKER,
    read_attachments,
    read_joint_states,
    read_solids,
    read_steps,
    read_transforms,
    write_recording,
)
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import Colour, JointStates, LogLine, Solid, Transforms
from predplan.control.bodies import (
    body_poses,
    body_solids,
    coordinates,
    ground_height,
    standing_solids,
    task_model,
)
from predplan.control.environments import EnvironmentSettings
from predplan.control.rollouts import Rollouts
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import from_steps, to_steps
from predplan.errors import InputError

FACTS = "rollouts.json"
ROBOT, GHOST = "robot/", "predicted/"
"""What the names of the robot's frames, and of its ghost's, begin with."""
GHOST_COLOUR: Colour = (0.23, 0.62, 0.87, 0.4)
SWELL = 1.12
"""The ghost is so many times as thick as the robot: where it agrees, it is a skin around it."""


@dataclass(frozen=True)
class RolloutFile:
    """What a rollouts' recording holds."""

    rollouts: Rollouts
    frames: Transforms
    solids: Sequence[Solid]
    method: str
    names: tuple[str, ...]  # [O] of what is observed
    units: tuple[str, ...]  # [O]
    ground: float | None  # m: z of the ground


def write_rollouts(path: Path, rollouts: Rollouts, method: str, provenance: Provenance) -> None:
    """Write rollouts, whole: the same rollouts, the same bytes.

    The ghost is posed as the method predicted one step before; coordinates that are not observed, as where the body is
    in the world, are the robot's own. Where nothing was predicted it is with the robot, and a method that never
    predicts has none.
    """
    model, trajectories = task_model(rollouts.settings.task), rollouts.trajectories
    last = np.zeros(len(trajectories.observation), np.bool_)
    last[trajectories.first[1:] - 1] = True
    # In a recording a step holds what was predicted of the observation to come.
    ahead = np.where(last[:, None], np.nan, np.roll(rollouts.prediction, -1, axis=0))
    steps = to_steps(trajectories, rollouts.step_duration, rollouts.state, ahead)
    frames = body_poses(model, steps.times, rollouts.configuration, ROBOT)
    solids = (*standing_solids(model, _greyed), *body_solids(model, ROBOT, _greyed))
    if np.isfinite(rollouts.prediction).any():
        frames = _beside(frames, body_poses(model, steps.times, ghost_configuration(rollouts), GHOST))
        solids += body_solids(model, GHOST, lambda _: GHOST_COLOUR, SWELL)
    named = coordinates(model)
    observed = named[len(named) - trajectories.observation.shape[1] :]
    settings = rollouts.settings
    facts = {
        "task": settings.task,
        "noise": settings.noise,
        "drop": settings.drop,
        "method": method,
        "step_s": rollouts.step_duration,
        "observed": [name for name, _ in observed],
        "units": [unit for _, unit in observed],
        "ground_m": ground_height(model),
    }
    write_recording(
        path,
        provenance,
        joint_states={JOINT_STATES: JointStates(steps.times, tuple(name for name, _ in named), rollouts.configuration)},
        transforms=frames,
        steps=steps,
        scene=solids,
        log=[
            LogLine(float(steps.times[row]), f"episode {episode}: return {value:.6g} in {length - 1} steps", method)
            for episode, (row, value, length) in enumerate(
                zip(trajectories.first[:-1], rollouts.returns, trajectories.lengths, strict=True)
            )
        ],
        attachments={FACTS: (json.dumps(facts, ensure_ascii=False, allow_nan=False, indent=1) + "\n").encode()},
    )


def read_rollouts(path: Path, maker: str = UNKNOWN_MAKER) -> RolloutFile:
    """The content of a rollouts' recording. Raises InputError, naming `maker` as what to run again."""
    attached = read_attachments(path, maker)
    if FACTS not in attached:
        listed = ", ".join(attached) or "none"
        raise InputError(f"{path}: no {FACTS} among the attachments ({listed}); expected rollouts; make it: {maker}")
    facts: Mapping[str, Any] = json.loads(attached[FACTS])
    steps = read_steps(path, maker=maker)
    trajectories = from_steps(steps)
    prediction = np.roll(steps.prediction, 1, axis=0)
    prediction[trajectories.first[:-1]] = np.nan
    rollouts = Rollouts(
        EnvironmentSettings(facts["task"], facts["noise"], facts["drop"]),
        trajectories,
        read_joint_states(path, JOINT_STATES, maker).position,
        steps.state,
        prediction,
        float(facts["step_s"]),
    )
    return RolloutFile(
        rollouts,
        read_transforms(path, maker=maker),
        read_solids(path, maker=maker),
        str(facts["method"]),
        tuple(facts["observed"]),
        tuple(facts["units"]),
        facts["ground_m"],
    )


def ghost_configuration(rollouts: Rollouts) -> FloatArray:
    """Positions [n, nq] of the ghost."""
    predicted = rollouts.configuration.copy()
    there = np.isfinite(rollouts.prediction).all(axis=1)
    predicted[there, -rollouts.prediction.shape[1] :] = rollouts.prediction[there]
    return predicted


def _beside(first: Transforms, second: Transforms) -> Transforms:
    """Frames of both, at the same times."""
    return Transforms(
        first.times,
        first.parents + second.parents,
        first.children + second.children,
        np.concatenate([first.translation, second.translation], axis=1),
        np.concatenate([first.quaternion, second.quaternion], axis=1),
    )


def _greyed(colour: Colour) -> Colour:
    """A grey that is as bright, within bounds: colours are for what is predicted and observed."""
    red, green, blue, opacity = colour
    bright = 0.35 + 0.55 * (0.3 * red + 0.59 * green + 0.11 * blue)
    return bright, bright, 1.03 * bright, opacity
