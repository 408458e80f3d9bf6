"""Results of a made corpus, small enough to check by hand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from predplan.reporting.labelling.results import CorpusResults

METHODS = ("supervised", "em", "anchor", "crf-posteriors")
SUBSETS = ("150-0", "150-1", "1000-0")
ACCURACY = {"supervised": 0.7, "em": 0.75, "anchor": 0.84, "crf-posteriors": 0.9}


def made_results(source: str = "twitter", methods: Sequence[str] = METHODS, dictionary: bool = False) -> CorpusResults:
    """A corpus with two draws of 150 sentences, the second .02 better, and all 1,000, .05 better."""
    runs = list(product(SUBSETS, methods))
    better = {"150-0": 0.0, "150-1": 0.02, "1000-0": 0.05}
    accuracy = {(subset, method): ACCURACY.get(method, 0.8) + better[subset] for subset, method in runs}
    scores = [
        {
            **run(subset, method),
            "accuracy": value,
            "low": value - 0.01,
            "high": value + 0.01,
            "unknown_accuracy": None,
            "sentence_accuracy": 0.5,
            "tokens": 100,
        }
        for (subset, method), value in accuracy.items()
    ]
    return CorpusResults(
        name="made",
        source=source,
        dictionary=dictionary,
        scores=scores,
        tag_scores=[
            {**run(subset, method), "tag": "NOUN", "precision": 0.9, "recall": 0.8, "f1": 0.85, "support": 1234}
            for subset, method in runs
        ],
        confusion=[
            {**run(subset, method), "gold": gold, "predicted": given, "n": 9 if gold == given else 1}
            for (subset, method), gold, given in product(runs, ("NOUN", "VERB"), ("NOUN", "VERB"))
        ],
        comparisons=[
            {
                **run(subset, methods[-1]),
                "other": other,
                "difference": accuracy[subset, methods[-1]] - accuracy[subset, other],
                "low": -0.01 if subset == "150-1" else 0.01,
                "high": 0.3,
                "mcnemar_p": 0.04 if subset == "150-1" else 0.0001,
                "ks_p": 0.5,
            }
            for subset, other in product(SUBSETS, methods[:-1])
        ],
        tagged=[
            {
                **run("150-0", method),
                "words": ["a", "<b>*word*", "|"],
                "gold": ["DET", "NOUN", "_"],
                "predicted": ["DET", "VERB" if method == "supervised" else "NOUN", "X"],
            }
            for method in (methods[-1], methods[0])
        ],
        curve=[
            {"method": method, "size": int(subset.split("-")[0]), "draw": int(subset.split("-")[1]), "accuracy": value}
            for (subset, method), value in accuracy.items()
        ],
        costs=[
            {
                **run(subset, method),
                "training_s": 2.0 if method == "anchor" else 30.0,
                "dev_accuracy": value,
                "chosen": "4 iterations" if method == "em" else "",
            }
            for (subset, method), value in accuracy.items()
        ],
        ablations=[
            {
                "subset": "150-0",
                "component": "loss",
                "setting": setting,
                "default": setting == "kl",
                "dev_accuracy": value,
            }
            for setting, value in (("kl", 0.84), ("ls", 0.82))
        ],
        facts={
            "sources": ["made: https://example.org/made.zip"],
            "parts": {"train": {"sentences": 1000, "tokens": 20_000}},
            "dictionary_entries": 0,
        },
        raw={"lines": 12345, "tokens": 99999, "words": 5, "malformed": {"bad_utf8": 3, "nul": 0, "too_long": 1}},
    )


def run(subset: str, method: str) -> dict[str, Any]:
    """The columns that name a run."""
    return {"subset": subset, "method": method}
