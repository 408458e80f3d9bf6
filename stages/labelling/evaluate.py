"""Score every method's tags against the gold ones, which no other stage reads: scores, tests, examples, curve."""

from __future__ import annotations

import csv
import shutil
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.files import write_json, write_whole
from predplan.artifacts.tables import TableSchema, write_table
from predplan.errors import InputError
from predplan.labelling.comparing import examples, in_order, pairs_to_compare
from predplan.labelling.evaluation import (
    Scores,
    bootstrap_accuracy,
    bootstrap_difference,
    kolmogorov_smirnov,
    mcnemar,
    score,
)
from predplan.labelling.methods import METHODS
from predplan.labelling.sentences import UNIVERSAL_TAGS, LabelledCorpus
from predplan.labelling.tables import (
    COMPARISONS,
    CONFUSION,
    CURVE,
    SCORES,
    TAG_SCORES,
    TAGGED,
    read_corpus,
)
from stages.common import CorpusStage, run_stage
from stages.labelling.predictions import (
    MADE_BY,
    OF_TABLES,
    Answers,
    Run,
    dev_accuracies,
    known_words,
    methods_by_subset,
    read_predictions,
    remedy,
    size_and_draw,
)

BOOTSTRAP_SAMPLES = 1_000
"""The 95 % interval of an accuracy then moves by about .02 points from seed to seed (Brown, 2,000 sentences)."""
CHIEF = ("supervised", "self-training", "crf", "anchor", "anchor-fhmm", "crf-posteriors")
"""Methods whose accuracy `dvc metrics show` tells."""

Rows = list[dict[str, Any]]
TOLD = (*(f"costs-{name}.parquet" for name in OF_TABLES), "ablations.parquet", "corpus.json", "tokenise.json")
"""What the report tells besides, brought together so that it depends on one folder."""


def main(stage: CorpusStage) -> None:
    gold = read_corpus(stage.path("test_gold.parquet"))
    tables = {run: answers for name in OF_TABLES for run, answers in read_predictions(stage, name, gold).items()}
    if not tables:
        raise InputError(f"predictions of {stage.name}: found no tagged sentence; {remedy(stage)}")
    dev = dev_accuracies(stage, tables)
    known = known_words(stage, {subset for subset, _ in tables})
    names = tag_order(gold, (answers.tags for answers in tables.values()))
    seed = stage.settings.labelling.seed
    scores, by_tag, confusion = score_rows(gold, tables, known, names, seed)
    comparisons = []
    for subset, methods in methods_by_subset(tables).items():
        for method, other in pairs_to_compare({name: dev[subset, name] for name in methods}):
            comparisons.append(compare(subset, method, other, tables, np.random.default_rng(seed)))
    curve = curve_rows(read_predictions(stage, "curve", gold), tables)

    predictions = [stage.path(f"predictions-{name}.parquet") for name in MADE_BY]
    # Costs hold times, which no seed gives again: their hashes would change every table.
    inputs = [stage.path("test_gold.parquet"), stage.path("train.parquet"), *predictions]
    provenance = stage.provenance(*inputs, sizes=stage.corpus.sizes)
    written: tuple[tuple[str, TableSchema, Rows], ...] = (
        ("scores", SCORES, scores),
        ("tag_scores", TAG_SCORES, by_tag),
        ("confusion", CONFUSION, confusion),
        ("comparisons", COMPARISONS, comparisons),
        ("tagged", TAGGED, tagged_rows(gold, tables, dev)),
        ("curve", CURVE, curve),
    )
    for name, schema, rows in written:
        columns = {column.name: [row[column.name] for row in rows] for column in schema.columns}
        write_table(stage.result(f"{name}.parquet"), schema, columns, provenance)
    write_json(stage.result("metrics.json"), {"accuracy": metrics(scores)})
    write_curve(stage.result("curve.csv"), curve)
    for name in TOLD:
        with write_whole(stage.result(name)) as temporary:
            shutil.copyfile(stage.path(name), temporary)


def tag_order(gold: LabelledCorpus, predicted: Iterable[Sequence[Sequence[str]]]) -> tuple[str, ...]:
    """All tags met, the universal ones in their order, then the others by name."""
    met = {tag for tags in gold.tags for tag in tags if tag is not None}
    met |= {tag for tags_of_run in predicted for tags in tags_of_run for tag in tags}
    universal = [tag for tag in UNIVERSAL_TAGS if tag in met]
    return (*universal, *sorted(met.difference(universal)))


