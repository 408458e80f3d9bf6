"""Tables of the control branch: what their errors tell a user to run is there to be run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from predplan.artifacts.tables import TableSchema, read_table
from predplan.control import benchmark_tables, tables
from predplan.errors import InputError

ROOT = Path(__file__).parents[2]
STAGES = set(yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"])
TARGETS = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


@pytest.mark.parametrize(
    "schema",
    [one for module in (tables, benchmark_tables) for one in vars(module).values() if isinstance(one, TableSchema)],
    ids=lambda schema: schema.name,
)
def test_remedies_can_be_run(schema: TableSchema, tmp_path: Path) -> None:
    with pytest.raises(InputError) as found:
        read_table(tmp_path / "missing.parquet", schema)
    remedy = re.search(r"make it again: (dvc repro|make) (\S+)$", str(found.value))
    assert remedy is not None
    assert remedy[2] in (STAGES if remedy[1] == "dvc repro" else TARGETS)
