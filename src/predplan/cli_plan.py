"""`predplan plan`: a robot, a scene and a request to a certified trajectory.

Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from predplan.cli_progress import progress
from predplan.errors import InputError, PredplanError

if TYPE_CHECKING:
    from predplan.artifacts.provenance import Provenance


def plan(
    *,
    robot: Annotated[Path, Parameter(help="The robot: URDF (with the SRDF beside it, if there is one) or MJCF.")],
    scene: Annotated[Path, Parameter(help="Obstacles: a MoveIt planning scene as YAML, or the bodies of an MJCF.")],
    request: Annotated[Path, Parameter(help="Start and goal by joint: a MoveIt motion-plan request as YAML.")],
    out: Annotated[Path, Parameter(help="MCAP to write the trajectory to; a file that is there is replaced.")],
    method: Annotated[
        Literal["cascade", "kernel", "sampled"],
        Parameter(help="Kernel starts and, where they fail, sampled ones; or either kind alone."),
    ] = "cascade",
    budget: Annotated[
        float, Parameter(help="Seconds to plan in, once files are read and compiled code is loaded.")
    ] = 1.0,
    seed: Annotated[int, Parameter(help="Seed of the draws and samples.")] = 0,
    cylinders_as: Annotated[
        Literal["cylinder", "capsule", "box"], Parameter(help="What the scene's cylinders are taken as.")
    ] = "cylinder",
    primitives: Annotated[
        Literal["all", "first"], Parameter(help="All parts of a MoveIt collision object, or its first alone.")
    ] = "all",
    acceleration_limit: Annotated[
        float | None, Parameter(help="rad/s² or m/s², of every joint; no robot format states any. By default 10.")
    ] = None,
    as_json: Annotated[bool, Parameter(name="--json", help="Write JSON.", negative="")] = False,
) -> None:
    """Plan a motion that is proved free of collision, not only where it was sampled, and time it within the limits.

    Plans the joints that the goal names; the start's other joints are held where they are. Exit code 1 says that no
    certified motion was found within the budget; nothing is written then.

    ```
    predplan plan --robot panda.urdf --scene s.yaml --request r.yaml --out p.mcap
    predplan plan --robot arm.xml --scene s.xml --request r.yaml --out p.mcap --json
    predplan show p.mcap
    ```

    The published MotionBenchMaker problems take `--primitives first --cylinders-as capsule` (in the set box: `box`).
    """
    import json
    import time

    from predplan.planning import Planner, read_request, read_robot, read_scene
    from predplan.planning.plan_files import write_plan
    from predplan.planning.summaries import as_plain_data, lines_of

    _check_options(out, (robot, scene, request), budget, seed)
    with progress():
        asked = read_request(request)
        held = {joint: value for joint, value in asked.start.items() if joint not in asked.goal}
        arm = read_robot(robot, joints=list(asked.goal), fixed=held, acceleration_limit=acceleration_limit)
        began = time.perf_counter()
        obstacles = read_scene(scene, cylinders_as=cylinders_as, primitives=primitives)
        scene_time = time.perf_counter() - began
        start, goal = asked.configurations(arm)
        logging.getLogger("predplan").info("loading compiled code; the first time, compiling takes a minute")
        planner = Planner(arm)
        found = planner.plan(obstacles, start, goal, budget, method, seed)
        if found.success:
            options = {"method": method, "cylinders_as": cylinders_as, "primitives": primitives}
            write_plan(out, found, _provenance(options | asdict(planner.settings), seed, robot, scene, request))
    if as_json:
        sys.stdout.write(json.dumps(as_plain_data(found) | {"scene_time_s": scene_time}, indent=2) + "\n")
    elif found.success:
        for line in lines_of(found):
            sys.stdout.write(line + "\n")
        sys.stdout.write(f"scene read    {1000 * scene_time:.1f} ms\nwritten       {out}\n")
    if not found.success:
        raise PredplanError(found.reason)


def _check_options(out: Path, inputs: Sequence[Path], budget: float, seed: int) -> None:
    """Raise InputError before anything slow begins."""
    if not 0.0 < budget < float("inf"):
        raise InputError(f"--budget is {budget} s; expected a finite number above 0")
    if seed < 0:
        raise InputError(f"--seed is {seed}; expected 0 or more")
    if out.is_dir():
        raise InputError(f"{out} is a folder; expected a file to write")
    if any(out.resolve() == one.resolve() for one in inputs):
        raise InputError(f"--out is {out}, which is read; expected another file")


def _provenance(params: Mapping[str, Any], seed: int, robot: Path, scene: Path, request: Path) -> Provenance:
    from predplan.artifacts.provenance import Provenance, hash_file

    read = {"robot": robot, "scene": scene, "request": request}
    return Provenance(params, seed, upstream={name: hash_file(path) for name, path in read.items()})
