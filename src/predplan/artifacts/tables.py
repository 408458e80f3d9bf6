"""Parquet tables that carry their schema, units and provenance, and readers that check them.

Column names, types, units and meanings are the fields' metadata; the table's name and provenance are the file's.
The same table gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import pyarrow as pa
import pyarrow.parquet as pq

from predplan.artifacts.files import write_whole
from predplan.artifacts.provenance import Provenance
from predplan.errors import InputError

ROW_GROUP_ROWS = 1 << 18
_NAME = b"predplan.table"
_PROVENANCE = b"predplan.provenance"

TableLike: TypeAlias = pa.Table | Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """A column: its Arrow type, the unit of its values ("1" for none) and what one value means."""

    name: str
    type: pa.DataType
    unit: str
    meaning: str
    nullable: bool = False


@dataclass(frozen=True)
class TableSchema:
    """A kind of table, the stage that makes it, its columns in order, and what runs the stage."""

    name: str
    stage: str
    columns: tuple[Column, ...]
    runner: str = "dvc repro"

    @property
    def arrow(self) -> pa.Schema:
        """The Arrow schema with each column's unit and meaning in its metadata."""
        return pa.schema(
            pa.field(c.name, c.type, nullable=c.nullable, metadata={"unit": c.unit, "meaning": c.meaning})
            for c in self.columns
        )


def write_table(path: Path, schema: TableSchema, table: TableLike, provenance: Provenance) -> None:
    """Write a whole table: an Arrow table, or a mapping from every column's name to its values.

    Raises ValueError where columns are missing, unknown, of unequal length, or do not fit their types.
    """
    with open_writer(path, schema, provenance) as write:
        write(table)


@contextmanager
def open_writer(path: Path, schema: TableSchema, provenance: Provenance) -> Iterator[Callable[[TableLike], None]]:
    """A function that adds rows; the file appears at `path`, whole, when the block ends without an error.

    Each call writes its rows at once, as one row group or more, so memory holds one call's rows only.
    """
    metadata = {_NAME: schema.name, _PROVENANCE: provenance.to_json()}
    arrow = schema.arrow.with_metadata(metadata)
    with write_whole(path) as temporary, pq.ParquetWriter(temporary, arrow, compression="zstd") as writer:

        def write(rows: TableLike) -> None:
            # Chunk borders would move page borders, and with them the bytes.
            writer.write_table(_conform(rows, schema, arrow).combine_chunks(), row_group_size=ROW_GROUP_ROWS)

        yield write


def write_rows(path: Path, schema: TableSchema, rows: Sequence[Mapping[str, Any]], provenance: Provenance) -> None:
    """Write a table of rows, of which each has every column."""
    write_table(
        path, schema, {column.name: [row[column.name] for row in rows] for column in schema.columns}, provenance
    )


def read_table(path: Path, schema: TableSchema) -> pa.Table:
    """The whole table. Raises InputError as `open_table` does."""
    with open_table(path, schema) as file:
        try:
            return file.read()
        except (pa.ArrowException, OSError) as error:
            raise _broken(path, schema, error) from error


def read_rows(path: Path, schema: TableSchema) -> list[dict[str, Any]]:
    """The rows of a table. Raises InputError as `read_table` does."""
    rows: list[dict[str, Any]] = read_table(path, schema).to_pylist()
    return rows


@contextmanager
def open_table(path: Path, schema: TableSchema) -> Iterator[pq.ParquetFile]:
    """The file, checked against the schema, to read in parts (`iter_batches`, `read_row_group`).

    Raises InputError, which names the stage to run again, if the file is missing, truncated, not Parquet, or holds
    other columns than the schema's.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; {_remedy(schema)}")
    try:
        file = pq.ParquetFile(path)
    except (pa.ArrowException, OSError) as error:
        raise _broken(path, schema, error) from error
    with file:
        _check(path, schema, file.schema_arrow)
        yield file


def read_provenance(path: Path) -> Provenance:
    """The provenance in a table's file. Raises InputError if the file is no table of ours."""
    try:
        metadata = pq.read_metadata(path).metadata or {}
        return Provenance.from_json(metadata[_PROVENANCE])
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: carries no provenance; expected a table written by predplan") from error


def _conform(rows: TableLike, schema: TableSchema, arrow: pa.Schema) -> pa.Table:
    names = rows.column_names if isinstance(rows, pa.Table) else list(rows)
    if sorted(names) != sorted(arrow.names):
        raise ValueError(f"table {schema.name!r} has columns {', '.join(arrow.names)}; got {', '.join(names)}")
    columns = [_conform_column(rows[column.name], column, schema) for column in schema.columns]
    if len({len(values) for values in columns}) > 1:
        lengths = ", ".join(f"{name} {len(values)}" for name, values in zip(arrow.names, columns, strict=True))
        raise ValueError(f"table {schema.name!r}: columns of unequal length: {lengths}")
    return pa.Table.from_arrays(columns, schema=arrow)


def _conform_column(values: Any, column: Column, schema: TableSchema) -> pa.Array | pa.ChunkedArray:
    try:
        arrow = values if isinstance(values, pa.Array | pa.ChunkedArray) else pa.array(values, column.type)
        arrow = arrow.cast(column.type)
    except pa.ArrowException as error:
        raise ValueError(f"table {schema.name!r}, column {column.name!r}: {error}") from error
    if arrow.null_count and not column.nullable:
        raise ValueError(f"table {schema.name!r}, column {column.name!r}: {arrow.null_count} missing values")
    return arrow


def _check(path: Path, schema: TableSchema, found: pa.Schema) -> None:
    name = (found.metadata or {}).get(_NAME, b"").decode()
    if name and name != schema.name:
        raise InputError(f"{path}: holds the table {name!r}, expected {schema.name!r}; {_remedy(schema)}")
    for column in schema.columns:
        if column.name not in found.names:
            listed = ", ".join(found.names)
            raise InputError(f"{path}: no column {column.name!r} among {listed}; {_remedy(schema)}")
        kind = found.field(column.name).type
        if kind != column.type:
            raise InputError(f"{path}: column {column.name!r} is {kind}, expected {column.type}; {_remedy(schema)}")
    expected = [column.name for column in schema.columns]
    if found.names != expected:
        raise InputError(
            f"{path}: columns are {', '.join(found.names)}, expected {', '.join(expected)}; {_remedy(schema)}"
        )


def _broken(path: Path, schema: TableSchema, error: Exception) -> InputError:
    reason = str(error).splitlines()[0].rstrip(".")
    return InputError(f"{path}: not a whole Parquet file ({reason}); {_remedy(schema)}")


def _remedy(schema: TableSchema) -> str:
    return f"make it again: {schema.runner} {schema.stage}"
