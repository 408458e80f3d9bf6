"""The whole pipeline on a small generated corpus: every stage in this process, then all of them under DVC."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from dvc.repo import Repo
from ruamel.yaml import YAML

from predplan.artifacts.tables import TableSchema, read_table
from predplan.labelling import counting, tables, tokenising
from stages import report
from stages.common import CorpusStage, run_stage
from stages.labelling import (
    ablate,
    anchors,
    baselines,
    corpus,
    curve,
    emissions,
    evaluate,
    inspect,
    moments,
    stack,
    tag,
    tokenise,
    transitions,
)
from stages.settings import load_settings
from tests.labelling.generated import draw_corpus, write_labelled, write_raw

REPOSITORY = Path(__file__).resolve().parents[2]
STAGES: tuple[ModuleType, ...] = (
    corpus,
    tokenise,
    moments,
    anchors,
    emissions,
    transitions,
    tag,
    baselines,
    stack,
    curve,
    ablate,
    evaluate,
    inspect,
)
MADE = {
    "train": tables.SENTENCES,
    "dev": tables.SENTENCES,
    "test_gold": tables.SENTENCES,
    "test_words": tables.UNTAGGED,
    "dictionary": tables.DICTIONARY,
    "tokens": tables.TOKENS,
    "vocabulary": tables.VOCABULARY,
    "words": tables.WORDS,
    "bigrams": tables.BIGRAMS,
    "anchors": tables.ANCHORS,
    "tags": tables.TAG_NAMES,
    "posteriors": tables.POSTERIORS,
    "transitions": tables.TRANSITIONS,
    "predictions-anchor": tables.PREDICTIONS,
    "predictions-baselines": tables.PREDICTIONS,
    "predictions-stacked": tables.PREDICTIONS,
    "predictions-curve": tables.PREDICTIONS,
    "costs-anchor": tables.COSTS,
    "costs-baselines": tables.COSTS,
    "costs-stacked": tables.COSTS,
    "costs-curve": tables.COSTS,
    "ablations": tables.ABLATIONS,
}
RESULTS = {
    "scores": tables.SCORES,
    "tag_scores": tables.TAG_SCORES,
    "confusion": tables.CONFUSION,
    "comparisons": tables.COMPARISONS,
    "tagged": tables.TAGGED,
    "curve": tables.CURVE,
    "costs-anchor": tables.COSTS,
    "costs-baselines": tables.COSTS,
    "costs-stacked": tables.COSTS,
    "ablations": tables.ABLATIONS,
}
TINY = {
    "source": "files",
    "style": "spaces",
    "files": {
        "labelled": "own/labelled.tsv",
        "dev": "own/dev.tsv",
        "test": "own/test.tsv",
        "raw": ["own/raw-0.txt", "own/raw-1.txt"],
    },
    "sizes": [8],
    "curve": [2, 8],
    "draws": 1,
}


def make_project(folder: Path, **changed: Any) -> Path:
    """Corpus files and a params.yaml: the repository's with one small corpus and small knobs."""
    own = folder / "own"
    own.mkdir(parents=True)
    write_labelled(own / "labelled.tsv", draw_corpus(20, 1))
    write_labelled(own / "dev.tsv", draw_corpus(10, 2))
    write_labelled(own / "test.tsv", draw_corpus(15, 3))
    for number in range(2):
        write_raw(own / f"raw-{number}.txt", draw_corpus(100, 4 + number))
    yaml = YAML(typ="safe", pure=True)
    params = yaml.load((REPOSITORY / "params.yaml").read_text(encoding="utf-8"))
    labelling = params["labelling"]
    params.update(changed)
    params["planning"]["suites"] = {}  # its stages have tests of their own
    params["control"]["tasks"] = {}
    labelling.update(corpora={"tiny": TINY}, composite_iterations=2, iterations=2, feature_iterations=2)
    training = labelling["training"]
    training["moments"].update(context_count=2, class_types=2, vectors=4)
    training["anchors"].update(raw_count=5, labelled_count=1)
    training["chain"]["iterations"] = labelling["baselines"]["chain"]["iterations"] = 10
    labelling["baselines"]["steps"] = 2
    with (folder / "params.yaml").open("w", encoding="utf-8") as file:
        yaml.dump(params, file)
    return folder


def tiny_stage() -> CorpusStage:
    """The small corpus of the project in the working folder, as a stage gets it."""
    return CorpusStage("tiny", load_settings(Path("params.yaml")))


