"""Speeds of control on this machine: sampling over stepping MuJoCo alone, and a whole training over a peer's.

    python -m stages.control.speeds [--peer] [--peer-steps 40000]

With --peer sb3-contrib's RecurrentPPO learns the same tasks, its defaults and ours at equal steps.
"""

from __future__ import annotations

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table

from predplan.control.benchmarks import Rates, rates
from predplan.control.environments import EnvironmentSettings
from predplan.control.recurrent_ppo import PeerRun, train_peer
from predplan.control.running import Order, Run, run
from predplan.control.tasks import TASKS
from predplan.control.training import Schedule

SCHEDULE = Schedule(steps=20_000, copies=64, length=64)
"""Many copies: a step's own cost in Python is theirs together."""
LEARNING = Schedule(steps=20_000, copies=16, length=64)
PEER_TASKS = ("cartpole", "hopper")


def main(peer: bool, peer_steps: int) -> None:
    console = Console()
    table = Table("task", "threads", title="steps a second, policy on predictive states, noise 0")
    for column in ("MuJoCo alone", "sampling", "share", "training, steps a CPU s"):
        table.add_column(column, justify="right")
    for task in TASKS:
        for threads in (1, 2):
            found = rates(EnvironmentSettings(task, threads=threads), "rpsp", SCHEDULE)
            table.add_row(task, str(threads), *_shown(found))
    console.print(table)
    if peer:
        console.print(_against_peer(peer_steps))


def _shown(found: Rates) -> list[str]:
    share = found.sampling.wall / found.raw.wall
    return [f"{found.raw.wall:,.0f}", f"{found.sampling.wall:,.0f}", f"{share:.0%}", f"{found.training.cpu:,.0f}"]


def _against_peer(steps: int) -> Table:
    table = Table("task", title=f"RecurrentPPO with its defaults, and rpsp, both {steps:,} steps, seed 0")
    columns = (
        "peer, steps a CPU s",
        "rpsp, steps a CPU s",
        "times",
        "peer's mean return",
        "rpsp's",
        "peer's last",
        "rpsp's",
    )
    for column in columns:
        table.add_column(column, justify="right")
    for task in PEER_TASKS:
        settings = EnvironmentSettings(task, threads=1)
        other = train_peer(settings, steps, 0)
        own = run(Order(settings, "rpsp", Schedule(steps, LEARNING.copies, LEARNING.length), 0))
        speed, own_speed = steps / other.cpu_s, own.progress[-1].steps / own.progress[-1].cpu_s
        means, lasts = zip(_means(other, steps), _own_means(own, steps), strict=True)
        figures = [f"{one:.1f}" for one in (*means, *lasts)]
        table.add_row(task, f"{speed:,.0f}", f"{own_speed:,.0f}", f"{own_speed / speed:.0f}", *figures)
    return table


def _means(peer: PeerRun, steps: int) -> tuple[float, float]:
    """Mean return over training, and over the last tenth of the steps, of episodes by when they ended."""
    grid = np.linspace(0.0, steps, 1001)
    curve = np.interp(grid, peer.steps, peer.returns)
    return float(curve.mean()), float(curve[grid >= 0.9 * steps].mean())


def _own_means(own: Run, steps: int) -> tuple[float, float]:
    known = [one for one in own.progress if np.isfinite(one.return_mean)]
    grid = np.linspace(0.0, steps, 1001)
    curve = np.interp(grid, [one.steps for one in known], [one.return_mean for one in known])
    return float(curve.mean()), float(curve[grid >= 0.9 * steps].mean())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", action="store_true", help="train sb3-contrib's RecurrentPPO too (extra sb3)")
    parser.add_argument("--peer-steps", type=int, default=40_000, help="steps that both learn for")
    arguments = parser.parse_args()
    main(arguments.peer, arguments.peer_steps)
