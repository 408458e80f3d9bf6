"""What the methods predicted, read and checked against the test sentences, the training sets and one another."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from predplan.artifacts.tables import read_table
from predplan.errors import InputError
from predplan.labelling.comparing import in_order
from predplan.labelling.evaluation import correctness
from predplan.labelling.methods import METHODS
from predplan.labelling.sentences import LabelledCorpus, label_counts
from predplan.labelling.tables import COSTS, PREDICTIONS
from stages.common import CorpusStage
from stages.labelling.subsets import training_sets

MADE_BY = {"anchor": "tag", "baselines": "baselines", "stacked": "stack", "curve": "curve"}
"""Files of predictions and costs, and the stages that write them."""

OF_TABLES = ("anchor", "baselines", "stacked")

Run = tuple[str, str]
"""A training set and a method."""


@dataclass(frozen=True)
class Answers:
    """A run's tags of the test sentences, and what `correctness` says: right [tokens], offsets [sentences + 1]."""

    tags: list[list[str]]
    right: NDArray[np.bool_]
    offsets: NDArray[np.int64]


def read_predictions(stage: CorpusStage, name: str, gold: LabelledCorpus) -> dict[Run, Answers]:
    """Tags of every test sentence by training set and method. Raises InputError where sentences are missing or cut."""
    path = stage.path(f"predictions-{name}.parquet")
    rows: defaultdict[Run, dict[int, list[str]]] = defaultdict(dict)
    table = read_table(path, replace(PREDICTIONS, stage=MADE_BY[name]))
    for subset, method, sentence, tags in zip(*(column.to_pylist() for column in table.columns), strict=True):
        rows[subset, method][sentence] = tags
    runs = {}
    for (subset, method), found in rows.items():
        tags = [found[sentence] for sentence in sorted(found)]
        try:
            if method not in METHODS:
                raise InputError(f"unknown method; known are {', '.join(METHODS)}")
            if sorted(found) != list(range(len(gold))):
                raise InputError(f"found {len(found)} sentences, expected each of the {len(gold)} test sentences")
            runs[subset, method] = Answers(tags, *correctness(gold, tags))
        except InputError as error:
            raise InputError(f"{path}, {method} on {subset}: {error}; {remedy(stage, name)}") from error
    return runs


def dev_accuracies(stage: CorpusStage, runs: Iterable[Run]) -> dict[Run, float]:
    """Accuracy of each run of the tables on the development sentences. Raises InputError where one has none."""
    accuracies = {}
    for name in OF_TABLES:
        table = read_table(stage.path(f"costs-{name}.parquet"), replace(COSTS, stage=MADE_BY[name]))
        for row in table.select(["subset", "method", "dev_accuracy"]).to_pylist():
            accuracies[row["subset"], row["method"]] = row["dev_accuracy"]
    missing = [f"{method} on {subset}" for subset, method in runs if (subset, method) not in accuracies]
    if missing:
        raise InputError(f"costs of {stage.name}: no row for {', '.join(missing)}; {remedy(stage)}")
    return accuracies


def known_words(stage: CorpusStage, subsets: Iterable[str]) -> dict[str, frozenset[str]]:
    """The words labelled in each training set. Raises InputError for sets that params.yaml does not draw."""
    drawn = {each.name: frozenset(label_counts(each.corpus)) for each in training_sets(stage, stage.corpus.sizes)}
    unknown = sorted(set(subsets) - drawn.keys())
    if unknown:
        found = ", ".join(unknown)
        raise InputError(
            f"predictions of {stage.name}: found training sets {found}, expected {', '.join(drawn)}; {remedy(stage)}"
        )
    return drawn


def remedy(stage: CorpusStage, *names: str) -> str:
    """What to run again."""
    made = [f"{MADE_BY[name]}@{stage.name}" for name in names or OF_TABLES]
    return f"run again: dvc repro {' '.join(made)}"


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
