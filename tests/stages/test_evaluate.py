"""Scores of a made test set, and what is said when predictions do not fit it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa
import pytest

from predplan.artifacts.files import write_json
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_table, write_table
from predplan.errors import InputError
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.tables import (
    ABLATIONS,
    COMPARISONS,
    CONFUSION,
    COSTS,
    CURVE,
    DICTIONARY,
    PREDICTIONS,
    SCORES,
    TAG_SCORES,
    TAGGED,
    prediction_rows,
    write_corpus,
)
from stages.common import CorpusStage
from stages.labelling import evaluate
from stages.settings import CorpusSettings, LabellingSettings, Settings

NONE = Provenance()
GOLD = LabelledCorpus(
    (("the", "cat", "sat"), ("a", "dog"), ("unseen", "cat")),
    (("DET", "NOUN", "VERB"), ("DET", "NOUN"), ("ADJ", None)),
)
RIGHT = [["DET", "NOUN", "VERB"], ["DET", "NOUN"], ["ADJ", "X"]]
WRONG = [["DET", "VERB", "VERB"], ["DET", "NOUN"], ["NOUN", "NOUN"]]
TRAIN = LabelledCorpus((("the", "cat", "sat"), ("a", "dog")), (("DET", "NOUN", "VERB"), ("DET", "NOUN")))

Predicted = Mapping[tuple[str, str], Sequence[Sequence[str]]]


@dataclass(frozen=True)
class Bench:
    """A corpus folder with all that the evaluation reads."""

    stage: CorpusStage

    def predict(self, name: str, runs: Predicted, dev: Mapping[str, float] | None = None) -> None:
        """Write predictions and costs under one file name."""
        tables = [prediction_rows(subset, method, tags) for (subset, method), tags in runs.items()]
        tables.append(prediction_rows("", "", []))
        write_table(self.stage.path(f"predictions-{name}.parquet"), PREDICTIONS, pa.concat_tables(tables), NONE)
        costs = {
            "subset": [subset for subset, _ in runs],
            "method": [method for _, method in runs],
            "training_s": [1.0] * len(runs),
            "dev_accuracy": [(dev or {}).get(method, 0.5) for _, method in runs],
            "chosen": [""] * len(runs),
        }
        write_table(self.stage.path(f"costs-{name}.parquet"), COSTS, costs, NONE)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    corpus = CorpusSettings(source="files", sizes=(1, 2), curve=(1,), draws=1)
    settings = Settings(
        root=".",
        params="p.yaml",
        out=str(tmp_path),
        reports=str(tmp_path / "reports"),
        workers=1,
        labelling=LabellingSettings(corpora={"tiny": corpus}),
    )
    made = Bench(CorpusStage("tiny", settings))
    folder = made.stage.folder()
    write_corpus(folder / "test_gold.parquet", GOLD, NONE)
    write_corpus(folder / "train.parquet", TRAIN, NONE)
    write_table(folder / "dictionary.parquet", DICTIONARY, {"word": [], "tag": []}, NONE)
    write_table(folder / "ablations.parquet", ABLATIONS, {column.name: [] for column in ABLATIONS.columns}, NONE)
    for name in ("corpus.json", "tokenise.json"):
        write_json(folder / name, {})
    made.predict("anchor", {("2-0", "anchor"): RIGHT, ("1-0", "anchor"): RIGHT}, {"anchor": 0.9})
    made.predict("baselines", {("2-0", "supervised"): WRONG, ("1-0", "supervised"): WRONG})
    made.predict("stacked", {})
    made.predict("curve", {("1-0", "anchor"): WRONG, ("1-0", "supervised"): WRONG})
    return made


def test_scores_of_each_run(bench: Bench) -> None:
    evaluate.main(bench.stage)
    rows = read_table(bench.stage.result("scores.parquet"), SCORES).to_pylist()
    scores = {(row["subset"], row["method"]): row for row in rows}
    assert scores["2-0", "anchor"]["accuracy"] == 1
    wrong = scores["2-0", "supervised"]
    assert wrong["accuracy"] == pytest.approx(4 / 6)  # the word without a gold tag is left out
    assert wrong["unknown_accuracy"] == 0  # of the labelled words only "unseen" is in no training sentence
    assert wrong["sentence_accuracy"] == pytest.approx(1 / 3)
    assert wrong["low"] <= wrong["accuracy"] <= wrong["high"]


def test_known_words_are_those_of_the_training_set(bench: Bench) -> None:
    evaluate.main(bench.stage)
    rows = read_table(bench.stage.result("scores.parquet"), SCORES).to_pylist()
    small = next(row for row in rows if (row["subset"], row["method"]) == ("1-0", "supervised"))
    assert small["unknown_accuracy"] > 0  # with one sentence some of the words it tags right are unknown


def test_confusion_and_tag_scores_count_words(bench: Bench) -> None:
    evaluate.main(bench.stage)
    confusion = read_table(bench.stage.result("confusion.parquet"), CONFUSION).to_pylist()
    cells = {
        (r["gold"], r["predicted"]): r["n"] for r in confusion if (r["subset"], r["method"]) == ("2-0", "supervised")
    }
    assert cells == {
        ("DET", "DET"): 2,
        ("NOUN", "VERB"): 1,
        ("NOUN", "NOUN"): 1,
        ("VERB", "VERB"): 1,
        ("ADJ", "NOUN"): 1,
    }
    by_tag = read_table(bench.stage.result("tag_scores.parquet"), TAG_SCORES).to_pylist()
    noun = next(r for r in by_tag if (r["subset"], r["method"], r["tag"]) == ("2-0", "supervised", "NOUN"))
    assert (noun["precision"], noun["recall"], noun["support"]) == (0.5, 0.5, 2)


def test_best_on_dev_is_compared_and_shown(bench: Bench) -> None:
    evaluate.main(bench.stage)
    rows = read_table(bench.stage.result("comparisons.parquet"), COMPARISONS).to_pylist()
    pairs = {(row["subset"], row["method"], row["other"]): row["difference"] for row in rows}
    assert pairs == {(subset, "anchor", "supervised"): pytest.approx(1 / 3) for subset in ("1-0", "2-0")}
    tagged = read_table(bench.stage.result("tagged.parquet"), TAGGED).to_pylist()
    assert {row["subset"] for row in tagged} == {"1-0"}
    assert [row["method"] for row in tagged] == ["anchor", "supervised"] * 3


def test_curve_joins_the_tables_runs(bench: Bench) -> None:
    evaluate.main(bench.stage)
    rows = read_table(bench.stage.result("curve.parquet"), CURVE).to_pylist()
    assert [(row["method"], row["size"]) for row in rows] == [
        ("supervised", 1),
        ("supervised", 2),
        ("anchor", 1),
        ("anchor", 2),
    ]
    sheet = bench.stage.result("curve.csv").read_text(encoding="utf-8").splitlines()
    assert sheet == [
        "method,sentences,accuracy",
        "supervised HMM,1,0.6667",
        "supervised HMM,2,0.6667",
        '"anchor HMM, calibrated",1,1.0000',
        '"anchor HMM, calibrated",2,1.0000',
    ]
    metrics = json.loads(bench.stage.result("metrics.json").read_text(encoding="utf-8"))
    assert metrics == {"accuracy": {"supervised": 0.6667, "anchor": 1.0}}


def test_same_bytes_twice(bench: Bench) -> None:
    names = ("scores", "tag_scores", "confusion", "comparisons", "tagged", "curve")
    evaluate.main(bench.stage)
    first = [bench.stage.result(f"{name}.parquet").read_bytes() for name in names]
    evaluate.main(bench.stage)
    assert [bench.stage.result(f"{name}.parquet").read_bytes() for name in names] == first


def test_missing_predictions_name_their_stage(bench: Bench) -> None:
    bench.stage.path("predictions-stacked.parquet").unlink()
    with pytest.raises(InputError, match=r"predictions-stacked\.parquet: no such file.*stack"):
        evaluate.main(bench.stage)


@pytest.mark.parametrize(
    ("runs", "message"),
    [
        ({("2-0", "anchor"): RIGHT[:2]}, "found 2 sentences, expected each of the 3"),
        ({("2-0", "anchor"): [["DET"], *RIGHT[1:]]}, "sentence 1: found 1 predicted tags, expected 3"),
        ({("2-0", "nonsense"): RIGHT}, "nonsense on 2-0: unknown method; known are supervised-addone"),
    ],
)
def test_predictions_that_do_not_fit(bench: Bench, runs: Predicted, message: str) -> None:
    bench.predict("anchor", runs)
    with pytest.raises(InputError, match=re.escape(message) + ".*run again: dvc repro tag@tiny"):
        evaluate.main(bench.stage)


def test_training_sets_of_other_settings(bench: Bench) -> None:
    bench.predict("anchor", {("150-2", "anchor"): RIGHT})
    with pytest.raises(InputError, match="found training sets 150-2, expected 1-0, 2-0; run again: dvc repro tag@tiny"):
        evaluate.main(bench.stage)


def test_costs_must_cover_the_predictions(bench: Bench) -> None:
    rows = read_table(bench.stage.path("costs-anchor.parquet"), COSTS)
    write_table(bench.stage.path("costs-anchor.parquet"), COSTS, rows.slice(1), NONE)
    with pytest.raises(InputError, match="no row for anchor on 2-0; run again"):
        evaluate.main(bench.stage)


def test_no_predictions_at_all(bench: Bench) -> None:
    for name in ("anchor", "baselines"):
        bench.predict(name, {})
    with pytest.raises(InputError, match="found no tagged sentence"):
        evaluate.main(bench.stage)


def test_another_table_in_place_of_the_predictions(bench: Bench) -> None:
    schema = replace(PREDICTIONS, name="other")
    path = bench.stage.path("predictions-curve.parquet")
    write_table(path, schema, read_table(path, PREDICTIONS), NONE)
    with pytest.raises(InputError, match=r"holds the table 'other', expected 'predictions'.*curve"):
        evaluate.main(bench.stage)
