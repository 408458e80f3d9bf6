"""Which page shows which artifact: a table by its name, a tagger by its header, a plan by its topics."""

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

DRAWN: Mapping[str, Callable[[rr.RecordingStream, Path], Page]] = {
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
        if _is_plan(artifact):
            # Only plans bring the planner with them.
            from predplan.artifacts import mcap
            from predplan.inspection.planning import draw_plan

            made = mcap.read_provenance(artifact)
            write_recording(out, "plan", _identity(artifact), made, lambda recording: draw_plan(recording, artifact))
        else:
            import_recording(artifact, out)
    else:
        name, rows = _table(artifact)
        draw = DRAWN.get(name, draw_table) if rows else draw_empty
        write_recording(
            out, name, _identity(artifact), read_provenance(artifact), lambda recording: draw(recording, artifact)
        )


@contextmanager
def viewable(artifact: Path) -> Iterator[Path]:
    """A file that the viewer opens: the artifact where it is a recording, else one that lasts as long as the block."""
    if artifact.is_file() and (artifact.suffix == ".rrd" or (artifact.suffix == ".mcap" and not _is_plan(artifact))):
        yield artifact
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{artifact.stem}.rrd"
        record(artifact, file)
        yield file


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


def _is_plan(recording: Path) -> bool:
    """Whether an MCAP file is a plan of ours, which has a page of its own; the viewer reads any other as it is."""
    try:
        from predplan.artifacts.mcap import read_topics

        return {"/clearance", "/scene", "/tf"} <= read_topics(recording).keys()
    except (InputError, ImportError):  # without the planning extra there are no plans
        return False


def _header(folder: Path) -> Path:
    header = folder / _HEADER
    if not header.is_file():
        found = ", ".join(sorted(path.name for path in folder.iterdir())[:5]) or "nothing"
        raise InputError(f"{folder}: a folder that holds {found} and no {_HEADER}; expected {_KNOWN}")
    return header


def _identity(path: Path) -> str:
    """The same artifact, the same recording."""
    return hash_file(path)[:16]
