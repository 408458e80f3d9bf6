"""Make the report from what the stages wrote: index.html, and for each system Markdown with its figures beside it."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from predplan.artifacts.files import read_json, write_whole
from predplan.artifacts.tables import read_rows
from predplan.control.benchmark_tables import PEERS, SPEEDS
from predplan.control.tables import COMPARISONS as RUN_TESTS
from predplan.control.tables import LEARNING, PREDICTION, RUNS
from predplan.errors import InputError, PredplanError
from predplan.labelling.methods import UNTIMED
from predplan.labelling.tables import ABLATIONS, COMPARISONS, CONFUSION, COSTS, CURVE, SCORES, TAG_SCORES, TAGGED
from predplan.planning.benchmark_tables import PLANS
from predplan.planning.benchmark_tables import SUMMARY as SUMMARIES
from predplan.planning.tables import COMPARISONS as TESTS
from predplan.planning.tables import CURVES as COST_CURVES
from predplan.planning.tables import EXAMPLE, FIELD, OUTCOMES, STEPS, TIMES
from predplan.reporting.control.results import ControlResults
from predplan.reporting.control.section import control_section
from predplan.reporting.control.speeds import peers_table, speeds_table
from predplan.reporting.document import Section, Table
from predplan.reporting.labelling.results import CorpusResults
from predplan.reporting.labelling.section import labelling_section
from predplan.reporting.markdown import all_figures, to_markdown
from predplan.reporting.page import to_page
from predplan.reporting.planning.motion_bench import motion_bench_section
from predplan.reporting.planning.results import SuiteResults
from predplan.reporting.planning.section import planning_section
from stages.settings import CorpusSettings, Settings, SuiteSettings, load_settings

TITLE = "predplan"
SUMMARY = (
    "Prediction and planning with kernels and moments: the thesis's experiments, rebuilt. This page needs no network."
)


def main(params: Path, out: Path) -> None:
    """Read every system's results and write the report into the folder `out`."""
    settings = load_settings(params)
    folder = Path(settings.out) / "results" / "labelling"
    corpora = [read_results(folder / name, name, corpus) for name, corpus in settings.labelling.corpora.items()]
    if not corpora:
        raise InputError(f"{params}: labelling.corpora is empty; expected one corpus at least")
    planning = planning_section(read_suites(settings), read_benchmark(settings))
    control = control_section(read_control(settings), read_speeds(settings))
    write_report(out, [labelling_section(corpora), planning, control])


def read_results(folder: Path, name: str, settings: CorpusSettings) -> CorpusResults:
    """One corpus's results. Raises InputError, which names the stage to run again, where one is missing or broken."""
    costs = [(part, stage) for part, stage in (("anchor", "tag"), ("baselines", "baselines"), ("stacked", "stack"))]
    ablations = folder / "ablations.parquet"
    results = CorpusResults(
        name=name,
        source=settings.source,
        dictionary=settings.dictionary,
        scores=read_rows(folder / "scores.parquet", SCORES),
        tag_scores=read_rows(folder / "tag_scores.parquet", TAG_SCORES),
        confusion=read_rows(folder / "confusion.parquet", CONFUSION),
        comparisons=read_rows(folder / "comparisons.parquet", COMPARISONS),
        tagged=read_rows(folder / "tagged.parquet", TAGGED),
        curve=read_rows(folder / "curve.parquet", CURVE),
        costs=[
            row
            for part, stage in costs
            for row in read_rows(folder / f"costs-{part}.parquet", replace(COSTS, stage=stage))
            if row["method"] not in UNTIMED
        ],
        ablations=read_rows(ablations, ABLATIONS) if ablations.exists() else [],
        facts=_facts(folder / "corpus.json", "corpus", ("sources", "parts", "dictionary_entries")),
        raw=_facts(folder / "tokenise.json", "tokenise", ("lines", "tokens", "words", "malformed")),
    )
    if not results.scores or not results.tagged:
        raise InputError(f"{folder}: no method was scored; run again: dvc repro evaluate@{name}")
    return results


def read_benchmark(settings: Settings) -> Section | None:
    """The section on published problems, where they were run (make bench)."""
    folder = Path(settings.out) / "results" / "planning" / "motion-bench"
    if not (folder / "summary.parquet").exists():
        return None
    return motion_bench_section(
        read_rows(folder / "plans.parquet", PLANS), read_rows(folder / "summary.parquet", SUMMARIES)
    )


def read_suites(settings: Settings) -> list[SuiteResults]:
    """Every suite's results, in the order of the settings."""
    folder = Path(settings.out) / "results" / "planning"
    return [read_suite(folder / name, name, suite) for name, suite in settings.planning.suites.items()]


def read_suite(folder: Path, name: str, settings: SuiteSettings) -> SuiteResults:
    """One suite's results. Raises InputError, which names the stage to run again, where one is missing or broken."""
    tables = {
        schema.name: read_rows(folder / f"{schema.name}.parquet", replace(schema, stage=f"compare@{name}"))
        for schema in (COST_CURVES, TESTS, EXAMPLE, FIELD, OUTCOMES, TIMES, STEPS)
    }
    return SuiteResults(
        name=name,
        kind=settings.kind,
        problems=settings.problems,
        tuning=settings.tuning,
        iterations=settings.iterations,
        epsilon=settings.epsilon,
        steps_of=settings.steps_of,
        **tables,
    )


def read_control(settings: Settings) -> ControlResults:
    """The results of all tasks together, none where none was run.

    Raises InputError, which names the stage to run again, where a task lacks one of its tables.
    """
    folders = [Path(settings.out) / "results" / "control" / name for name in settings.control.tasks]
    tables = {
        name: [row for folder in folders for row in read_rows(folder / f"{name}.parquet", schema)]
        for name, schema in (
            ("learning", LEARNING),
            ("runs", RUNS),
            ("prediction", PREDICTION),
            ("comparisons", RUN_TESTS),
        )
    }
    return ControlResults(**tables)


def read_speeds(settings: Settings) -> list[Table]:
    """Control's speeds, where they were measured (make bench)."""
    folder = Path(settings.out) / "results" / "control"
    found = ((folder / "speeds.parquet", SPEEDS, speeds_table), (folder / "peers.parquet", PEERS, peers_table))
    return [table(read_rows(path, schema)) for path, schema, table in found if path.exists()]


def write_report(out: Path, systems: Sequence[Section]) -> None:
    """index.html; for each system NAME.md and the folder NAME of its figures, made anew."""
    for system in systems:
        name = system.title.lower()
        shutil.rmtree(out / name, ignore_errors=True)
        (out / name).mkdir(parents=True)
        for figure in all_figures(system):
            _write(out / name / f"{figure.name}.svg", figure.svg)
        _write(out / f"{name}.md", to_markdown(system, name))
    _write(out / "index.html", to_page(TITLE, SUMMARY, systems))


def _write(path: Path, text: str) -> None:
    with write_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _facts(path: Path, stage: str, keys: tuple[str, ...]) -> dict[str, Any]:
    remedy = f"run stage {stage} again: dvc repro {stage}@{path.parent.name}"
    if not path.exists():
        raise InputError(f"{path}: no such file; {remedy}")
    facts = read_json(path)
    if not isinstance(facts, dict) or not facts.keys() >= set(keys):
        raise InputError(f"{path}: expected the keys {', '.join(keys)}; {remedy}")
    return facts


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument("out", type=Path, help="folder of the report")
    arguments = parser.parse_args()
    try:
        main(arguments.params, arguments.out)
    except PredplanError as error:
        sys.stderr.write(f"stage report failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)
