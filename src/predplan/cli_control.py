"""`predplan control`: learn a policy, and see what one is worth.

Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from predplan.errors import InputError, PredplanError

if TYPE_CHECKING:
    from predplan.control.learned import Learned
    from predplan.control.rollouts import Evaluation
    from predplan.control.training import Progress

control = App(name="control", help="Learn to act on noisy, lossy positions, and act.")

COPIES, RECORDED = 16, 3
"""Episodes side by side in an evaluation, and episodes that are recorded."""
EVERY = 1
"""Updates after which a run is put away: 10 to 20 ms each (measured), an update takes 200 ms and more."""


@control.command
def train(
    task: Annotated[str, Parameter(help="cartpole, swimmer, hopper, walker2d, or a Gymnasium MuJoCo task's id.")],
    /,
    *,
    out: Annotated[Path, Parameter(help="Folder for the policy; an interrupted run there goes on.")],
    method: Annotated[str, Parameter(help="rpsp, rpsp-obs, fm2, gru, or another of the report's methods.")] = "rpsp",
    steps: Annotated[int, Parameter(help="Environment steps, exploration included.")] = 100_000,
    seed: Annotated[int, Parameter(help="Seed: the same one gives the same policy.")] = 0,
    noise: Annotated[float, Parameter(help="Noise on each position, in units of its spread while exploring.")] = 0.0,
    drop: Annotated[float, Parameter(help="Share of observations that are lost, from 0 to below 1.")] = 0.0,
) -> None:
    """Learn a policy. Interrupted, the same command goes on where it was, to the same policy.

    Exit code 1 says that learning diverged; the learning curve up to there is kept.

    ```
    predplan control train cartpole --out run --steps 60000
    predplan control train hopper --out run --noise 0.2 --method rpsp-obs
    predplan show run/learning.parquet
    ```
    """
    _check_seed(seed)
    from predplan.control.environments import EnvironmentSettings
    from predplan.control.records import run_row
    from predplan.control.run_files import CHECKPOINT, CURVE, run_into
    from predplan.control.running import Order
    from predplan.control.tables import FINISHED
    from predplan.control.training import Schedule

    order = Order(EnvironmentSettings(task, noise, drop), method, Schedule(steps=steps), seed)
    try:
        with _progress(steps, goes_on=(out / CHECKPOINT).exists()) as report:
            found = run_into(out, order, EVERY, report)
    except KeyboardInterrupt:
        kept = (out / CHECKPOINT).exists()
        remedy = "the same command goes on where it was" if kept else "nothing was learned yet"
        sys.stderr.write(f"predplan: interrupted; {remedy}\n")
        raise
    row = run_row(found)
    if found.reason != FINISHED:
        raise PredplanError(
            f"{found.reason}; no policy is written; the curve of the {row['steps']} steps before is {out / CURVE}"
        )
    reached = f", 195 after {row['steps_to_threshold']} steps" if row["steps_to_threshold"] else ""
    sys.stdout.write(
        f"{method} on {task}: {row['steps']} steps, mean return {row['mean_return']:.1f}, at the end"
        f" {row['final_return']:.1f}{reached}; {row['cpu_s']:.0f} s of processor; written to {out}\n"
    )


@control.command
def evaluate(
    folder: Annotated[Path, Parameter(help="Folder of a policy.")],
    /,
    *,
    episodes: Annotated[int, Parameter(help="Episodes to play.")] = 32,
    noise: Annotated[float | None, Parameter(help="Noise, as in training unless said.")] = None,
    drop: Annotated[float | None, Parameter(help="Share of lost observations, as in training unless said.")] = None,
    seed: Annotated[int, Parameter(help="Seed of starts, noise and losses.")] = 0,
    save: Annotated[Path | None, Parameter(help="MCAP to record the first few episodes to.")] = None,
    as_json: Annotated[bool, Parameter(name="--json", help="Write JSON.", negative="")] = False,
) -> None:
    """What a policy's mean actions are worth.

    ```
    predplan control evaluate run --episodes 100 --json
    predplan control evaluate run --drop 0.3 --save rollout.mcap
    predplan show rollout.mcap
    ```
    """
    _check_seed(seed)
    import numpy as np

    from predplan.artifacts.provenance import Provenance, hash_file
    from predplan.control import rollouts
    from predplan.control.environments import Environments
    from predplan.control.policies import PolicyActor
    from predplan.control.policy_files import load_policy

    if episodes < 1:
        raise InputError(f"--episodes is {episodes}; expected 1 or more")
    if save is not None and save.is_dir():
        raise InputError(f"{save} is a folder; expected a file to write")
    learned = load_policy(folder)
    noise = learned.task.noise if noise is None else noise
    drop = learned.task.drop if drop is None else drop
    task, copies = replace(learned.task, noise=noise, drop=drop), min(episodes, COPIES)
    with Environments(task, copies, np.random.default_rng(seed)) as environments:
        _check_sizes(folder, learned, environments.observation_size, environments.action_size)
        found = rollouts.evaluate(environments, PolicyActor(learned, copies), episodes)
    if save is not None:
        copies = min(episodes, RECORDED)
        with Environments(task, copies, np.random.default_rng(seed)) as environments:
            recorded = rollouts.record(environments, PolicyActor(learned, copies), copies)
        from predplan.control.rollout_files import write_rollouts

        params = {"task": task.task, "noise": task.noise, "drop": task.drop, "method": learned.name}
        policy = {"policy.json": hash_file(folder / "policy.json")}
        write_rollouts(save, recorded, learned.name, Provenance(params, seed, upstream=policy))
    if as_json:
        sys.stdout.write(json.dumps(_plain(learned, task.noise, task.drop, found), indent=2) + "\n")
    else:
        _print(learned, task.noise, task.drop, found, save)


def _plain(learned: Learned, noise: float, drop: float, found: Evaluation) -> dict[str, object]:
    return {
        "task": learned.task.task,
        "method": learned.name,
        "noise": noise,
        "drop": drop,
        "episodes": len(found.returns),
        "return_mean": found.mean,
        "return_standard_error": found.standard_error,
        "length_mean": float(found.lengths.mean()),
        "terminated": found.terminated,
        "prediction_error": found.prediction_error,
    }


def _print(learned: Learned, noise: float, drop: float, found: Evaluation, save: Path | None) -> None:
    episodes = len(found.returns)
    error = "" if found.standard_error is None else f" ± {found.standard_error:.1f}"
    foretold = "" if found.prediction_error is None else f"\nprediction    error {found.prediction_error:.2g}"
    written = "" if save is None else f"\nwritten       {save}"
    sys.stdout.write(
        f"policy        {learned.name} on {learned.task.task}, noise {noise:g}, drop {drop:g}\n"
        f"return        {found.mean:.1f}{error} over {episodes} episodes\n"
        f"length        {found.lengths.mean():.1f} steps\n"
        f"ended early   {found.terminated / episodes:.0%}{foretold}{written}\n"
    )


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise InputError(f"--seed is {seed}; expected 0 or more")


def _check_sizes(folder: Path, learned: Learned, observations: int, actions: int) -> None:
    if (learned.observations, learned.actions) != (observations, actions):
        raise InputError(
            f"{folder / 'policy.json'}: found {learned.observations} observations and {learned.actions} actions,"
            f" expected {observations} and {actions}, which {learned.task.task} has"
        )


@contextmanager
def _progress(steps: int, goes_on: bool) -> Iterator[Callable[[Progress], None] | None]:
    """A bar on stderr with return, prediction error and time left, if that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    told, left = TextColumn("{task.description}"), (TimeRemainingColumn(), TextColumn("left"))
    columns = (MofNCompleteColumn(), TextColumn("steps"), BarColumn(), told, *left)
    with Bar(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("going on" if goes_on else "exploring", total=steps)
        last = {"return": math.nan, "prediction error": math.nan}

        def report(one: Progress) -> None:
            found = {"return": one.return_mean, "prediction error": one.prediction_error}
            last.update({name: value for name, value in found.items() if math.isfinite(value)})
            told = ", ".join(f"{name} {value:.3g}" for name, value in last.items() if math.isfinite(value))
            done = min(one.steps, steps)
            told = told or "no episode has ended"
            if bar.tasks[0].completed:
                bar.update(task, completed=done, description=told)
            else:
                # What was done in an earlier sitting says nothing of this one's speed.
                bar.reset(task, completed=done, description=told)

        yield report