def deterministic(project: Path) -> dict[str, bytes]:
    """Everything the stages wrote that holds no times and no recordings."""
    folders = (project / "data" / "labelling" / "tiny", project / "data" / "results" / "labelling" / "tiny")
    return {
        str(path.relative_to(project)): path.read_bytes()
        for folder in folders
        for path in sorted(folder.iterdir())
        if path.is_file() and not path.name.startswith("costs-") and path.name != "emissions.json"
    }


def run_all(project: Path) -> Path:
    """Every stage, one after the other, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(project)
        stage = tiny_stage()
        for module in STAGES:
            module.main(stage)
        report.main(Path("params.yaml"), Path("data/reports"))
    return project


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project in which every stage has run in this process, with one worker."""
    return run_all(make_project(tmp_path_factory.mktemp("here"), workers=1))


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CorpusStage:
    """A project of small row groups, ready for the moments stage."""
    monkeypatch.chdir(make_project(tmp_path / "project", workers=1))
    monkeypatch.setattr(tokenise, "read_blocks", partial(tokenising.read_blocks, block_bytes=1000))
    stage = tiny_stage()
    corpus.main(stage)
    tokenise.main(stage)
    return stage


def made(project: Path, name: str) -> pa.Table:
    return read_table(project / "data" / "labelling" / "tiny" / f"{name}.parquet", MADE[name])


def result(project: Path, name: str) -> pa.Table:
    return read_table(project / "data" / "results" / "labelling" / "tiny" / f"{name}.parquet", RESULTS[name])


def in_unit(*columns: pa.ChunkedArray) -> bool:
    values = np.concatenate([column.drop_null().to_numpy() for column in columns])
    return bool(((values >= 0) & (values <= 1)).all())


@pytest.mark.parametrize(("read", "schemas"), [(made, MADE), (result, RESULTS)], ids=["artifacts", "results"])
def test_every_table_reads_back(
    done: Path, read: Callable[[Path, str], pa.Table], schemas: dict[str, TableSchema]
) -> None:
    empty = {name for name in schemas if not len(read(done, name))}
    assert empty <= {"dictionary"}
    folder = done / "data" / ("labelling" if read is made else "results/labelling") / "tiny"
    assert {path.stem for path in folder.glob("*.parquet")} == set(schemas)


def test_moments_add_up(done: Path) -> None:
    words, bigrams, tokens = made(done, "words"), made(done, "bigrams"), made(done, "tokens")
    occurrences = sum(map(len, tokens["words"].to_pylist()))
    assert sum(words["count"].to_pylist()) == occurrences
    assert sum(bigrams["n"].to_pylist()) == occurrences + len(tokens)


def test_posteriors_are_distributions_that_solve_their_problems(done: Path) -> None:
    posteriors, count = made(done, "posteriors"), len(made(done, "tags"))
    for name in ("gamma", "probability"):
        rows = tables.matrix_of(posteriors[name], count)
        assert (rows >= 0).all()
        np.testing.assert_allclose(rows.sum(axis=1), 1, atol=1e-6)
    assert max(posteriors["residual"].to_pylist()) <= 1e-8


def test_transitions_are_distributions(done: Path) -> None:
    count = len(made(done, "tags"))
    probability = made(done, "transitions")["probability"].to_numpy().reshape(-1, count + 1)
    assert (probability >= 0).all()
    np.testing.assert_allclose(probability.sum(axis=1), 1, atol=1e-9)


def test_scores_are_shares_and_the_models_have_learned(done: Path) -> None:
    scores, by_tag, points = result(done, "scores"), result(done, "tag_scores"), result(done, "curve")
    assert in_unit(*(scores[name] for name in ("accuracy", "low", "high", "unknown_accuracy", "sentence_accuracy")))
    assert in_unit(*(by_tag[name] for name in ("precision", "recall", "f1")), points["accuracy"])
    assert in_unit(made(done, "ablations")["dev_accuracy"], made(done, "costs-anchor")["dev_accuracy"])
    accuracy = dict(zip(scores["method"].to_pylist(), scores["accuracy"].to_pylist(), strict=True))
    assert {"anchor", "anchor-fhmm", "supervised", "em", "crf-posteriors"} <= set(accuracy)
    assert min(accuracy["anchor"], accuracy["supervised"]) > 0.6
    metrics = json.loads((done / "data/results/labelling/tiny/metrics.json").read_text(encoding="utf-8"))
    assert math.isclose(metrics["accuracy"]["anchor"], accuracy["anchor"], abs_tol=1e-4)


