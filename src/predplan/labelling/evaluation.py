"""How well predicted tags agree with gold ones, and whether two taggers differ by more than chance."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from predplan.errors import InputError
from predplan.labelling.sentences import LabelledCorpus

Booleans = NDArray[np.bool_]
Integers = NDArray[np.int64]

EXACT_BELOW = 25
"""Disagreements under which McNemar's test is taken from the binomial distribution itself."""
DRAWS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class TagScore:
    """One tag: precision, recall and F1 (0 where nothing is predicted or nothing is gold), support in tokens."""

    tag: str
    precision: float
    recall: float
    f1: float
    support: int


@dataclass(frozen=True)
class Scores:
    """Shares of right tags among labelled tokens.

    unknown_accuracy: over words never labelled in training, None where there are none; sentence_accuracy: share of
    sentences without a wrong tag; confusion [K, K] in tokens (row: gold, column: predicted), ordered as per_tag.
    """

    accuracy: float
    unknown_accuracy: float | None
    sentence_accuracy: float
    tokens: int
    unknown_tokens: int
    per_tag: tuple[TagScore, ...]
    confusion: Integers


class Interval(NamedTuple):
    """An estimate with its 95% percentile interval."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True)
class McNemar:
    """Tokens that only the first or only the second tagger has right, and the two-sided p-value."""

    only_first: int
    only_second: int
    p_value: float


@dataclass(frozen=True)
class KolmogorovSmirnov:
    """Largest distance of the two distributions, and its p-value."""

    statistic: float
    p_value: float


def score(
    gold: LabelledCorpus, predicted: Sequence[Sequence[str]], known_words: Collection[str], tags: Sequence[str]
) -> Scores:
    """Scores of predicted tags; gold tokens of tag None are left out.

    Raises InputError naming the sentence (from 1) where lengths differ or a tag is not one of `tags`, and where no
    gold token has a tag.
    """
    right, offsets = correctness(gold, predicted)
    known = frozenset(known_words)
    number = {tag: index for index, tag in enumerate(tags)}
    pairs, unknown = [], []
    for place, (words, gold_tags, guesses) in enumerate(zip(gold.words, gold.tags, predicted, strict=True), start=1):
        for word, tag, guess in zip(words, gold_tags, guesses, strict=True):
            if tag is not None:
                pairs.append((_number(number, tag, "gold", place), _number(number, guess, "predicted", place)))
                unknown.append(word not in known)
    confusion = np.zeros((len(tags), len(tags)), np.int64)
    np.add.at(confusion, tuple(np.array(pairs).T), 1)
    new = np.array(unknown)
    labelled = offsets[:-1] < offsets[1:]
    return Scores(
        accuracy=float(right.mean()),
        unknown_accuracy=float(right[new].mean()) if new.any() else None,
        sentence_accuracy=float(np.logical_and.reduceat(right, offsets[:-1][labelled]).mean()),
        tokens=len(right),
        unknown_tokens=int(new.sum()),
        per_tag=tuple(_tag_score(tag, confusion, index) for index, tag in enumerate(tags)),
        confusion=confusion,
    )


def correctness(gold: LabelledCorpus, predicted: Sequence[Sequence[str]]) -> tuple[Booleans, Integers]:
    """Whether each labelled gold token got its tag [tokens], and where sentences begin and end in it [sentences + 1].

    Raises InputError as `score`.
    """
    if len(gold) != len(predicted):
        raise InputError(f"prediction: found {len(predicted)} sentences, expected {len(gold)} as in the gold standard")
    right: list[bool] = []
    offsets = [0]
    for place, (gold_tags, guesses) in enumerate(zip(gold.tags, predicted, strict=True), start=1):
        if len(gold_tags) != len(guesses):
            raise InputError(
                f"sentence {place}: found {len(guesses)} predicted tags, expected {len(gold_tags)} as in the gold "
                f"standard; it begins {' '.join(gold.words[place - 1][:8])!r}"
            )
        right.extend(tag == guess for tag, guess in zip(gold_tags, guesses, strict=True) if tag is not None)
        offsets.append(len(right))
    if not right:
        raise InputError("gold standard: found no labelled token, expected at least one")
    return np.array(right), np.array(offsets, np.int64)


def _number(number: dict[str, int], tag: str, side: str, place: int) -> int:
    if tag not in number:
        raise InputError(f"sentence {place}: found the {side} tag {tag!r}, expected one of {' '.join(number)}")
    return number[tag]


def _tag_score(tag: str, confusion: Integers, index: int) -> TagScore:
    hits = int(confusion[index, index])
    support, guessed = int(confusion[index].sum()), int(confusion[:, index].sum())
    return TagScore(tag, hits / max(guessed, 1), hits / max(support, 1), 2 * hits / max(support + guessed, 1), support)


def mcnemar(correct_a: Booleans, correct_b: Booleans) -> McNemar:
    """McNemar's test that two taggers are right equally often; correct_a, correct_b [tokens] are the same tokens.

    Exact below 25 disagreements, else chi-squared with continuity correction. Tokens count as independent, which
    within a sentence they are not: `bootstrap_difference` makes no such assumption.
    """
    _check_paired(correct_a, correct_b)
    first, second = int((correct_a & ~correct_b).sum()), int((correct_b & ~correct_a).sum())
    disagreements = first + second
    if not disagreements:
        return McNemar(first, second, 1.0)
    if disagreements < EXACT_BELOW:
        return McNemar(first, second, float(stats.binomtest(first, disagreements).pvalue))
    statistic = max(abs(first - second) - 1, 0) ** 2 / disagreements
    return McNemar(first, second, float(stats.chi2.sf(statistic, 1)))


def kolmogorov_smirnov(correct_a: Booleans, correct_b: Booleans) -> KolmogorovSmirnov:
    """The thesis's word-level Kolmogorov-Smirnov test, on the tokens' correctness (1 or 0), asymptotic p-value.

    Reported because the thesis does, but no test of accuracy: it compares the distributions of two independent
    samples of a continuous quantity. On correctness its distance is merely the difference of the accuracies; the ties
    make its p-value too large, and it ignores that both taggers met the same words, on which most answers agree.
    """
    _check_paired(correct_a, correct_b)
    result = stats.ks_2samp(correct_a.astype(float), correct_b.astype(float), method="asymp")
    return KolmogorovSmirnov(float(result.statistic), float(result.pvalue))


def bootstrap_difference(
    correct_a: Booleans,
    correct_b: Booleans,
    sentence_offsets: Integers,
    rng: np.random.Generator,
    samples: int = 10_000,
) -> Interval:
    """Accuracy of a less that of b with its interval, by drawing sentences with replacement. correct [tokens].

    Sentence s is tokens sentence_offsets[s]:sentence_offsets[s + 1]. Raises InputError below two labelled sentences.
    """
    _check_paired(correct_a, correct_b)
    return _bootstrap(correct_a.astype(np.int64) - correct_b.astype(np.int64), sentence_offsets, rng, samples)


def bootstrap_accuracy(
    correct: Booleans, sentence_offsets: Integers, rng: np.random.Generator, samples: int = 10_000
) -> Interval:
    """Accuracy with its interval, as `bootstrap_difference`."""
    return _bootstrap(correct.astype(np.int64), sentence_offsets, rng, samples)


def _bootstrap(values: Integers, offsets: Integers, rng: np.random.Generator, samples: int) -> Interval:
    if len(offsets) == 0 or offsets[0] != 0 or offsets[-1] != len(values):
        raise InputError(f"sentence offsets: found {offsets}, expected them to run from 0 to {len(values)} tokens")
    sizes = np.diff(offsets)
    totals = np.diff(np.concatenate([[0], np.cumsum(values)])[offsets])[sizes > 0]
    sizes = sizes[sizes > 0]
    if len(sizes) < 2:
        raise InputError(f"bootstrap: found {len(sizes)} labelled sentences, expected at least two")
    drawn = stats.bootstrap(
        (totals, sizes),
        lambda total, size, axis: total.sum(axis) / size.sum(axis),
        paired=True,
        vectorized=True,
        method="percentile",
        n_resamples=samples,
        batch=max(1, DRAWS_AT_ONCE // len(sizes)),
        rng=rng,
    )
    low, high = drawn.confidence_interval
    return Interval(float(totals.sum() / sizes.sum()), float(low), float(high))


def _check_paired(correct_a: Booleans, correct_b: Booleans) -> None:
    if correct_a.shape != correct_b.shape or correct_a.ndim != 1 or not len(correct_a):
        raise InputError(
            f"paired test: found {correct_a.shape} and {correct_b.shape} tokens, expected the same tokens of both"
        )