def score_rows(
    gold: LabelledCorpus,
    tables: Mapping[Run, Answers],
    known: Mapping[str, frozenset[str]],
    names: tuple[str, ...],
    seed: int,
) -> tuple[Rows, Rows, Rows]:
    """Rows of the tables of scores, of scores by tag, and of confusions."""
    scores, by_tag, confusion = [], [], []
    for (subset, method), answers in tables.items():
        found = score(gold, answers.tags, known[subset], names)
        interval = bootstrap_accuracy(answers.right, answers.offsets, np.random.default_rng(seed), BOOTSTRAP_SAMPLES)
        run = {"subset": subset, "method": method}
        scores.append({**run, **overall(found), "low": interval.low, "high": interval.high})
        by_tag += [{**run, **vars(of_tag)} for of_tag in found.per_tag]
        confusion += [
            {**run, "gold": names[i], "predicted": names[j], "n": int(found.confusion[i, j])}
            for i, j in np.argwhere(found.confusion).tolist()
        ]
    return scores, by_tag, confusion


def overall(found: Scores) -> dict[str, Any]:
    """The scores that are not of one tag."""
    names = ("accuracy", "unknown_accuracy", "sentence_accuracy", "tokens")
    return {name: getattr(found, name) for name in names}


def compare(
    subset: str, method: str, other: str, runs: Mapping[Run, Answers], rng: np.random.Generator
) -> dict[str, Any]:
    """A row of the comparisons table."""
    first, second, offsets = runs[subset, method].right, runs[subset, other].right, runs[subset, method].offsets
    interval = bootstrap_difference(first, second, offsets, rng, BOOTSTRAP_SAMPLES)
    return {
        "subset": subset,
        "method": method,
        "other": other,
        "difference": interval.estimate,
        "low": interval.low,
        "high": interval.high,
        "mcnemar_p": mcnemar(first, second).p_value,
        "ks_p": kolmogorov_smirnov(first, second).p_value,
    }


def curve_rows(curve: Mapping[Run, Answers], tables: Mapping[Run, Answers]) -> Rows:
    """Rows of the curve table: the curve's runs, and the tables' runs of the same methods."""
    drawn = {method for _, method in curve}
    runs = {**curve, **{run: answers for run, answers in tables.items() if run[1] in drawn}}
    order = in_order(drawn)
    rows = []
    for subset, method in sorted(runs, key=lambda run: (order.index(run[1]), size_and_draw(run[0]))):
        size, draw = size_and_draw(subset)
        accuracy = float(runs[subset, method].right.mean())
        rows.append({"method": method, "size": size, "draw": draw, "accuracy": accuracy})
    return rows


def tagged_rows(gold: LabelledCorpus, tables: Mapping[Run, Answers], dev: Mapping[Run, float]) -> Rows:
    """Test sentences as tagged by the method best on dev and by the supervised HMM, on the first small draw."""
    subset, methods = next(iter(methods_by_subset(tables).items()))
    best = max(methods, key=lambda name: dev[subset, name])
    shown = [best, *(name for name in ("supervised",) if name in methods and name != best)]
    rows = []
    for sentence in examples([(runs.right, runs.offsets) for runs in (tables[subset, method] for method in shown)]):
        for method in shown:
            predicted = tables[subset, method].tags[sentence]
            tags = [tag or "_" for tag in gold.tags[sentence]]
            rows.append(
                {
                    "subset": subset,
                    "method": method,
                    "words": gold.words[sentence],
                    "gold": tags,
                    "predicted": predicted,
                }
            )
    return rows


def metrics(scores: Rows) -> dict[str, float]:
    """Accuracy of the chief methods after the fewest labelled sentences, the mean over draws."""
    fewest = min(size_and_draw(row["subset"])[0] for row in scores)
    drawn: defaultdict[str, list[float]] = defaultdict(list)
    for row in scores:
        if size_and_draw(row["subset"])[0] == fewest:
            drawn[row["method"]].append(row["accuracy"])
    return {method: round(float(np.mean(drawn[method])), 4) for method in CHIEF if method in drawn}


def write_curve(path: Path, curve: Sequence[Mapping[str, Any]]) -> None:
    """The curve as a sheet: the mean accuracy over draws by method and labelled sentences."""
    drawn: defaultdict[tuple[str, int], list[float]] = defaultdict(list)
    for row in curve:
        drawn[METHODS[row["method"]].label, row["size"]].append(row["accuracy"])
    with write_whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        sheet = csv.writer(file, lineterminator="\n")
        sheet.writerow(["method", "sentences", "accuracy"])
        sheet.writerows([*key, f"{np.mean(values):.4f}"] for key, values in drawn.items())


if __name__ == "__main__":
    run_stage(CorpusStage, main)
