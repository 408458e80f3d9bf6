"""MotionBenchMaker: our planner, and with --peers all others, on the same problems in one run on one core.

`python -m stages.planning.motion_bench params.yaml --peers` is what `make bench` runs. Problems come from the mirror
(PREDPLAN_MIRROR) or, with --published, from their public address: the whole set of 700. Plans go to
OUT/results/planning/motion-bench/plans.parquet, one row a planner, problem and seed, and their summary beside it.
An interrupted run goes on with the planner it was at; --again starts anew.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from predplan.artifacts.provenance import Provenance, hash_file
from predplan.artifacts.tables import read_provenance, read_rows, write_rows
from predplan.errors import InputError, PredplanError
from predplan.planning.benchmark_tables import PLANS, SUMMARY, measured_of, rows_of, summarise
from predplan.planning.benchmarks import ROBOT, Measured, SetProblem, measure, read_problems, solvable
from predplan.planning.peers import PEERS, REFERENCE, NotInstalledError, PeerSettings, make, own_planners
from predplan.planning.published import fetch_published
from predplan.reporting.markdown import to_markdown
from predplan.reporting.planning.motion_bench import motion_bench_section
from stages.common import mirror_folder, plain
from stages.settings import load_settings

NAME, MIRRORED = "motion-bench", "motion-bench"


def main(params: Path, planners: Sequence[str], peers: PeerSettings, published: bool, again: bool) -> None:
    """Measure, write and print."""
    settings = load_settings(params)
    work, results = (Path(settings.out) / part / NAME for part in ("planning", "results/planning"))
    folder = problem_folder(Path(settings.out), published)
    problems, invalid = solvable(read_problems(folder))
    console = Console()
    for problem in invalid:
        console.print(f"{problem.name} is left out: start or goal is in collision or outside the limits")
    on_one_core()
    provenance = Provenance({"peers": plain(peers)}, upstream={ROBOT: hash_file(folder / ROBOT), **sums(problems)})
    plans: list[Measured] = []
    with Progress(console=console) as progress:
        for name in planners:
            part = work / f"{name}.parquet"
            if again or not measured_before(part, provenance):
                try:
                    prepare = make(name, problems[0].robot, peers)
                except NotInstalledError as missing:
                    console.print(str(missing), markup=False)
                    continue
                run = measure(name, prepare, problems, peers.seeds)
                done = progress.track(run, total=len(problems) * peers.seeds, description=name)
                write_rows(part, PLANS, rows_of(done), provenance)
            plans += measured_of(read_rows(part, PLANS))
    summary = summarise(plans, REFERENCE)
    write_rows(results / "plans.parquet", PLANS, rows_of(plans), provenance)
    write_rows(results / "summary.parquet", SUMMARY, summary, provenance)
    for name in planners:  # a whole run is over: the next one measures again, since code may have changed
        (work / f"{name}.parquet").unlink(missing_ok=True)
    console.print(
        to_markdown(motion_bench_section(rows_of(plans), summary), "."), markup=False, highlight=False, soft_wrap=True
    )


def problem_folder(out: Path, published: bool) -> Path:
    """The mirror's folder of problems, or that of the published set, fetched where it is not there yet."""
    if published:
        return fetch_published(out / "planning" / NAME / "published")
    mirror = mirror_folder()
    if mirror is None or not (mirror / MIRRORED).is_dir():
        raise InputError(
            f"no folder {MIRRORED} in the mirror {mirror}: name one by PREDPLAN_MIRROR, or fetch with --published"
        )
    return mirror / MIRRORED


def measured_before(part: Path, provenance: Provenance) -> bool:
    """Whether a planner's plans are there, of the same problems and settings."""
    return part.is_file() and read_provenance(part).to_json() == provenance.to_json()


def sums(problems: Sequence[SetProblem]) -> dict[str, str]:
    """The SHA-256 of every scene and request, by file."""
    scenes = [Path(problem.scene.source) for problem in problems]
    files = [file for scene in scenes for file in (scene, scene.with_name(scene.name.replace("scene", "request")))]
    return {f"{file.parent.name}/{file.name}": hash_file(file) for file in files}


def on_one_core() -> None:
    """Keep this process, and the threads that peers start, to one core, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def arguments() -> Iterator[Any]:
    """What the command line says, as main takes it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument("--peers", action="store_true", help="all planners, not ours alone")
    parser.add_argument("--planners", nargs="+", metavar="NAME", choices=[peer.name for peer in PEERS])
    parser.add_argument("--seeds", type=int, default=PeerSettings.seeds, help="runs a problem")
    parser.add_argument("--published", action="store_true", help="the whole published set, fetched")
    parser.add_argument("--again", action="store_true", help="do not go on with an interrupted run")
    given = parser.parse_args()
    everyone = [peer.name for peer in PEERS] if given.peers else own_planners()
    yield from (given.params, given.planners or everyone, PeerSettings(seeds=given.seeds), given.published, given.again)


if __name__ == "__main__":
    try:
        main(*arguments())
    except PredplanError as error:
        sys.stderr.write(f"stage motion_bench failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)
