"""The page of rollouts: the robot and the ghost of where it was expected, and what was seen, expected and gained."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from predplan.artifacts.mcap import read_provenance
from predplan.control.rollout_files import GHOST, RolloutFile, read_rollouts
from predplan.inspection.bodies import TIME, log_frames, log_solids
from predplan.inspection.control_views import Series, log_series, robot_view, sliding_plot, whole_plot
from predplan.inspection.markdown import about, escape, markdown_table
from predplan.inspection.palette import TEXT, WARNING
from predplan.inspection.recording import Layout, Page
from predplan.palette import AMBER, BLUE, GREEN

Floats = NDArray[np.float64]

TRUE, OBSERVED, PREDICTED, LOST = TEXT, AMBER, BLUE, WARNING
ACTION_COLOURS = ("#e69f00", "#3b9ede", "#12a37a", "#d55e00", "#cc79a7", "#7cc0ea", "#f0e442", "#a6a6a6")
STACKED = 3
"""Observed positions up to so many stand above one another, more in tabs of so many."""


def draw_rollouts(recording: rr.RecordingStream, artifact: Path) -> Page:
    """The page of a rollouts' recording, from what it carries. Raises InputError as `read_rollouts` does."""
    found = read_rollouts(artifact)
    times = found.frames.times
    log_solids(recording, found.solids, log_frames(recording, found.frames))
    _log_coordinates(recording, found, times)
    _log_state(recording, found, times)
    _log_rewards(recording, found, times)
    step, predicts = found.rollouts.step_duration, _predicts(found)
    below: list[rrb.View] = [
        whole_plot("gained", "Return so far", legend=False),
        sliding_plot("reward", "Reward", step, legend=False),
        sliding_plot("actions", "Actions", step),
    ]
    if found.rollouts.state.shape[1]:
        below.insert(0, sliding_plot("state", "Predictive state" if predicts else "Memory", step, legend=False))
    left = rrb.Vertical(
        robot_view(
            recording,
            "Robot and prediction" if predicts else "Robot",
            found.frames,
            found.solids,
            found.rollouts.trajectories.first,
            found.ground,
        ),
        rrb.Horizontal(below[0], rrb.Tabs(*below[1:])),
        row_shares=[2.0, 1.0],
    )
    body = rrb.Horizontal(left, _coordinate_views(found), column_shares=[1.6, 1.0])
    title = f"{artifact.stem}: {found.method} on {found.rollouts.settings.task}"
    return Page(
        title,
        about(title, _explanation(found), read_provenance(artifact), _episodes(found)),
        body,
        timeline=TIME,
        shares=(1.0, 3.6),
        playing=True,
    )


def _log_coordinates(recording: rr.RecordingStream, found: RolloutFile, times: Floats) -> None:
    """Of each observed position what is true, what was observed and what was expected; lost ones where expected."""
    rollouts = found.rollouts
    seen, degraded = rollouts.trajectories.seen, rollouts.settings.noise > 0.0 or rollouts.settings.drop > 0.0
    for k, name in enumerate(found.names):
        path = rr.new_entity_path(["observed", name])[1:]
        log_series(recording, f"{path}/true", times, rollouts.position[:, k], Series("true", TRUE, 1.5))
        predicted, there = rollouts.prediction[:, k], np.isfinite(rollouts.prediction[:, k])
        if there.any():
            log_series(
                recording, f"{path}/predicted", times[there], predicted[there], Series("predicted", PREDICTED, 1.5)
            )
        if degraded:
            look = Series("observed", OBSERVED, 2.0, "circle")
            log_series(recording, f"{path}/observed", times[seen], rollouts.trajectories.observation[seen, k], look)
        lost = ~seen & there
        if lost.any():
            log_series(recording, f"{path}/lost", times[lost], predicted[lost], Series("lost", LOST, 4.5, "cross"))


