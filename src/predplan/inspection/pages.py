"""Which page shows which artifact: a table by its name, a tagger by its header, plans and rollouts by their topics."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import rerun as rr

from predplan.artifacts.files import write_whole
from predplan.artifacts.provenance import hash_file
from predplan.artifacts.tables import read_provenance
from predplan.errors import InputError
from predplan.inspection.labelling import draw_anchors, draw_posteriors, draw_transitions
from predplan.inspection.labelling_results import draw_confusion, draw_curve, draw_tagged
from predplan.inspection.listing import draw_empty, draw_table
from predplan.inspection.moments import draw_moments
from predplan.inspection.recording import Page, import_recording, write_recording

Draw = Callable[[rr.RecordingStream, Path], Page]

DRAWN: Mapping[str, Draw] = {
    "words": draw_moments,
    "bigrams": draw_moments,
    "anchors": draw_anchors,
    "posteriors": draw_posteriors,
    "transitions": draw_transitions,
    "confusion": draw_confusion,
    "tagged": draw_tagged,
    "curve": draw_curve,
}
"""Tables with a page of their own; any other table of ours is listed."""

CONTROL = {"learning": "draw_learning", "runs": "draw_runs", "prediction": "draw_prediction"}
"""Those of control, imported when they are drawn."""

_NAME = b"predplan.table"
_HEADER = "model.json"
_KNOWN = f"a table of predplan (.parquet), a folder of a tagger ({_HEADER}), or a recording (.rrd, .mcap)"


def record(artifact: Path, out: Path) -> None:
    """Write the recording of an artifact, whole.

    Raises InputError for what is no artifact of predplan, naming what was found and what is known, and where a
    table's columns are not as they should be or a table that belongs to it is missing beside it.
    """
    if artifact.is_dir():
        # Taggers bring the solvers with them, which no table needs.
        from predplan.inspection.tagger import draw_tagger

        header = _header(artifact)
        write_recording(out, "tagger", _identity(header), None, lambda recording: draw_tagger(recording, artifact))
    elif not artifact.is_file():
        raise InputError(f"{artifact}: no such file or folder; expected {_KNOWN}")
    elif artifact.suffix == ".rrd":
        with write_whole(out) as temporary:
            shutil.copyfile(artifact, temporary)
    elif artifact.suffix == ".mcap":
        drawn = _own_page(artifact)
        if drawn is not None:
            from predplan.artifacts import mcap

            kind, draw_own = drawn
            made = mcap.read_provenance(artifact)
            write_recording(out, kind, _identity(artifact), made, lambda recording: draw_own(recording, artifact))
        else:
            import_recording(artifact, out)
    else:
        name, rows = _table(artifact)
        draw = _drawn(name) if rows else draw_empty
        write_recording(
            out, name, _identity(artifact), read_provenance(artifact), lambda recording: draw(recording, artifact)
        )


@contextmanager
def viewable(artifact: Path) -> Iterator[Path]:
    """A file that the viewer opens: the artifact where it is a recording, else one that lasts as long as the block."""
    if artifact.is_file() and (
        artifact.suffix == ".rrd" or (artifact.suffix == ".mcap" and _own_page(artifact) is None)
    ):
        yield artifact
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{artifact.stem}.rrd"
        record(artifact, file)
        yield file


def _drawn(name: str) -> Draw:
    """The page of a table."""
    if name in CONTROL:
        # Its pages bring the statistics with them.
        from predplan.inspection import control_tables

        draw: Draw = getattr(control_tables, CONTROL[name])
        return draw
    return DRAWN.get(name, draw_table)


def _table(artifact: Path) -> tuple[str, int]:
    """Name and number of rows of a table of ours."""
    try:
        found = pq.read_metadata(artifact)
    except (pa.ArrowException, OSError) as error:
        kind = f"a {artifact.suffix} file" if artifact.suffix else "a file"
        raise InputError(f"{artifact}: {kind} that is not whole Parquet; expected {_KNOWN}") from error
    name = (found.metadata or {}).get(_NAME)
    if name is None:
        columns = ", ".join(found.schema.to_arrow_schema().names)
        raise InputError(f"{artifact}: a foreign Parquet file with columns {columns}; expected {_KNOWN}")
    return name.decode(), found.num_rows


def _own_page(recording: Path) -> tuple[str, Draw] | None:
    """Kind and page of an MCAP file that is a plan or rollouts of ours; the viewer reads any other as it is."""
    try:
        from predplan.artifacts.mcap import read_topics

        topics = read_topics(recording).keys()
        # Only plans bring the planner with them, only rollouts the simulator.
        if {"/clearance", "/scene", "/tf"} <= topics:
            from predplan.inspection.planning import draw_plan

            return "plan", draw_plan
        if {"/steps", "/scene", "/tf"} <= topics:
            from predplan.inspection.control import draw_rollouts

            return "rollouts", draw_rollouts
    except (InputError, ImportError):  # without their extra there are neither plans nor rollouts
        pass
    return None


def _header(folder: Path) -> Path:
    header = folder / _HEADER
    if not header.is_file():
        found = ", ".join(sorted(path.name for path in folder.iterdir())[:5]) or "nothing"
        raise InputError(f"{folder}: a folder that holds {found} and no {_HEADER}; expected {_KNOWN}")
    return header


def _identity(path: Path) -> str:
    """The same artifact, the same recording."""
    return hash_file(path)[:16]
