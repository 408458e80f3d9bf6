"""Which methods are held against which, and which test sentences are worth showing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from predplan.labelling.methods import METHODS

THESIS_PAIRS = (
    *(
        (anchor, other)
        for anchor in ("anchor-lambda1", "anchor-kl-lambda1", "anchor")
        for other in ("supervised-addone", "supervised", "em", "self-training")
    ),
    *(
        (anchor, other)
        for anchor in ("anchor-fhmm-lambda1", "anchor-fhmm")
        for other in ("supervised-fhmm", "em-fhmm", "self-training-fhmm")
    ),
    ("self-training-fhmm", "supervised-fhmm"),
    ("self-training-fhmm", "em-fhmm"),
    ("crf-posteriors", "crf"),
    ("crf-clusters-posteriors", "crf-clusters"),
    ("crf-all-posteriors", "crf-all"),
    ("crf-all-clusters-posteriors", "crf-all-clusters"),
)
"""Pairs of section 3.6: anchors against the baselines of their model, self-training against the others, and
posteriors as features against the same features without."""

SHOWN = 60
WITH_MISTAKES = 50


def pairs_to_compare(dev_accuracy: Mapping[str, float]) -> list[tuple[str, str]]:
    """The thesis's pairs, then our best anchor model and our best field against every baseline.

    Methods absent from dev_accuracy, by which the best are chosen, are passed over.
    """
    pairs = [pair for pair in THESIS_PAIRS if set(pair) <= dev_accuracy.keys()]
    for ours in best_of_ours(dev_accuracy):
        pairs += [(ours, name) for name in in_order(dev_accuracy) if is_baseline(name)]
    return list(dict.fromkeys(pairs))


def best_of_ours(dev_accuracy: Mapping[str, float]) -> list[str]:
    """The anchor model and the field with posteriors that are best on the development sentences."""
    anchors = [name for name in in_order(dev_accuracy) if METHODS[name].family.startswith("anchor")]
    fields = [name for name in in_order(dev_accuracy) if METHODS[name].family == "field" and not is_baseline(name)]
    return [max(group, key=lambda name: dev_accuracy[name]) for group in (anchors, fields) if group]


def is_baseline(name: str) -> bool:
    """Whether a method uses no anchors."""
    family = METHODS[name].family
    return family in ("supervised", "semi-supervised") or (family == "field" and not name.endswith("posteriors"))


def in_order(names: Iterable[str]) -> list[str]:
    """Methods in the order of METHODS."""
    present = set(names)
    return [name for name in METHODS if name in present]


def examples(answers: Sequence[tuple[NDArray[np.bool_], NDArray[np.int64]]]) -> list[int]:
    """Sentences to show: mostly ones in which a tagger errs, spread evenly over the test set.

    answers: for each tagger what `correctness` gives, right [tokens] and offsets [sentences + 1].
    """
    offsets = answers[0][1]
    all_right = np.logical_and.reduce([right for right, _ in answers])
    mistakes = np.diff(np.concatenate([[0], np.cumsum(~all_right)])[offsets])
    wrong, fine = np.flatnonzero(mistakes > 0), np.flatnonzero((mistakes == 0) & (np.diff(offsets) > 0))
    chosen = [*_spread(wrong, WITH_MISTAKES), *_spread(fine, SHOWN - min(len(wrong), WITH_MISTAKES))]
    return sorted(chosen)


def _spread(sentences: NDArray[np.int64], most: int) -> list[int]:
    count = min(len(sentences), most)
    return [int(sentences[i * len(sentences) // count]) for i in range(count)]
