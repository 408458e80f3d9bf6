"""Score every method's tags against the gold ones, which no other stage reads: scores, tests, examples and the curve."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from predplan.artifacts.files import write_json, write_whole
from predplan.artifacts.tables import TableSchema, read_table, write_table
from predplan.errors import InputError
from predplan.labelling.comparing import examples, in_order, pairs_to_compare
from predplan.labelling.evaluation import (
    Scores,
    bootstrap_accuracy,
    bootstrap_difference,
    correctness,
    kolmogorov_smirnov,
    mcnemar,
    score,
)
from predplan.labelling.sentences import UNIVERSAL_TAGS, LabelledCorpus, label_counts
from predplan.labelling.tables import (
    COMPARISONS,
    CONFUSION,
    COSTS,
    CURVE,
    PREDICTIONS,
    SCORES,
    TAG_SCORES,
    TAGGED,
    read_corpus,
)
from stages.common import CorpusStage, run_corpus_stage
from stages.labelling.subsets import training_sets

MADE_BY = {"anchor": "tag", "baselines": "baselines", "stacked": "stack", "curve": "curve"}
"""Files of predictions and costs, and the stages that write them."""

BOOTSTRAP_SAMPLES = 1_000
"""The 95 % interval of an accuracy then moves by about .02 points from seed to seed (Brown, 2,000 sentences)."""

Run = tuple[str, str]
"""A training set and a method."""
Tags = list[list[str]]
Rows = list[dict[str, Any]]


def main(stage: CorpusStage) -> None:
    gold = read_corpus(stage.path("test_gold.parquet"))
    files = {name: read_predictions(stage, name, gold) for name in MADE_BY}
    tables = {run: tags for name in ("anchor", "baselines", "stacked") for run, tags in files[name].items()}
    dev = dev_accuracies(stage)
    right = {run: correctness(gold, tags) for run, tags in tables.items()}
    known = known_words(stage, {subset for subset, _ in tables})
    names = tag_order(gold, tables.values())
    seed = stage.settings.labelling.seed
    scores, by_tag, confusion = [], [], []
    for (subset, method), tags in tables.items():
        found = score(gold, tags, known[subset], names)
        interval = bootstrap_accuracy(*right[subset, method], np.random.default_rng(seed), BOOTSTRAP_SAMPLES)
        run = {"subset": subset, "method": method}
        scores.append({**run, **overall(found), "low": interval.low, "high": interval.high})
        by_tag += [{**run, **vars(of_tag)} for of_tag in found.per_tag]
        confusion += [
            {**run, "gold": names[i], "predicted": names[j], "n": int(found.confusion[i, j])}
            for i, j in np.argwhere(found.confusion).tolist()
        ]
    comparisons = []
    for subset, methods in methods_by_subset(tables).items():
        for method, other in pairs_to_compare({name: dev[subset, name] for name in methods}):
            comparisons.append(compare(subset, method, other, right, np.random.default_rng(seed)))
    curve = curve_rows(gold, files["curve"], tables)

    inputs = [stage.path(f"{kind}-{name}.parquet") for name in MADE_BY for kind in ("predictions", "costs")]
    provenance = stage.provenance(stage.path("test_gold.parquet"), *inputs, sizes=stage.corpus.sizes)
    written: tuple[tuple[str, TableSchema, Rows], ...] = (
        ("scores", SCORES, scores),
        ("tag_scores", TAG_SCORES, by_tag),
        ("confusion", CONFUSION, confusion),
        ("comparisons", COMPARISONS, comparisons),
        ("tagged", TAGGED, tagged_rows(gold, tables, right, dev)),
        ("curve", CURVE, curve),
    )
    for name, schema, rows in written:
        columns = {column.name: [row[column.name] for row in rows] for column in schema.columns}
        write_table(stage.path(f"{name}.parquet"), schema, columns, provenance)
    write_json(stage.path("metrics.json"), {stage.name: metrics(scores)})
    write_curve(stage.path("curve.csv"), curve)


def read_predictions(stage: CorpusStage, name: str, gold: LabelledCorpus) -> dict[Run, Tags]:
    """Tags of every test sentence by training set and method. Raises InputError where sentences are missing or cut."""
    path = stage.path(f"predictions-{name}.parquet")
    rows: defaultdict[Run, dict[int, list[str]]] = defaultdict(dict)
    table = read_table(path, replace(PREDICTIONS, stage=MADE_BY[name]))
    for subset, method, sentence, tags in zip(*(column.to_pylist() for column in table.columns), strict=True):
        rows[subset, method][sentence] = tags
    runs = {}
    for (subset, method), found in rows.items():
        runs[subset, method] = [found[sentence] for sentence in sorted(found)]
        try:
            if sorted(found) != list(range(len(gold))):
                raise InputError(f"found {len(found)} sentences, expected each of the {len(gold)} test sentences")
            correctness(gold, runs[subset, method])
        except InputError as error:
            remedy = f"run its stage again: dvc repro {MADE_BY[name]}@{stage.name}"
            raise InputError(f"{path}, {method} on {subset}: {error}; {remedy}") from error
    return runs


def dev_accuracies(stage: CorpusStage) -> dict[Run, float]:
    """Accuracy of every run of the tables on the development sentences."""
    accuracies = {}
    for name in ("anchor", "baselines", "stacked"):
        table = read_table(stage.path(f"costs-{name}.parquet"), replace(COSTS, stage=MADE_BY[name]))
        for row in table.select(["subset", "method", "dev_accuracy"]).to_pylist():
            accuracies[row["subset"], row["method"]] = row["dev_accuracy"]
    return accuracies


def known_words(stage: CorpusStage, subsets: Iterable[str]) -> dict[str, frozenset[str]]:
    """The words labelled in each training set."""
    drawn = {each.name: frozenset(label_counts(each.corpus)) for each in training_sets(stage, stage.corpus.sizes)}
    unknown = sorted(set(subsets) - drawn.keys())
    if unknown:
        raise InputError(
            f"predictions of {stage.name} on training sets {', '.join(unknown)}: params.yaml now draws "
            f"{', '.join(drawn)}; run again: dvc repro tag@{stage.name} baselines@{stage.name} stack@{stage.name}"
        )
    return drawn


def tag_order(gold: LabelledCorpus, predicted: Iterable[Tags]) -> tuple[str, ...]:
    """All tags met, the universal ones in their order, then the others by name."""
    met = {tag for tags in gold.tags for tag in tags if tag is not None}
    met |= {tag for tags_of_run in predicted for tags in tags_of_run for tag in tags}
    universal = [tag for tag in UNIVERSAL_TAGS if tag in met]
    return (*universal, *sorted(met.difference(universal)))


def overall(found: Scores) -> dict[str, Any]:
    """The scores that are not of one tag."""
    names = ("accuracy", "unknown_accuracy", "sentence_accuracy", "tokens")
    return {name: getattr(found, name) for name in names}


def methods_by_subset(runs: Iterable[Run]) -> dict[str, list[str]]:
    """The methods of each training set, smallest set first."""
    methods: defaultdict[str, list[str]] = defaultdict(list)
    for subset, method in runs:
        methods[subset].append(method)
    return {subset: in_order(methods[subset]) for subset in sorted(methods, key=size_and_draw)}


def size_and_draw(subset: str) -> tuple[int, int]:
    """Labelled sentences of a training set, and the seed of its draw."""
    size, draw = subset.split("-")
    return int(size), int(draw)


def compare(
    subset: str, method: str, other: str, right: Mapping[Run, tuple[Any, Any]], rng: np.random.Generator
) -> dict[str, Any]:
    """A row of the comparisons table."""
    (first, offsets), (second, _) = right[subset, method], right[subset, other]
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


def curve_rows(gold: LabelledCorpus, curve: Mapping[Run, Tags], tables: Mapping[Run, Tags]) -> Rows:
    """Rows of the curve table: the curve's runs, and the tables' runs of the same methods."""
    drawn = {method for _, method in curve}
    runs = {**curve, **{run: tags for run, tags in tables.items() if run[1] in drawn}}
    order = in_order(drawn)
    rows = []
    for subset, method in sorted(runs, key=lambda run: (order.index(run[1]), size_and_draw(run[0]))):
        size, draw = size_and_draw(subset)
        accuracy = float(correctness(gold, runs[subset, method])[0].mean())
        rows.append({"method": method, "size": size, "draw": draw, "accuracy": accuracy})
    return rows


def tagged_rows(
    gold: LabelledCorpus, tables: Mapping[Run, Tags], right: Mapping[Run, tuple[Any, Any]], dev: Mapping[Run, float]
) -> Rows:
    """Test sentences as tagged by the method best on dev and by the supervised HMM, on the first small draw."""
    subset, methods = next(iter(methods_by_subset(tables).items()))
    best = max(methods, key=lambda name: dev[subset, name])
    shown = [best, *(name for name in ("supervised",) if name in methods and name != best)]
    rows = []
    for sentence in examples([right[subset, method] for method in shown]):
        for method in shown:
            predicted = tables[subset, method][sentence]
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


def metrics(scores: Rows) -> dict[str, dict[str, float]]:
    """Method -> labelled sentences -> accuracy, the mean over draws."""
    drawn: defaultdict[str, defaultdict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in sorted(scores, key=lambda row: size_and_draw(row["subset"])):
        drawn[row["method"]][row["subset"].split("-")[0]].append(row["accuracy"])
    return {
        method: {size: round(float(np.mean(values)), 4) for size, values in drawn[method].items()}
        for method in in_order(drawn)
    }


def write_curve(path: Path, curve: Sequence[Mapping[str, Any]]) -> None:
    """The curve as a sheet: a row a size, a column a method, the mean accuracy over draws."""
    cells: defaultdict[int, defaultdict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in curve:
        cells[row["size"]][row["method"]].append(row["accuracy"])
    methods = list(dict.fromkeys(row["method"] for row in curve))
    with write_whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        sheet = csv.writer(file, lineterminator="\n")
        sheet.writerow(["size", *methods])
        for size in sorted(cells):
            sheet.writerow(
                [size, *(f"{np.mean(cells[size][name]):.4f}" if name in cells[size] else "" for name in methods)]
            )


if __name__ == "__main__":
    run_corpus_stage(main)
