"""Tables of speeds, and of whole trainings beside a peer's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from predplan.control.tables import Row
from predplan.reporting.control.labels import label_of, task_title
from predplan.reporting.document import Cell, Table

PEER = "RecurrentPPO"


def speeds_table(rows: Sequence[Row]) -> Table:
    """Sampling over MuJoCo alone; rows of SPEEDS."""
    return Table(
        ("Task", "Threads", "MuJoCo alone, steps/s", "Sampling, steps/s", "Share", "Training, steps a CPU s"),
        tuple(
            (
                task_title(row["task"]),
                f"{row['threads']}",
                f"{row['raw']:,.0f}",
                f"{row['sampling']:,.0f}",
                f"{row['sampling'] / row['raw']:.0%}",
                f"{row['training']:,.0f}",
            )
            for row in rows
        ),
        "Speed. MuJoCo alone: 64 copies stepped by mujoco.rollout, a call a step. Sampling: with filter, policy, "
        "rewards, noise and resets; both by turns from the same states, medians. Training: a whole run of RPSP.",
    )


def peers_table(rows: Sequence[Row]) -> Table:
    """Our learner and the peer's at equal steps, means over seeds; rows of PEERS."""
    cells: list[tuple[str | Cell, ...]] = []
    for task in dict.fromkeys(row["task"] for row in rows):
        own = [row for row in rows if row["task"] == task]
        for learner in dict.fromkeys(row["learner"] for row in own):
            runs = [row for row in own if row["learner"] == learner]
            rate = sum(row["steps"] for row in runs) / sum(row["cpu_s"] for row in runs)
            means = (_mean(runs, column) for column in ("mean_return", "final_return"))
            cells.append((task_title(task), label_of(learner), f"{len(runs)}", *means, f"{rate:,.0f}"))
    steps = " or ".join(f"{count:,}" for count in sorted({row["steps"] for row in rows}))
    return Table(
        ("Task", "Learner", "Runs", "Mean return over training", "Over the last tenth", "Steps a CPU s"),
        tuple(cells),
        f"Beside sb3-contrib’s {PEER} with its defaults (an LSTM), after {steps} environment steps, positions observed "
        "exactly: means over runs, with standard errors.",
    )


def _mean(runs: Sequence[Row], column: str) -> str:
    values = np.array([row[column] for row in runs])
    error = f" (± {values.std(ddof=1) / np.sqrt(len(values)):.2g})" if len(values) > 1 else ""
    return f"{values.mean():.3g}{error}"
