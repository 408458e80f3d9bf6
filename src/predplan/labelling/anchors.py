"""Anchor words (sections 3.3.2, 3.5): words that stand for one tag, from labels, a dictionary, or raw text alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predplan.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AnchorSettings:
    """When a word may stand for a tag. The thesis asks for 500 in the raw text and 4 labelled (section 3.5)."""

    most: int = 500
    purity: float = 0.7
    labelled_count: int = 4
    raw_count: int = 500


@dataclass(frozen=True)
class Anchors:
    """chosen [V, K] marks the anchors of each tag; the thresholds each tag ended with, by tag."""

    chosen: NDArray[np.bool_]
    thresholds: tuple[AnchorSettings, ...]


def tag_matrix(counts: Mapping[str, Mapping[str, int]], word_ids: Mapping[str, int], tags: Sequence[str]) -> Floats:
    """Counts of tags by word as a matrix [V, K]; words outside the vocabulary are passed over."""
    number = {tag: index for index, tag in enumerate(tags)}
    matrix = np.zeros((len(word_ids), len(tags)))
    for word, of in counts.items():
        if word in word_ids:
            for tag, n in of.items():
                matrix[word_ids[word], number[tag]] = n
    return matrix


def supervised_anchors(
    labelled: Floats,
    dictionary: Floats,
    raw_count: NDArray[np.int64],
    tags: Sequence[str],
    settings: AnchorSettings,
) -> Anchors:
    """Up to `settings.most` of a tag's most frequent nearly unambiguous words. labelled, dictionary [V, K].

    A word qualifies by its labels (often enough, pure enough), or by a dictionary entry with a single tag that its
    labels do not contradict. Where no word of a tag does, thresholds relax: first the labelled count, then the count
    in the raw text, then purity. Raises InputError naming a tag that no threshold finds an anchor for.
    """
    times = labelled.sum(axis=1)
    purity = labelled / np.maximum(times, 1)[:, None]
    sole = (dictionary == 1) & (dictionary.sum(axis=1, keepdims=True) == 1)
    chosen = np.zeros(labelled.shape, np.bool_)
    thresholds = []
    for tag in range(len(tags)):
        for relaxed in _relaxing(settings):
            frequent = raw_count >= relaxed.raw_count
            pure = purity[:, tag] >= relaxed.purity
            by_label = (times >= relaxed.labelled_count) & pure
            by_dictionary = sole[:, tag] & ((times == 0) | pure)
            candidates = np.flatnonzero(frequent & (by_label | by_dictionary))
            if len(candidates):
                chosen[candidates[np.argsort(-raw_count[candidates], kind="stable")[: settings.most]], tag] = True
                thresholds.append(relaxed)
                break
        else:
            raise InputError(
                f"tag {tags[tag]}: no anchor word, because none of its labelled words occurs in the raw text; add a "
                f"labelled sentence or a dictionary entry with a word of this tag that the raw text has"
            )
    return Anchors(chosen, tuple(thresholds))


def _relaxing(settings: AnchorSettings) -> Iterator[AnchorSettings]:
    for purity in (settings.purity, min(settings.purity, 0.5), 0.0):
        for raw in (settings.raw_count, settings.raw_count // 5, settings.raw_count // 25, 1):
            for labelled in range(max(settings.labelled_count, 1), 0, -1):
                yield AnchorSettings(settings.most, max(purity, 1e-9), labelled, max(raw, 1))


def unsupervised_anchors(contexts: Floats, candidates: NDArray[np.bool_], number: int) -> NDArray[np.int64]:
    """Arora et al.'s anchors from raw text alone (Algorithm 2): ids [number] of words spanning the largest simplex.

    contexts [V, C]: rows of Q (or projections of them); only `candidates` [V] may be chosen. The farthest row from
    the span of those chosen is taken each time, then each choice is made again given the others.
    """
    rows = np.flatnonzero(candidates)
    if len(rows) < number:
        raise InputError(f"{number} anchors wanted, but only {len(rows)} words may be chosen")
    points = contexts[rows]
    chosen = [int(np.argmax((points**2).sum(axis=1)))]
    while len(chosen) < number:
        chosen.append(_farthest(points, chosen))
    for place in range(number):
        others = chosen[:place] + chosen[place + 1 :]
        chosen[place] = _farthest(points, others)
    return np.asarray(rows[np.array(chosen)])


def _farthest(points: Floats, chosen: Sequence[int]) -> int:
    """The point farthest from the affine span of the chosen ones."""
    if not chosen:
        return int(np.argmax((points**2).sum(axis=1)))
    offsets = points - points[chosen[0]]
    if len(chosen) > 1:
        basis, _ = np.linalg.qr(offsets[list(chosen[1:])].T)
        offsets = offsets - (offsets @ basis) @ basis.T
    distance = (offsets**2).sum(axis=1)
    distance[list(chosen)] = -1.0
    return int(np.argmax(distance))