def test_recordings_and_report_are_made(done: Path) -> None:
    recordings = {path.stem for path in (done / "data/labelling/tiny/recordings").iterdir()}
    assert recordings == {*inspect.ARTIFACTS, *inspect.RESULTS}
    page = (done / "data/reports/index.html").read_text(encoding="utf-8")
    assert "tiny" in page
    assert (done / "data/reports/labelling.md").stat().st_size > 0


def test_an_interrupted_count_goes_on_where_it_was(counted: CorpusStage, monkeypatch: pytest.MonkeyPatch) -> None:
    assert pq.read_metadata(counted.path("tokens.parquet")).num_row_groups > 3
    moments.main(counted)
    names = ("words.parquet", "bigrams.parquet")
    whole = [counted.path(name).read_bytes() for name in names]
    for name in names:
        counted.path(name).unlink()

    def fail_at_the_second(path: Path, *batch: Any) -> None:
        if path.stem != "part-00000":
            raise KeyboardInterrupt
        counting.write_part(path, *batch)

    monkeypatch.setattr(moments, "write_part", fail_at_the_second)
    with pytest.raises(KeyboardInterrupt):
        moments.main(counted)
    (part,) = counted.path("parts").rglob("*.parquet")
    written = part.stat()
    assert not any(counted.path(name).exists() for name in names)

    kept = []

    def note(path: Path, *batch: Any) -> None:
        counting.write_part(path, *batch)
        if path.name == part.name:
            kept.append((path.stat().st_ino, path.stat().st_mtime_ns))

    monkeypatch.setattr(moments, "write_part", note)
    moments.main(counted)
    assert kept == [(written.st_ino, written.st_mtime_ns)]
    assert [counted.path(name).read_bytes() for name in names] == whole
    assert not counted.path("parts").exists()


@pytest.mark.parametrize("languages", [(), ("en",)])
def test_malformed_lines_are_counted_and_left_out(
    languages: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = make_project(tmp_path / "project", workers=1)
    monkeypatch.chdir(project)
    bad = [b"bad \xff\xfe bytes", b"a \0 between", b"x" * 100_001]
    (project / "own" / "raw-1.txt").write_bytes(b"\n".join([b"the cat is", *bad, b"the dog has"]) + b"\n")
    stage = tiny_stage()
    own = {"tiny": stage.corpus.model_copy(update={"languages": languages})}
    labelling = stage.settings.labelling.model_copy(update={"corpora": own})
    stage = replace(stage, settings=stage.settings.model_copy(update={"labelling": labelling}))
    for module in (corpus, tokenise, moments):
        module.main(stage)
    found = json.loads(stage.path("tokenise.json").read_text(encoding="utf-8"))
    assert found["malformed"] == {"bad_utf8": 1, "nul": 1, "too_long": 1}
    assert languages or found["lines"] == 100 + 5 + 20
    words = read_table(stage.path("words.parquet"), tables.WORDS)["word"].to_pylist()
    assert not {"bad", "bytes", "between"} & set(words)


def test_an_unknown_key_stops_a_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(make_project(tmp_path / "project", workrs=1))
    monkeypatch.setattr(sys, "argv", ["stages/labelling/corpus.py", "params.yaml", "tiny"])
    with pytest.raises(SystemExit) as stopped:
        run_stage(CorpusStage, corpus.main)
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("stage corpus@tiny failed: params.yaml: workrs: unknown key; did you mean 'workers'?")
    assert not Path("data").exists()


def test_same_seed_same_bytes_with_two_workers(done: Path, tmp_path: Path) -> None:
    project = run_all(make_project(tmp_path / "project", workers=2))
    assert deterministic(project) == deterministic(done)


def test_dvc_runs_every_stage_once_and_gives_the_same_bytes(
    done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = make_project(tmp_path / "project", workers=1)
    for name in ("src", "stages"):
        shutil.copytree(REPOSITORY / name, project / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(REPOSITORY / "dvc.yaml", project)
    monkeypatch.chdir(project)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("DVC_NO_ANALYTICS", "1")
    with Repo.init(".", no_scm=True) as repo:
        ran = [stage.addressing for stage in repo.reproduce()]
        names = {f"{module.__name__.rpartition('.')[2]}@tiny" for module in STAGES}
        assert sorted(ran) == sorted({*names, "report"})
        assert deterministic(project) == deterministic(done)
        locked = Path("dvc.lock").read_bytes()
        assert repo.reproduce() == []
        assert Path("dvc.lock").read_bytes() == locked
