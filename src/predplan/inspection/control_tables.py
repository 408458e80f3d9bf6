"""Pages of control's tables: learning, runs and errors of prediction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from predplan.artifacts.tables import read_provenance, read_rows
from predplan.control.comparing import summarise
from predplan.control.curves import Condition, condition_of, learning_curves
from predplan.control.tables import LEARNING, PREDICTION, RUNS, Row
from predplan.inspection.control_plots import ahead_plot, curve_plot, error_plot, mean_plot, named
from predplan.inspection.markdown import about, cell, escape, markdown_table
from predplan.inspection.recording import Page, log_picture, picture_view

SHARES = (1.0, 2.6)

CURVES = (
    ("return_mean", "Return", "mean return of a batch's episodes", False),
    ("prediction_error", "Prediction error", "error one step ahead, share of the exploration's variance", True),
    ("policy_kl", "Policy change", "divergence of the policy before from that after an update, nat", False),
    ("entropy", "Entropy", "entropy of the policy's actions, nat", False),
    ("value_error", "Value error", "error of the value, share of the variance of returns", False),
    ("cpu_s", "Processor time", "processor time so far, s", False),
)
"""Columns of the table `learning` that are drawn, their tabs, axes, and whether these are logarithmic."""


def draw_learning(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Curves of every condition: returns, and in tabs what else an update tells."""
    rows = read_rows(artifact, LEARNING)
    views = []
    for column, name, label, logarithmic in CURVES:
        curves = learning_curves(rows, column)
        if curves:
            log_picture(recording, column, curve_plot(curves, label, logarithmic))
            views.append(picture_view(column, name))
    runs = len({(condition_of(row), row["method"], row["seed"]) for row in rows})
    text = (
        f"{runs} runs. Lines are means over runs (their number in brackets), bands one standard error either side. "
        "A run that ended early counts for the rest with its first return, which is the exploration's."
    )
    return _page(artifact, "learning", text, _last(rows), rrb.Tabs(*views))


def draw_runs(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Means over training of every condition and method."""
    summary = summarise(read_rows(artifact, RUNS))
    log_picture(recording, "runs", mean_plot(summary))
    header = ("method", "runs", "mean return", "± s.e.", "at the end", "diverged")
    lines: list[tuple[str, ...]] = []
    before: Condition | None = None
    for row in summary:
        if condition_of(row) != before:
            before = condition_of(row)
            lines.append((f"**{escape(named(before))}**", "", "", "", "", ""))
        names = ("seeds", "mean_return", "standard_error", "final_return", "diverged")
        lines.append((escape(row["method"]), *(cell(row[name]) for name in names)))
    text = "Mean return over training, exploration included: what a run is compared by. Bars: one standard error."
    return _page(artifact, "runs", text, markdown_table(header, lines, header[1:]), picture_view("runs", "Mean return"))


def draw_prediction(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Errors one step ahead as bars, and by steps ahead where there are several."""
    rows = read_rows(artifact, PREDICTION)
    log_picture(recording, "errors", error_plot(rows))
    views = [picture_view("errors", "One step ahead")]
    if len({row["steps"] for row in rows}) > 1:
        log_picture(recording, "ahead", ahead_plot(rows))
        views.append(picture_view("ahead", "Several steps ahead"))
    text = (
        "Mean square error on exploration that no predictor was learned from, each coordinate over its variance: 1 is "
        "the error of the mean. Truth is what a perfect sensor would have seen. Bars are means over seeds, dashes the "
        "seeds."
    )
    return _page(artifact, "prediction", text, "", rrb.Tabs(*views))


def _page(artifact: Path, name: str, text: str, table: str, body: rrb.Container | rrb.View) -> Page:
    title = f"{artifact.stem}: {name}" if artifact.stem != name else name
    return Page(title, about(title, text, read_provenance(artifact), table), body, shares=SHARES)


def _last(rows: Sequence[Row]) -> str:
    """Steps and returns at the ends of curves."""
    header = ("method", "runs", "steps", "return", "± s.e.")
    lines: list[tuple[str, ...]] = []
    for condition, methods in learning_curves(rows).items():
        lines.append((f"**{escape(named(condition))}**", "", "", "", ""))
        for method, curve in methods.items():
            ends = (cell(float(curve.mean[-1])), cell(float(curve.error[-1])))
            lines.append((escape(method), f"{curve.seeds}", f"{curve.steps[-1]:,.0f}", *ends))
    return "### At the end\n\n" + markdown_table(header, lines, header[1:])