def _log_state(recording: rr.RecordingStream, found: RolloutFile, times: Floats) -> None:
    """The state's numbers, the first of them bright and the last faint."""
    state = found.rollouts.state
    if state.shape[1]:
        shades = [_between(PREDICTED, "#1d2a36", k / max(1, state.shape[1] - 1)) for k in range(state.shape[1])]
        log_series(recording, "state", times, state, *(Series(f"q{k + 1}", c, 1.2) for k, c in enumerate(shades)))


def _log_rewards(recording: rr.RecordingStream, found: RolloutFile, times: Floats) -> None:
    """Rewards, their sum within each episode, and the actions."""
    rows = found.rollouts.trajectories
    sums = np.cumsum(rows.reward)
    gained = sums - np.repeat(sums[rows.first[:-1]], rows.lengths)
    log_series(recording, "gained", times, gained, Series("return so far", GREEN, 2.0))
    log_series(recording, "reward", times, rows.reward, Series("reward", GREEN, 1.5))
    colours = [ACTION_COLOURS[k % len(ACTION_COLOURS)] for k in range(rows.action.shape[1])]
    looks = [Series(f"a{k + 1}", colour, 1.5) for k, colour in enumerate(colours)]
    log_series(recording, "actions", times, rows.action, *looks)


def _coordinate_views(found: RolloutFile) -> Layout:
    step = found.rollouts.step_duration
    plots = [
        sliding_plot(rr.new_entity_path(["observed", name])[1:], f"{name} [{unit}]", step, legend=k % STACKED == 0)
        for k, (name, unit) in enumerate(zip(found.names, found.units, strict=True))
    ]
    pages: list[Layout] = []
    for start in range(0, len(plots), STACKED):
        part = plots[start : start + STACKED]
        name = f"Positions {start + 1} to {start + len(part)}" if len(part) > 1 else f"Position {start + 1}"
        pages.append(rrb.Vertical(*part, name=name))
    return rrb.Tabs(*pages) if len(pages) > 1 else pages[0]


def _predicts(found: RolloutFile) -> bool:
    return any(frame.startswith(GHOST) for frame in found.frames.children)


def _explanation(found: RolloutFile) -> str:
    settings = found.rollouts.settings
    parts = [f"**{escape(found.method)}** acts on *{escape(settings.task)}*, whose positions alone are observed."]
    if settings.noise or settings.drop:
        noise = f"noise of {settings.noise:g} times each one's spread while exploring" if settings.noise else "no noise"
        lost = f", and {100 * settings.drop:g} % of observations are lost" if settings.drop else ""
        parts.append(f"There is {noise}{lost}.")
    if _predicts(found):
        parts.append(
            "The blue ghost is where the robot was expected one step before; where in the world it is comes from the "
            "robot itself, as that is not observed."
        )
    curves = ["white true"]
    curves += ["blue predicted"] if _predicts(found) else []
    curves += ["amber observed"] if settings.noise or settings.drop else []
    curves += ["crosses where an observation was lost"] if not found.rollouts.trajectories.seen.all() else []
    parts.append(f"In the plots: {', '.join(curves)}.")
    parts.append("Space plays and pauses.")
    return " ".join(parts)


def _episodes(found: RolloutFile) -> str:
    rows = found.rollouts.trajectories
    ends = ["fell" if rows.terminated[last - 1] else "cut off" for last in rows.first[1:]]
    starts = rows.first[:-1] * found.rollouts.step_duration
    lines = [
        (f"{start:.2f}", f"{value:.1f}", f"{length - 1}", end)
        for start, value, length, end in zip(starts, found.rollouts.returns, rows.lengths, ends, strict=True)
    ]
    header = ("from \\[s\\]", "return", "steps", "end")
    return "### Episodes\n\n" + markdown_table(header, lines, header[:3])


def _between(first: str, second: str, share: float) -> str:
    a, b = (np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) for colour in (first, second))
    return "#" + "".join(f"{int(part):02x}" for part in np.round(a + share * (b - a)))
