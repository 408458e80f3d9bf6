"""Make the recordings of a suite's first problem: the arm in its scene, every method's way, costs and support points.

In the plane there is a second one: how the paths move over the obstacles' cost, iteration by iteration.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from predplan.artifacts.tables import read_provenance, read_rows
from predplan.inspection.fields import CostField, Course, PlanarPlans, draw_field
from predplan.inspection.planning import Limits, Motion, Plans, draw_plans
from predplan.inspection.recording import Page, write_recording
from predplan.planning.kinds import IN_THE_PLANE
from predplan.planning.kinematics import poses, tool_trace
from predplan.planning.measures import cost_field
from predplan.planning.plan_files import clearance_of
from predplan.planning.problems import Problem
from predplan.planning.robots import FloatArray
from predplan.planning.tables import COSTS, SUPPORTS, TEST, TRAJECTORIES, read_problems
from predplan.planning.visuals import frame_poses, robot_solids, scene_solids
from stages.common import SuiteStage, run_stage
from stages.planning.compared import plane_of, played

SHOWN = ("grbf", "grbf-narrow", "grbf-body", "grbf-jj", "waypoints-velocity", "waypoints-acceleration")
FIELD_COUNT = 241
"""Points a side of the cost field."""
SHOWN_FOR_WAYPOINTS = ("chomp-velocity", "chomp-acceleration")


def main(stage: SuiteStage) -> None:
    problem = read_problems(stage.folder(), TEST)[0]
    if stage.suite.kind not in IN_THE_PLANE:
        problem = with_meshes(problem)
    plans = plans_of(stage, problem)
    provenance = read_provenance(stage.path("trajectories.parquet"))

    def draw(recording: rr.RecordingStream) -> Page:
        return draw_plans(recording, plans, provenance)

    write_recording(stage.path("recordings") / f"{problem.name}.rrd", "plans", stage.name, provenance, draw)
    if stage.suite.kind in IN_THE_PLANE:
        planar = planar_plans_of(stage, problem, plans)

        def draw_plane(recording: rr.RecordingStream) -> Page:
            return draw_field(recording, planar, provenance)

        path = stage.path("recordings") / f"{problem.name} field.rrd"
        write_recording(path, "planar plans", f"{stage.name}-field", provenance, draw_plane)


def plans_of(stage: SuiteStage, problem: Problem) -> Plans:
    """The first problem as it was solved by the methods shown."""
    own = partial(rows_of, stage=stage, problem=problem.name)
    trajectories = own("trajectories", TRAJECTORIES)
    methods = list(dict.fromkeys(row["method"] for row in trajectories))
    shown = [name for name in (*SHOWN, *SHOWN_FOR_WAYPOINTS) if name in methods]
    iterations, motions = stage.suite.iterations, []
    for method in shown:
        last = [
            row["q"] for row in trajectories if (row["method"], row["iteration"]) == (method, stage.suite.iterations)
        ]
        states = played(problem, np.array(last))
        tool = tool_trace(problem.robot.chain, states.position)
        clearance = clearance_of(problem.robot, problem.scene, states.times, states.position)
        motions.append(Motion(method, states, tool, clearance))
    costs = [row for row in own("costs", COSTS) if row["method"] in shown]
    table = pa.table(
        {
            "method": [row["method"] for row in costs],
            "iteration": [row["iteration"] for row in costs],
            "obstacle_cost": [row["integral"] for row in costs],
            "velocity_cost": [row["velocity"] for row in costs],
            "acceleration_cost": [row["acceleration"] for row in costs],
        }
    )
    supports = {
        method: [np.array(row["times"]) for row in own("supports", SUPPORTS) if row["method"] == method]
        for method in shown[:4]
    }
    robot, first = problem.robot, motions[0].states
    limits = Limits(robot.chain.lower, robot.chain.upper, robot.velocity_limit, robot.acceleration_limit)
    text = (
        f"{len(shown)} methods from the straight line, {iterations} iterations each; the arm moves by "
        f"**{shown[0]}**. Obstacle cost is that along the way of the whole body, by arc length [m²]."
    )
    solids = (*robot_solids(robot, bool(robot.source)), *scene_solids(problem.scene))
    frames = frame_poses(robot, first.times, first.position)
    return Plans(f"{stage.name}: {problem.name}", text, solids, frames, motions, limits, table, supports)


def planar_plans_of(stage: SuiteStage, problem: Problem, plans: Plans) -> PlanarPlans:
    """How the shown methods' paths, an arm's by its end effector, cross the obstacles' cost in every iteration."""
    chain, (lower, upper) = problem.robot.chain, plane_of(stage.suite.kind)
    rows = rows_of("trajectories", TRAJECTORIES, stage, problem.name)
    courses = []
    for motion in plans.motions:
        q = np.array([row["q"] for row in rows if row["method"] == motion.method])
        tool = tool_trace(chain, q)[:, :2].reshape(stage.suite.iterations + 1, -1, 2)
        courses.append(Course(motion.method, tool, plans.supports.get(motion.method, ())))
    cost = cost_field(problem.scene, lower, upper, FIELD_COUNT, stage.suite.epsilon)
    field = CostField(cost, (lower[0], upper[0]), (lower[1], upper[1]))
    text = f"{len(courses)} methods from the straight line; move along the iterations to see what a step does."
    bodies = arms(problem, np.stack([problem.start, problem.goal])) if stage.suite.kind == "planar" else []
    return PlanarPlans(f"{plans.title}, in the plane", text, field, courses, plans.costs, bodies)


def arms(problem: Problem, q: FloatArray) -> list[FloatArray]:
    """The arm's joints and end in the plane [D + 1, 2] at each of the configurations [n, D]."""
    joints = poses(problem.robot.chain, q)[1][:, 1:, :2]
    return list(np.concatenate([joints, tool_trace(problem.robot.chain, q)[:, None, :2]], axis=1))


def rows_of(name: str, schema: Any, stage: SuiteStage, problem: str) -> list[dict[str, Any]]:
    """The rows of a table that are about one problem."""
    return [row for row in read_rows(stage.path(f"{name}.parquet"), schema) if row["problem"] == problem]


def with_meshes(problem: Problem) -> Problem:
    """The problem with the file its robot was read from, whose meshes are drawn."""
    from predplan.planning.kitchen_files import kitchen_model

    return replace(problem, robot=replace(problem.robot, source=str(kitchen_model())))


if __name__ == "__main__":
    run_stage(SuiteStage, main)
