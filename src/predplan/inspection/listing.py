"""The page of a table that needs no picture: its first rows, and what its columns mean."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import rerun as rr

from predplan.artifacts.tables import read_provenance
from predplan.inspection.markdown import about, cell, escape, markdown_table
from predplan.inspection.recording import Page, log_text, text_view

SHOWN_ROWS = 200
_NAME = b"predplan.table"


def draw_table(recording: rr.RecordingStream, artifact: Path) -> Page:
    """The first rows of any table of ours."""
    with pq.ParquetFile(artifact) as file:
        schema, count = file.schema_arrow, file.metadata.num_rows
        rows = next(file.iter_batches(SHOWN_ROWS)).to_pylist()
    shown = f"The first {len(rows)} of {count:,} rows." if len(rows) < count else f"All {count:,} rows."
    numeric = [field.name for field in schema if pa.types.is_integer(field.type) or pa.types.is_floating(field.type)]
    lines = [[cell(value) for value in row.values()] for row in rows]
    heading = [_heading(field) for field in schema]
    right = [_heading(field) for field in schema if field.name in numeric]
    log_text(recording, "rows", f"{shown}\n\n{markdown_table(heading, lines, right)}")
    return _page(artifact, schema, shown, text_view("rows", "Rows"))


def draw_empty(recording: rr.RecordingStream, artifact: Path) -> Page:
    """A table without rows."""
    schema = pq.read_schema(artifact)
    log_text(recording, "rows", "The table has no rows.")
    return _page(artifact, schema, "The table has no rows.", text_view("rows", "Rows"))


def _page(artifact: Path, schema: pa.Schema, shown: str, body: rr.blueprint.View) -> Page:
    provenance, name = read_provenance(artifact), schema.metadata[_NAME].decode()
    title = f"{artifact.stem}: {name}" if artifact.stem != name else name
    return Page(title, about(title, shown, provenance, "### Columns", _columns(schema)), body, shares=(2.0, 3.0))


def _columns(schema: Sequence[pa.Field]) -> str:
    def of(field: pa.Field, key: bytes) -> str:
        return escape((field.metadata or {}).get(key, b"").decode())

    return markdown_table(
        ("column", "unit", "meaning"), [(escape(f.name), of(f, b"unit"), of(f, b"meaning")) for f in schema]
    )


def _heading(field: pa.Field) -> str:
    unit = (field.metadata or {}).get(b"unit", b"1").decode()
    return escape(field.name) if unit == "1" else f"{escape(field.name)} \\[{escape(unit)}\\]"
