"""Recordings: pictures, documents and curves on named entities, a layout that travels with them, and the viewer."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from predplan.artifacts.files import write_whole
from predplan.artifacts.provenance import Provenance
from predplan.errors import InputError, PredplanError
from predplan.inspection.markdown import viewable
from predplan.inspection.palette import BACKGROUND, rgb

ABOUT = "about"
Layout = rrb.Container | rrb.View


@dataclass(frozen=True)
class Page:
    """What a recording is called, what its panel says (Markdown), how its views lie, and the timeline to move along.

    playing: the timeline is one of seconds, and runs round and round from the start.
    """

    title: str
    about: str
    body: Layout
    side: Layout | None = None
    timeline: str | None = None
    shares: tuple[float, float] = (1.0, 2.0)
    playing: bool = False


Draw = Callable[[rr.RecordingStream], Page]


def write_recording(out: Path, kind: str, identity: str, provenance: Provenance | None, draw: Draw) -> None:
    """Write a recording, whole.

    kind names the kind of artifact, whose pages share what a user changes of the layout; identity is the recording's.
    """
    recording = rr.RecordingStream(f"predplan_{kind.replace(' ', '_')}", recording_id=identity)
    page = draw(recording)
    log_text(recording, ABOUT, page.about)
    recording.send_recording_name(viewable(page.title))
    if provenance is not None:
        recording.send_property("provenance", rr.AnyValues(json=provenance.to_json()))
    with write_whole(out) as temporary:
        recording.save(temporary, default_blueprint=_blueprint(page))
        recording.flush()
        recording.disconnect()


def import_recording(artifact: Path, out: Path) -> None:
    """A recording of a file that the viewer itself reads (MCAP). Raises InputError where it finds nothing in it."""
    recording = rr.RecordingStream("predplan_imported", recording_id=artifact.stem)
    recording.log_file_from_path(artifact)
    with write_whole(out) as temporary:
        recording.save(temporary)
        recording.flush()
        recording.disconnect()
        # The importer reports a broken file on stderr only.
        if not RrdReader(temporary).store().schema().entity_paths():
            raise InputError(f"{artifact}: holds no message, or is cut short; expected a whole {artifact.suffix} file")


def open_viewer(file: Path) -> None:
    """Open the viewer on a file and wait until it is closed; its server listens on this machine's loopback only."""
    command = [sys.executable, "-m", "rerun", str(file), "--bind", "127.0.0.1", "--port", "auto"]
    environment = {"RUST_LOG": "error", **os.environ, "RERUN_ANALYTICS_ENABLED": "0"}
    if subprocess.run(command, env=environment, check=False).returncode:
        raise PredplanError(
            "the viewer ended with an error; is there a screen? --save FILE.rrd writes a recording instead"
        )


def log_picture(recording: rr.RecordingStream, path: str, png: bytes) -> None:
    """A picture for all times."""
    recording.log(path, rr.EncodedImage(contents=png, media_type="image/png"), static=True)


def log_pictures(recording: rr.RecordingStream, path: str, timeline: str, pictures: Sequence[bytes]) -> None:
    """A picture for each step of a timeline."""
    columns = rr.EncodedImage.columns(blob=list(pictures), media_type=["image/png"] * len(pictures))
    recording.send_columns(path, [_steps(timeline, len(pictures))], columns)


def log_text(recording: rr.RecordingStream, path: str, text: str) -> None:
    """A Markdown document for all times."""
    recording.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def log_texts(recording: rr.RecordingStream, path: str, timeline: str, texts: Sequence[str]) -> None:
    """A Markdown document for each step of a timeline."""
    columns = rr.TextDocument.columns(text=list(texts), media_type=[rr.MediaType.MARKDOWN] * len(texts))
    recording.send_columns(path, [_steps(timeline, len(texts))], columns)


def picture_view(path: str, name: str) -> rrb.Spatial2DView:
    """The view of a picture, without a border."""
    return rrb.Spatial2DView(origin=path, name=viewable(name), background=[*rgb(BACKGROUND), 255])


def text_view(path: str, name: str) -> rrb.TextDocumentView:
    """The view of a document."""
    return rrb.TextDocumentView(origin=path, name=viewable(name))


def _steps(timeline: str, count: int) -> rr.TimeColumn:
    return rr.TimeColumn(timeline, sequence=np.arange(count))


def _blueprint(page: Page) -> rrb.Blueprint:
    left: Layout = text_view(ABOUT, "What this is")
    if page.side is not None:
        left = rrb.Vertical(left, page.side)
    time = rrb.TimePanel(
        state="collapsed" if page.timeline else "hidden",
        timeline=page.timeline,
        play_state="playing" if page.playing else "paused",
        loop_mode="all" if page.playing else None,
        fps=1.0,
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, page.body, column_shares=list(page.shares)),
        time,
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
