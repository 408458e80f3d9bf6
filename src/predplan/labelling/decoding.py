"""Posterior and Viterbi decoding of many sentences at once, in compiled code.

Tokens of all sentences lie one after another; sentence s is tokens offsets[s]:offsets[s + 1]. A token enters as its
row of emission scores [K], proportional to p(word | tag): any factor shared by all tags drops out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.errors import PredplanError
from predplan.labelling.active_set import Floats, Integers, compiled


@dataclass(frozen=True)
class Transitions:
    """Probabilities of a first-order chain of K tags: start [K], between [K, K] (row: previous tag), stop [K].

    `start` sums to one and so does every row of `between` with its entry of `stop` (T of section 3.3.5, transposed).
    """

    start: Floats
    between: Floats
    stop: Floats


@dataclass(frozen=True)
class ExpectedCounts:
    """Posterior expectations over a batch: tags [tokens, K], start [K], between [K, K], stop [K], log likelihood."""

    tags: Floats
    start: Floats
    between: Floats
    stop: Floats
    log_likelihood: float


def posteriors(scores: Floats, offsets: Integers, transitions: Transitions) -> ExpectedCounts:
    """Forward-backward: p(tag | sentence) a token, and the expected transitions. scores [tokens, K] >= 0.

    A token whose scores are all zero counts as carrying no evidence (a row of ones).
    Raises PredplanError naming a sentence (from 0) that no sequence of tags with a positive product explains.
    """
    scaled = _scaled(scores)
    # Plain copies: for each other layout of its arguments the compiled code would be compiled anew.
    chain = (part.copy() for part in (transitions.start, transitions.between, transitions.stop))
    tags, start, between, stop, log_likelihood = _forward_backward(scaled, offsets, *chain)
    if not np.isfinite(log_likelihood):
        token = int(np.argmax(~np.isfinite(tags).all(axis=1)))
        sentence = int(np.searchsorted(offsets, token, side="right")) - 1
        raise PredplanError(f"sentence {sentence}: the scores and the transitions leave no possible sequence of tags")
    return ExpectedCounts(tags, start, between, stop, log_likelihood)


def viterbi(scores: Floats, offsets: Integers, transitions: Transitions) -> Integers:
    """Most probable tag sequence of every sentence, as tag indices [tokens]; ties go to the lower index."""
    with np.errstate(divide="ignore"):
        logs = (np.log(_scaled(scores)), *map(np.log, (transitions.start, transitions.between, transitions.stop)))
    return np.asarray(_viterbi(logs[0], offsets, logs[1], logs[2], logs[3]))


def _scaled(scores: Floats) -> Floats:
    top = scores.max(axis=1, keepdims=True)
    return np.where(top > 0, scores / np.where(top > 0, top, 1.0), 1.0)


@compiled
def _forward_backward(
    scores: Floats, offsets: Integers, start: Floats, between: Floats, stop: Floats
) -> tuple[Floats, Floats, Floats, Floats, float]:
    tokens, states = scores.shape
    tags = np.empty((tokens, states))
    forward = np.empty((tokens, states))
    from_start, expected, to_stop = np.zeros(states), np.zeros((states, states)), np.zeros(states)
    backward, weighted = np.empty(states), np.empty(states)
    log_likelihood = 0.0
    for sentence in range(len(offsets) - 1):
        first, last = offsets[sentence], offsets[sentence + 1] - 1
        if last < first:
            continue
        for token in range(first, last + 1):
            total = 0.0
            for tag in range(states):
                mass = start[tag]
                if token > first:
                    mass = 0.0
                    for previous in range(states):
                        mass += forward[token - 1, previous] * between[previous, tag]
                forward[token, tag] = mass * scores[token, tag]
                total += forward[token, tag]
            for tag in range(states):
                forward[token, tag] /= total
            log_likelihood += np.log(total)
        ending = 0.0
        for tag in range(states):
            ending += forward[last, tag] * stop[tag]
        log_likelihood += np.log(ending)
        for tag in range(states):
            backward[tag] = stop[tag] / ending
            tags[last, tag] = forward[last, tag] * backward[tag]
            to_stop[tag] += tags[last, tag]
        for token in range(last - 1, first - 1, -1):
            total = 0.0
            for following in range(states):
                weighted[following] = backward[following] * scores[token + 1, following]
            for tag in range(states):
                mass = 0.0
                for following in range(states):
                    mass += between[tag, following] * weighted[following]
                backward[tag] = mass
                total += mass * forward[token, tag]
            for tag in range(states):
                for following in range(states):
                    expected[tag, following] += (
                        forward[token, tag] * between[tag, following] * weighted[following] / total
                    )
                backward[tag] /= total
                tags[token, tag] = forward[token, tag] * backward[tag]
        for tag in range(states):
            from_start[tag] += tags[first, tag]
    return tags, from_start, expected, to_stop, log_likelihood


@compiled
def _viterbi(scores: Floats, offsets: Integers, start: Floats, between: Floats, stop: Floats) -> Integers:
    tokens, states = scores.shape
    best = np.empty((tokens, states))
    came_from = np.empty((tokens, states), np.int64)
    path = np.empty(tokens, np.int64)
    for sentence in range(len(offsets) - 1):
        first, last = offsets[sentence], offsets[sentence + 1] - 1
        if last < first:
            continue
        for tag in range(states):
            best[first, tag] = start[tag] + scores[first, tag]
        for token in range(first + 1, last + 1):
            for tag in range(states):
                champion, value = 0, -np.inf
                for previous in range(states):
                    candidate = best[token - 1, previous] + between[previous, tag]
                    if candidate > value:
                        champion, value = previous, candidate
                best[token, tag] = value + scores[token, tag]
                came_from[token, tag] = champion
        path[last] = np.argmax(best[last] + stop)
        for token in range(last, first, -1):
            path[token - 1] = came_from[token, path[token]]
    return path
