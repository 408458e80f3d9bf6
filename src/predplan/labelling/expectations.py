"""What raw text is expected to hold under a hidden Markov model: counts of tags by word type, in one pass.

Scores are looked up by word type and expectations added up by word type, so nothing is stored by token and a pass
needs memory for its longest sentence only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from predplan.errors import InputError
from predplan.labelling.active_set import Integers, compiled
from predplan.labelling.decoding import Transitions
from predplan.labelling.sentences import LabelledCorpus

Floats = NDArray[np.float64]
Batch = tuple[NDArray[np.int32], NDArray[np.int64]]


@dataclass(frozen=True)
class RawTokens:
    """Raw text: batches of (ids [tokens] into `words`, offsets [sentences + 1]); gone through once a pass."""

    words: Sequence[str]
    batches: Iterable[Batch]

    def __post_init__(self) -> None:
        if isinstance(self.batches, Iterator):
            raise InputError("raw text: found batches that can be read only once, expected a list or other collection")

    def count(self) -> NDArray[np.int64]:
        """How often each word occurs [V]."""
        total = np.zeros(len(self.words), np.int64)
        for ids, _ in self.batches:
            total += np.bincount(ids, minlength=len(total))
        return total


@dataclass(frozen=True)
class TagCounts:
    """Counts of tags, observed or expected: words [V, K]; pairs [K + 1, K + 1] of neighbours, the edge last."""

    words: Floats
    pairs: Floats
    log_likelihood: float = 0.0


def observed_counts(corpus: LabelledCorpus, word_ids: Mapping[str, int], tags: Sequence[str]) -> TagCounts:
    """Counts of labels; words without a label are passed over, and so are pairs with one."""
    number = {tag: index for index, tag in enumerate(tags)}
    edge = len(tags)
    words, pairs = np.zeros((len(word_ids), edge)), np.zeros((edge + 1, edge + 1))
    for sentence, sentence_tags in zip(corpus.words, corpus.tags, strict=True):
        path = [edge, *(None if tag is None else number[tag] for tag in sentence_tags), edge]
        for word, tag in zip(sentence, path[1:], strict=False):
            if tag is not None:
                words[word_ids[word], tag] += 1
        for previous, following in pairwise(path):
            if previous is not None and following is not None:
                pairs[previous, following] += 1
    return TagCounts(words, pairs)


def expected_counts(emissions: Floats, raw: RawTokens, transitions: Transitions, hard: bool = False) -> TagCounts:
    """Forward-backward over raw text; emissions [V, K] are p(word | tag) for the log likelihood to be that of the text.

    A word whose emissions are all zero carries no evidence. With `hard`, each token counts wholly for its most
    probable tag (posterior decoding), as self-training counts.
    """
    top = emissions.max(axis=1, keepdims=True)
    scaled = np.where(top > 0, emissions / np.where(top > 0, top, 1.0), 1.0)
    words, pairs = np.zeros(emissions.shape), np.zeros((emissions.shape[1] + 1,) * 2)
    model = (transitions.start.copy(), transitions.between.copy(), transitions.stop.copy())
    log_likelihood = 0.0
    for ids, offsets in raw.batches:
        log_likelihood += _add_expectations(scaled, ids, offsets, *model, hard, words, pairs)
    occurrences = words.sum(axis=1)
    log_likelihood += float(occurrences @ np.log(np.where(top > 0, top, 1.0).ravel()))
    return TagCounts(words, pairs, log_likelihood)


@compiled
def _add_expectations(
    scores: Floats,
    ids: NDArray[np.int32],
    offsets: Integers,
    start: Floats,
    between: Floats,
    stop: Floats,
    hard: bool,
    words: Floats,
    pairs: Floats,
) -> float:
    """Adds to words [V, K] and pairs [K + 1, K + 1]; returns the log likelihood but for the factors taken out."""
    states = scores.shape[1]
    longest = 0
    for sentence in range(len(offsets) - 1):
        longest = max(longest, offsets[sentence + 1] - offsets[sentence])
    forward, tags, totals = np.empty((longest, states)), np.empty((longest, states)), np.empty(longest)
    backward, weighted = np.empty(states), np.empty(states)
    outer, reverse = np.zeros((states, states)), between.T.copy()
    log_likelihood = 0.0
    for sentence in range(len(offsets) - 1):
        first, length = offsets[sentence], offsets[sentence + 1] - offsets[sentence]
        if length <= 0:
            continue
        for token in range(length):
            row, emitted = forward[token], scores[ids[first + token]]
            if token == 0:
                for tag in range(states):
                    row[tag] = start[tag]
            else:
                row[:] = 0.0
                for previous in range(states):
                    mass = forward[token - 1, previous]
                    for tag in range(states):
                        row[tag] += mass * between[previous, tag]
            total = 0.0
            for tag in range(states):
                row[tag] *= emitted[tag]
                total += row[tag]
            for tag in range(states):
                row[tag] /= total
            totals[token] = total
            log_likelihood += np.log(total)
        ending = 0.0
        for tag in range(states):
            ending += forward[length - 1, tag] * stop[tag]
        log_likelihood += np.log(ending)
        for tag in range(states):
            backward[tag] = stop[tag] / ending
            tags[length - 1, tag] = forward[length - 1, tag] * backward[tag]
        for token in range(length - 2, -1, -1):
            emitted, row = scores[ids[first + token + 1]], forward[token]
            for tag in range(states):
                weighted[tag] = backward[tag] * emitted[tag] / totals[token + 1]
            backward[:] = 0.0
            for following in range(states):
                mass = weighted[following]
                for tag in range(states):
                    backward[tag] += reverse[following, tag] * mass
            for tag in range(states):
                tags[token, tag] = row[tag] * backward[tag]
                if not hard:
                    for following in range(states):
                        outer[tag, following] += row[tag] * weighted[following]
        if hard:
            previous = states
            for token in range(length):
                tag = int(np.argmax(tags[token]))
                words[ids[first + token], tag] += 1.0
                pairs[previous, tag] += 1.0
                previous = tag
            pairs[previous, states] += 1.0
        else:
            for token in range(length):
                for tag in range(states):
                    words[ids[first + token], tag] += tags[token, tag]
            for tag in range(states):
                pairs[states, tag] += tags[0, tag]
                pairs[tag, states] += tags[length - 1, tag]
    for tag in range(states):
        for following in range(states):
            pairs[tag, following] += outer[tag, following] * between[tag, following]
    return log_likelihood
