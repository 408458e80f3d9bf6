"""Plans as recordings: joints and frames over time, how clear they stay, and what robot and scene look like.

A file shows itself: it needs neither the robot's nor the scene's file. It also carries the path that was certified,
exactly, with its timing (plan.json).
"""

from __future__ import annotations

import json
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from predplan.artifacts.mcap import (
    JOINT_STATES,
    UNKNOWN_MAKER,
    read_attachments,
    read_curves,
    read_joint_states,
    read_solids,
    read_transforms,
    write_recording,
)
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import Curves, FloatArray, JointStates, LogLine, Solid, Transforms
from predplan.errors import InputError
from predplan.planning.collisions import clearances
from predplan.planning.paths import Path
from predplan.planning.robots import Robot
from predplan.planning.scenes import Scene
from predplan.planning.timing import Timing
from predplan.planning.visuals import frame_poses, robot_solids, scene_solids

if TYPE_CHECKING:
    from predplan.planning.plans import Plan

CLEARANCE, FACTS = "/clearance", "plan.json"
TO_SCENE, TO_ITSELF = "scene_m", "self_m"
"""Names of the curves on the topic /clearance."""
CEILING = 0.5
"""m: clearances above it are written as it."""
RATE = 100.0
"""Samples a second."""


@dataclass(frozen=True)
class PlanFile:
    """What a plan's recording holds."""

    states: JointStates
    frames: Transforms
    clearance: Curves
    solids: Sequence[Solid]
    facts: Mapping[str, Any]  # plan.json

    @cached_property
    def path(self) -> Path | None:
        """The path that was certified, to the last bit; None where the file holds a motion that is no plan's."""
        kept = self.facts.get("path")
        return None if kept is None else Path(np.array(kept["breaks"]), np.array(kept["coefficients"]))

    @cached_property
    def timing(self) -> Timing | None:
        """When the path is where, likewise."""
        kept = self.facts.get("timing")
        if kept is None:
            return None
        return Timing(*(np.array(kept[name]) for name in ("times_s", "s", "speed_per_s")))


def write_plan(path: pathlib.Path, plan: Plan, provenance: Provenance, rate: float = RATE, meshes: bool = True) -> None:
    """Write a plan's trajectory, sampled `rate` times a second and at its end, and its path as it was certified.

    What was measured by the clock is left out, so that the same plan gives the same bytes. meshes: see `write_motion`.
    Raises ValueError where there is no trajectory.
    """
    timing = plan.timing
    times = np.append(np.arange(int(np.ceil(plan.duration_s * rate - 1e-6))) / rate, plan.duration_s)
    order = (plan.trajectory(times, derivative) for derivative in range(3))
    facts = {
        "method": plan.method,
        "certificate": None if plan.certificate is None else _plain(vars(plan.certificate)),
        "costs": dict(plan.costs),
        "attempts": [{"start": one.start, "outcome": one.outcome} for one in plan.attempts],
    }
    if plan.path is not None:
        facts["path"] = {"breaks": plan.path.breaks.tolist(), "coefficients": plan.path.coefficients.tolist()}
        facts["timing"] = {
            "times_s": timing.times.tolist(),
            "s": timing.s.tolist(),
            "speed_per_s": timing.speed.tolist(),
        }
    states = JointStates(times, plan.joints, *order)
    write_motion(path, plan.robot, plan.scene, states, provenance, facts, meshes)


def write_motion(
    path: pathlib.Path,
    robot: Robot,
    scene: Scene,
    states: JointStates,
    provenance: Provenance,
    facts: Mapping[str, Any] | None = None,
    meshes: bool = True,
) -> None:
    """Write any motion of a robot in a scene. facts: plain data kept beside it, as `method`, the name it is shown by.

    meshes: show the robot by its meshes, where it has them; else by its spheres, which take a hundredth of the space.
    """
    kept = {
        "robot": robot.name,
        "scene": scene.name,
        "limits": {
            "lower": robot.chain.lower.tolist(),
            "upper": robot.chain.upper.tolist(),
            "velocity": robot.velocity_limit.tolist(),
            "acceleration": robot.acceleration_limit.tolist(),
        },
        **(facts or {}),
    }
    text = json.dumps(kept, ensure_ascii=False, allow_nan=False, indent=1) + "\n"
    clearance = clearance_of(robot, scene, states.times, states.position)
    least = clearance.values.min(axis=0)
    write_recording(
        path,
        provenance,
        joint_states={JOINT_STATES: states},
        transforms=frame_poses(robot, states.times, states.position),
        curves={CLEARANCE: clearance},
        scene=(*robot_solids(robot, meshes), *scene_solids(scene)),
        log=[
            LogLine(0.0, f"{robot.name} in {scene.name}: {states.times[-1]:.3f} s", "predplan"),
            LogLine(0.0, f"least clearance: scene {least[0]:.4f} m, itself {least[1]:.4f} m", "predplan"),
        ],
        attachments={FACTS: text.encode()},
    )


def read_plan(path: pathlib.Path, maker: str = UNKNOWN_MAKER) -> PlanFile:
    """The content of a plan's recording. Raises InputError, naming `maker` as what to run again."""
    attached = read_attachments(path, maker)
    if FACTS not in attached:
        listed = ", ".join(attached) or "none"
        raise InputError(
            f"{path}: no {FACTS} among the attachments ({listed}); expected a plan; make it again: {maker}"
        )
    return PlanFile(
        read_joint_states(path, JOINT_STATES, maker),
        read_transforms(path, maker=maker),
        read_curves(path, CLEARANCE, maker),
        read_solids(path, maker=maker),
        json.loads(attached[FACTS]),
    )


def clearance_of(robot: Robot, scene: Scene, times: FloatArray, configurations: FloatArray) -> Curves:
    """Least clearance (m) of the body to the scene and of its links to each other, none above CEILING, at each time."""
    chain = robot.chain
    to_scene, to_links = np.empty(len(chain.sphere_radius)), np.empty(len(chain.link_pairs))
    values = np.empty((len(times), 2))
    for i, q in enumerate(np.ascontiguousarray(configurations, np.float64)):
        clearances(chain, scene.obstacles, q, CEILING, to_scene, to_links)
        values[i] = to_scene.min(initial=CEILING), to_links.min(initial=CEILING)
    return Curves(times, (TO_SCENE, TO_ITSELF), values)


def _plain(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields as JSON has them: what is not a number there becomes null."""
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value for name, value in fields.items()
    }
