"""The report from tables on disk, and what is said when one is missing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from predplan.artifacts.files import write_json
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import TableSchema, write_table
from predplan.control import tables as control
from predplan.errors import InputError
from predplan.labelling import tables
from stages import report
from tests.reporting.made import made_results
from tests.reporting.test_control import made_results as made_control

PARAMS = """root: .
params: p.yaml
out: {out}
reports: {out}/reports
workers: 1
labelling:
  corpora:
    made: {{source: twitter, sizes: [150], curve: [150], draws: 2}}
"""
TASK = """control:
  tasks:
    cartpole:
      task: cartpole
      steps: 4000
      methods: [rpsp, fm2]
      conditions: [{noise: 0.0, drop: 0.0}]
      seeds: 2
"""


@pytest.fixture
def params(tmp_path: Path) -> Path:
    folder, made = tmp_path / "results" / "labelling" / "made", made_results()
    for name in ("scores", "tag_scores", "confusion", "comparisons", "tagged", "curve", "ablations"):
        _write(folder / f"{name}.parquet", getattr(tables, name.upper()), getattr(made, name))
    _write(folder / "costs-anchor.parquet", tables.COSTS, made.costs)
    for name in ("baselines", "stacked"):
        _write(folder / f"costs-{name}.parquet", tables.COSTS, [])
    write_json(folder / "corpus.json", made.facts)
    write_json(folder / "tokenise.json", made.raw)
    (tmp_path / "p.yaml").write_text(PARAMS.format(out=tmp_path), encoding="utf-8")
    return tmp_path / "p.yaml"


def _write(path: Path, schema: TableSchema, rows: object) -> None:
    assert isinstance(rows, list)
    columns = {column.name: [row[column.name] for row in rows] for column in schema.columns}
    write_table(path, schema, columns, Provenance())


def test_report_and_its_figures(params: Path, tmp_path: Path) -> None:
    out = tmp_path / "reports"
    report.main(params, out)
    text = (out / "labelling.md").read_text(encoding="utf-8")
    linked = set(re.findall(r"\]\((labelling/[^)]+)\)", text))
    assert linked == {f"labelling/{path.name}" for path in (out / "labelling").iterdir()}
    assert len(linked) == 5
    assert "Table 3.1 on Twitter" in (out / "index.html").read_text(encoding="utf-8")


def test_same_bytes_twice_and_no_leftovers(params: Path, tmp_path: Path) -> None:
    out = tmp_path / "reports"
    report.main(params, out)
    first = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    (out / "labelling" / "old.svg").write_text("old", encoding="utf-8")
    report.main(params, out)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == first


def test_control_is_told_where_it_was_run(params: Path, tmp_path: Path) -> None:
    params.write_text(params.read_text(encoding="utf-8") + TASK, encoding="utf-8")
    made = made_control(2, ("rpsp", "fm2"), (("cartpole", 0.0, 0.0),))
    folder = tmp_path / "results" / "control" / "cartpole"
    for name, schema in (
        ("learning", control.LEARNING),
        ("runs", control.RUNS),
        ("prediction", control.PREDICTION),
        ("comparisons", control.COMPARISONS),
    ):
        _write(folder / f"{name}.parquet", schema, getattr(made, name))
    report.main(params, tmp_path / "reports")
    text = (tmp_path / "reports" / "control.md").read_text(encoding="utf-8")
    assert (tmp_path / "reports" / "control" / "learning.svg").is_file()
    assert "| exact positions | **" in text
    (folder / "comparisons.parquet").unlink()
    with pytest.raises(InputError, match=r"comparisons\.parquet: no such file.*dvc repro compare"):
        report.main(params, tmp_path / "reports")


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("scores.parquet", "evaluate"),
        ("costs-stacked.parquet", "stack"),
        ("costs-anchor.parquet", "tag"),
        ("corpus.json", "dvc repro corpus@made"),
        ("tokenise.json", "dvc repro tokenise@made"),
    ],
)
def test_missing_results_name_their_stage(params: Path, tmp_path: Path, name: str, remedy: str) -> None:
    (tmp_path / "results" / "labelling" / "made" / name).unlink()
    with pytest.raises(InputError, match=rf"{re.escape(name)}: no such file.*{remedy}"):
        report.main(params, tmp_path / "reports")


def test_facts_of_another_shape(params: Path, tmp_path: Path) -> None:
    write_json(tmp_path / "results" / "labelling" / "made" / "tokenise.json", {"lines": 1})
    with pytest.raises(InputError, match=r"expected the keys lines, tokens.*dvc repro tokenise@made"):
        report.main(params, tmp_path / "reports")


def test_nothing_scored(params: Path, tmp_path: Path) -> None:
    _write(tmp_path / "results" / "labelling" / "made" / "scores.parquet", tables.SCORES, [])
    with pytest.raises(InputError, match="no method was scored; run again: dvc repro evaluate@made"):
        report.main(params, tmp_path / "reports")
