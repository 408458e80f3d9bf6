from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import (
    Column,
    TableSchema,
    open_table,
    open_writer,
    read_provenance,
    read_table,
    write_table,
)
from predplan.errors import InputError

SCORES = TableSchema(
    name="scores",
    stage="evaluate",
    columns=(
        Column("tag", pa.string(), "1", "universal tag"),
        Column("time_s", pa.float64(), "s", "time taken"),
        Column("note", pa.string(), "1", "a remark, if any", nullable=True),
    ),
)
ROWS = {"tag": ["NOUN", "VERB"], "time_s": np.array([1.5, 2.5]), "note": [None, "slow"]}
PROVENANCE = Provenance({"lambda": 0.5}, seed=7, upstream={"tokens": "00" * 32})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "scores.parquet"


def test_a_table_comes_back_with_units_and_provenance(path: Path) -> None:
    write_table(path, SCORES, ROWS, PROVENANCE)
    table = read_table(path, SCORES)
    assert table.to_pydict() == {"tag": ["NOUN", "VERB"], "time_s": [1.5, 2.5], "note": [None, "slow"]}
    assert table.schema.field("time_s").metadata == {b"unit": b"s", b"meaning": b"time taken"}
    assert read_provenance(path) == PROVENANCE


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.lists(st.tuples(st.text(), st.floats(allow_nan=False), st.none() | st.text())))
def test_any_rows_come_back(path: Path, rows: list[tuple[str, float, str | None]]) -> None:
    columns = {column.name: [row[i] for row in rows] for i, column in enumerate(SCORES.columns)}
    write_table(path, SCORES, columns, PROVENANCE)
    assert read_table(path, SCORES).to_pydict() == columns


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (pa.dictionary(pa.int32(), pa.string()), ["a", "b", "a"]),
        (pa.list_(pa.float32()), [[1.0, 2.0], [], [3.0]]),
        (pa.large_string(), ["x", "y", "z"]),
        (pa.list_(pa.float64(), 2), [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
    ],
)
def test_types_that_parquet_lacks_come_back(path: Path, kind: pa.DataType, values: list[Any]) -> None:
    schema = TableSchema("t", "s", (Column("x", kind, "1", "anything"),))
    write_table(path, schema, {"x": values}, PROVENANCE)
    assert read_table(path, schema)["x"].to_pylist() == values


def test_the_same_table_gives_the_same_bytes_however_it_is_chunked(path: Path, tmp_path: Path) -> None:
    whole = pa.table(ROWS, schema=SCORES.arrow)
    chunked = pa.concat_tables([whole.slice(0, 1), whole.slice(1)])
    write_table(path, SCORES, whole, PROVENANCE)
    write_table(tmp_path / "b.parquet", SCORES, chunked.select(["note", "tag", "time_s"]), PROVENANCE)
    assert path.read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_rows_written_in_parts_are_one_table_with_a_row_group_a_part(path: Path) -> None:
    with open_writer(path, SCORES, PROVENANCE) as write:
        for _ in range(3):
            write(ROWS)
        assert not path.exists()
    with open_table(path, SCORES) as file:
        assert file.num_row_groups == 3
        assert [batch.num_rows for batch in file.iter_batches(batch_size=4)] == [4, 2]
    assert read_provenance(path) == PROVENANCE


def test_an_interrupted_writer_leaves_nothing(path: Path) -> None:
    def write_one_part() -> None:
        with open_writer(path, SCORES, PROVENANCE) as write:
            write(ROWS)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_one_part()
    assert not list(path.parent.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_s": None}, "has columns tag, time_s, note; got tag, note"),
        ({"more": [1, 2]}, "got tag, time_s, note, more"),
        ({"time_s": ["a", "b"]}, "'scores', column 'time_s': .*'a'"),
        ({"time_s": [1.0]}, "unequal length: tag 2, time_s 1, note 2"),
        ({"tag": ["NOUN", None]}, "'scores', column 'tag': 1 missing values"),
    ],
)
def test_rows_that_do_not_fit_are_refused(path: Path, change: dict[str, Any], message: str) -> None:
    rows = {name: values for name, values in (ROWS | change).items() if values is not None}
    with pytest.raises(ValueError, match=message):
        write_table(path, SCORES, rows, PROVENANCE)
    assert not path.exists()


def _altered(column: Column | None, name: str = "scores") -> TableSchema:
    kept = tuple(c for c in SCORES.columns if column is None or c.name != column.name)
    return TableSchema(name, "evaluate", (*kept, column) if column else kept[:2])


@pytest.mark.parametrize(
    ("expected", "message"),
    [
        (_altered(Column("time_s", pa.int64(), "s", "time")), "column 'time_s' is double, expected int64"),
        (_altered(Column("f1", pa.float64(), "1", "F1")), "no column 'f1' among tag, time_s, note"),
        (_altered(None), "columns are tag, time_s, note, expected tag, time_s"),
        (_altered(None, name="anchors"), "holds the table 'scores', expected 'anchors'"),
    ],
)
def test_another_schema_is_said_with_the_stage_to_run(path: Path, expected: TableSchema, message: str) -> None:
    write_table(path, SCORES, ROWS, PROVENANCE)
    with pytest.raises(InputError, match=rf"{path.name}: {message}.*; make it again: dvc repro evaluate"):
        read_table(path, expected)


def test_a_file_cut_short_anywhere_is_said(path: Path) -> None:
    write_table(path, SCORES, ROWS, PROVENANCE)
    content = path.read_bytes()
    for size in range(0, len(content), 37):
        path.write_bytes(content[:size])
        with pytest.raises(InputError, match=r"not a whole Parquet file .*; make it again: dvc repro evaluate"):
            read_table(path, SCORES)


def test_damaged_data_under_a_whole_footer_is_said(path: Path) -> None:
    write_table(path, SCORES, ROWS, PROVENANCE)
    content = bytearray(path.read_bytes())
    content[4:60] = bytes(56)
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a whole Parquet file"):
        read_table(path, SCORES)


@pytest.mark.parametrize("content", [b"tag,time_s\nNOUN,1\n", b"PAR1PAR1", None])
def test_a_foreign_or_missing_file_is_said(path: Path, content: bytes | None) -> None:
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(
        InputError, match=r"scores\.parquet: (not a whole Parquet file|no such file).*dvc repro evaluate"
    ):
        read_table(path, SCORES)
    with pytest.raises(InputError, match=r"scores\.parquet: (carries no provenance|no such file)"):
        read_provenance(path)


def test_a_parquet_file_of_another_program_carries_no_provenance(path: Path) -> None:
    pq.write_table(pa.table({"x": [1]}), path)
    with pytest.raises(InputError, match="carries no provenance"):
        read_provenance(path)
