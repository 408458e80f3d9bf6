"""Transitions (section 3.3.5): smoothed counts of labelled sentences, or composite likelihood of raw text."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import sparse

from predplan.errors import InputError
from predplan.labelling.active_set import Floats, Integers, compiled_sums
from predplan.labelling.decoding import Transitions
from predplan.labelling.sentences import LabelledCorpus


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
        for previous, following in pairwise(path):
            if previous is not None and following is not None:
                pairs[previous, following] += 1
    return normalised(pairs)


def normalised(pairs: Floats) -> Transitions:
    """Transitions from weights of pairs [K + 1, K + 1] whose last row is the start and last column the stop (M).

    A row without weight is uniform.
    """
    weights = pairs.copy()
    weights[-1, -1] = 0.0
    unseen = np.ones_like(weights)
    unseen[-1, -1] = 0.0
    weights = np.where(weights.any(axis=1, keepdims=True), weights, unseen)
    rows = weights / weights.sum(axis=1, keepdims=True)
    return Transitions(rows[-1, :-1], rows[:-1, :-1], rows[:-1, -1])


def composite_likelihood(
    bigrams: sparse.csr_array, emissions: Floats, initial: Floats, iterations: int
) -> tuple[Transitions, list[float]]:
    """Algorithm 4 (corrected): maximise the likelihood of neighbouring words over the joint M of their tags.

    bigrams [V + 1, V + 1] with the sentence edge last, emissions [V, K] (columns sum to one), initial [K + 1, K + 1]
    positive weights of pairs of tags. Returns the transitions and the log likelihood a token before each iteration,
    which never decreases. The E-step uses O[x, h] O[x', h'], the M-step adds up over pairs (the thesis's text has
    one emission twice and an assignment). Raises InputError where neighbouring words have probability zero.
    """
    pairs = sparse.csr_array(bigrams)
    words, states = emissions.shape
    edged = np.zeros((words + 1, states + 1))
    edged[:words, :states] = emissions
    edged[words, states] = 1.0
    weight = pairs.data / pairs.data.sum()
    joint = initial / initial.sum()
    likelihoods: list[float] = []
    for _ in range(iterations):
        ratio = np.zeros_like(joint)
        likelihoods.append(_add_ratios(pairs.indptr, pairs.indices, weight, edged @ joint, edged, ratio))
        if not np.isfinite(likelihoods[-1]):
            raise InputError("composite likelihood: found neighbouring words that no pair of tags allows")
        joint *= ratio
        joint /= joint.sum()
    return normalised(joint), likelihoods


@compiled_sums
def _add_ratios(
    indptr: Integers, indices: Integers, weight: Floats, led: Floats, edged: Floats, ratio: Floats
) -> float:
    """Adds sum_uv w_uv O[u, h] O[v, h'] / p(u, v) to ratio [K + 1, K + 1]; returns sum_uv w_uv log p(u, v).

    led is O M. One row of bigrams at a time, so nothing is stored by pair.
    """
    states = edged.shape[1]
    followers = np.empty(states)
    likelihood = 0.0
    for word in range(len(indptr) - 1):
        followers[:] = 0.0
        for place in range(indptr[word], indptr[word + 1]):
            probability = 0.0
            for state in range(states):
                probability += led[word, state] * edged[indices[place], state]
            likelihood += weight[place] * np.log(probability)
            share = weight[place] / probability
            for state in range(states):
                followers[state] += share * edged[indices[place], state]
        for state in range(states):
            for following in range(states):
                ratio[state, following] += edged[word, state] * followers[following]
    return likelihood
