"""Transition probabilities (section 3.3.5): smoothed counts of labelled sentences, or composite likelihood of raw text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.labelling.decoding import Transitions
from predplan.labelling.sentences import LabelledCorpus

Floats = NDArray[np.float64]


def counted_transitions(corpus: LabelledCorpus, tags: Sequence[str], smoothing: float = 1.0) -> Transitions:
    """Relative frequencies of neighbouring tags, `smoothing` added to each count.

    Rows are the previous tag and the start, columns the next tag and the stop; no sentence is empty, so start to stop
    stays impossible (the thesis's footnote 1 has the wrong row). Pairs with an unlabelled word are not counted.
    """
    number = {tag: index for index, tag in enumerate(tags)}
    edge = len(tags)
    pairs = np.full((edge + 1, edge + 1), smoothing)
    for sentence in corpus.tags:
        path = [edge, *(None if tag is None else number[tag] for tag in sentence), edge]
        for previous, following in zip(path, path[1:], strict=False):
            if previous is not None and following is not None:
                pairs[previous, following] += 1
    return normalised(pairs)


def normalised(pairs: Floats) -> Transitions:
    """Transitions from weights of pairs [K + 1, K + 1] whose last row is the start and last column the stop (M)."""
    weights = pairs.copy()
    weights[-1, -1] = 0.0
    totals = weights.sum(axis=1, keepdims=True)
    rows = np.divide(weights, totals, out=np.full_like(weights, 1.0 / len(weights)), where=totals > 0)
    return Transitions(rows[-1, :-1], rows[:-1, :-1], rows[:-1, -1])


def composite_likelihood(
    bigrams: sparse.csr_array, emissions: Floats, initial: Floats, iterations: int
) -> tuple[Transitions, list[float]]:
    """Algorithm 4 (corrected): maximise the likelihood of neighbouring words over the joint M of their tags.

    bigrams [V + 1, V + 1] with the sentence edge last, emissions [V, K] (columns sum to one), initial [K + 1, K + 1]
    positive weights of pairs of tags. Returns the transitions and the log likelihood a token before each iteration,
    which never decreases. The E-step uses O[x, h] O[x', h'], the M-step adds up over pairs (the thesis's text has
    one emission twice and an assignment).
    """
    pairs = sparse.coo_array(bigrams)
    words, states = emissions.shape
    edged = np.zeros((words + 1, states + 1))
    edged[:words, :states] = emissions
    edged[words, states] = 1.0
    left, right = edged[pairs.row], edged[pairs.col]
    weight = pairs.data / pairs.data.sum()
    joint = initial / initial.sum()
    likelihoods: list[float] = []
    for _ in range(iterations):
        probability = np.einsum("nk,nk->n", left @ joint, right)
        likelihoods.append(float(weight @ np.log(probability)))
        joint = joint * ((left * (weight / probability)[:, None]).T @ right)
        joint /= joint.sum()
    return normalised(joint), likelihoods
