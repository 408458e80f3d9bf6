"""Speeds of control on this machine: sampling over stepping MuJoCo alone, and whole trainings beside a peer's.

    python -m stages.control.speeds params.yaml [--peer] [--peer-steps 40000] [--peer-seeds 3] [--again]

With --peer sb3-contrib's RecurrentPPO, with its defaults, and our rpsp learn the same tasks for equal steps. Tables go
to OUT/results/control/speeds.parquet and peers.parquet; the report shows them. Runs with the peer take minutes each:
those that are in the table are not repeated, unless --again is given.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_rows, write_rows
from predplan.control.benchmark_tables import PEERS, SPEEDS
from predplan.control.benchmarks import rates
from predplan.control.comparing import final_mean, mean_over_training
from predplan.control.environments import EnvironmentSettings
from predplan.control.records import run_row
from predplan.control.recurrent_ppo import train_peer
from predplan.control.running import Order, run
from predplan.control.tasks import TASKS
from predplan.control.training import Schedule
from predplan.errors import InputError, PredplanError
from predplan.reporting.control.speeds import PEER, peers_table, speeds_table
from predplan.reporting.document import Section
from predplan.reporting.markdown import to_markdown
from stages.settings import load_settings

METHOD = "rpsp"
SCHEDULE = Schedule(steps=20_000, copies=64, length=64)
"""Many copies: a step's own cost in Python is theirs together."""
PEER_TASKS = ("cartpole", "hopper")
COPIES, LENGTH = 16, 64


def main(params: Path, peer: bool, steps: int, seeds: int, again: bool) -> None:
    """Measure, write and print."""
    folder = Path(load_settings(params).out) / "results" / "control"
    found = [
        speed(task, threads)
        for task in track(tuple(TASKS), "sampling", console=Console(stderr=True))
        for threads in (1, 2)
    ]
    write_rows(
        folder / "speeds.parquet", SPEEDS, found, Provenance({"steps": SCHEDULE.steps, "copies": SCHEDULE.copies})
    )
    tables = [speeds_table(found)]
    if peer:
        tables.append(peers_table(beside_peer(folder / "peers.parquet", steps, seeds, again)))
    Console().print(to_markdown(Section("Speed", tuple(tables)), "."), markup=False, highlight=False, soft_wrap=True)


def speed(task: str, threads: int) -> Mapping[str, Any]:
    """A row of the table of speeds."""
    found = rates(EnvironmentSettings(task, threads=threads), METHOD, SCHEDULE)
    rate = {"raw": found.raw.wall, "sampling": found.sampling.wall, "training": found.training.cpu}
    return {"task": task, "threads": threads, **rate}


def beside_peer(path: Path, steps: int, seeds: int, again: bool) -> Sequence[Mapping[str, Any]]:
    """The rows of the table of peers, written after each pair of runs; those that are there are kept."""
    provenance = Provenance({"steps": steps, "copies": COPIES, "length": LENGTH})
    rows = [] if again or not path.exists() else [row for row in read_rows(path, PEERS) if row["steps"] == steps]
    known = {(row["task"], row["seed"]) for row in rows}
    wanted = [(task, seed) for seed in range(seeds) for task in PEER_TASKS if (task, seed) not in known]
    for task, seed in track(wanted, f"{PEER} and {METHOD}", console=Console(stderr=True)):
        settings = EnvironmentSettings(task, threads=1)
        other = train_peer(settings, steps, seed)
        means = {
            "mean_return": mean_over_training(other.steps, other.returns, steps),
            "final_return": final_mean(other.steps, other.returns),
        }
        own = run_row(run(Order(settings, METHOD, Schedule(steps, COPIES, LENGTH), seed)))
        named = {"task": task, "seed": seed, "steps": steps}
        rows.append({**named, "learner": PEER, **means, "cpu_s": other.cpu_s})
        rows.append({**own, **named, "learner": METHOD})
        write_rows(path, PEERS, rows, provenance)
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument("--peer", action="store_true", help="train sb3-contrib's RecurrentPPO too (extra sb3)")
    parser.add_argument("--peer-steps", type=int, default=40_000, help="steps that both learn for")
    parser.add_argument("--peer-seeds", type=int, default=3, help="runs of each a task")
    parser.add_argument("--again", action="store_true", help="make the runs with the peer anew")
    given = parser.parse_args()
    try:
        main(given.params, given.peer, given.peer_steps, given.peer_seeds, given.again)
    except PredplanError as error:
        sys.stderr.write(f"stage speeds failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)
