"""Baselines that use raw text: expectation maximisation and self-training, both from the strong supervised models.

Both re-estimate a model from labelled counts and from its own reading of raw text, pass after pass: EM by expected
counts, self-training by its best guess of every tag. The passes come lazily; `best_iteration` keeps the one that does
best on development data, as the thesis does (section 3.6.1). Words that neither labels nor raw text have are judged
as the supervised model judges them: judging them by the rare raw words' expected tags gained at most 0.1 points on
development data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.labelling.expectations import RawTokens, TagCounts, expected_counts, observed_counts
from predplan.labelling.features import feature_matrix
from predplan.labelling.loglinear import LogLinearEmissions, fit_emissions
from predplan.labelling.models import FeatureHiddenMarkovModel, SequenceModel, identity_features
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.supervised import (
    BaselineSettings,
    TableHiddenMarkovModel,
    feature_columns,
    mean_features,
    supervised_feature_model,
    supervised_model,
    table_model,
)
from predplan.labelling.transitions import normalised

Floats = NDArray[np.float64]
Model = TypeVar("Model", bound=SequenceModel)
Model_co = TypeVar("Model_co", bound=SequenceModel, covariant=True)


@dataclass(frozen=True)
class Iteration(Generic[Model_co]):
    """A model, and the log likelihood of the raw text under the one before it (none before the first)."""

    model: Model_co
    log_likelihood_before: float | None


def best_iteration(
    iterations: Iterator[Iteration[Model]], score: Callable[[Model], float], most: int, patience: int = 2
) -> tuple[Model, list[float]]:
    """The model that scores best among the first `most`, and all scores; ends early after `patience` without a gain."""
    scores: list[float] = []
    best: Model | None = None
    for iteration in islice(iterations, most):
        scores.append(score(iteration.model))
        if best is None or scores[-1] > max(scores[:-1]):
            best = iteration.model
        if len(scores) - int(np.argmax(scores)) > patience:
            break
    if best is None:
        raise ValueError("no iteration to choose from")
    return best, scores


def expectation_maximisation(
    corpus: LabelledCorpus, raw: RawTokens, tags: Sequence[str], settings: BaselineSettings
) -> Iterator[Iteration[TableHiddenMarkovModel]]:
    """EM for the hidden Markov model; the first model is the supervised one."""
    return _passes(corpus, raw, tags, settings, hard=False)


def self_training(
    corpus: LabelledCorpus, raw: RawTokens, tags: Sequence[str], settings: BaselineSettings
) -> Iterator[Iteration[TableHiddenMarkovModel]]:
    """Self-training of the hidden Markov model; the thesis's is the second model, after one round."""
    return _passes(corpus, raw, tags, settings, hard=True)


def feature_expectation_maximisation(
    corpus: LabelledCorpus, raw: RawTokens, tags: Sequence[str], settings: BaselineSettings
) -> Iterator[Iteration[FeatureHiddenMarkovModel]]:
    """EM for the feature hidden Markov model, each M-step a few steps of L-BFGS from the weights before."""
    return _feature_passes(corpus, raw, tags, settings, hard=False)


def feature_self_training(
    corpus: LabelledCorpus, raw: RawTokens, tags: Sequence[str], settings: BaselineSettings
) -> Iterator[Iteration[FeatureHiddenMarkovModel]]:
    """Self-training of the feature hidden Markov model."""
    return _feature_passes(corpus, raw, tags, settings, hard=True)


def _passes(
    corpus: LabelledCorpus, raw: RawTokens, tags: Sequence[str], settings: BaselineSettings, hard: bool
) -> Iterator[Iteration[TableHiddenMarkovModel]]:
    model = supervised_model(corpus, tags, settings)
    yield Iteration(model, None)
    word_ids = _joint_vocabulary(raw, model.word_ids)
    labelled = observed_counts(corpus, word_ids, tags)
    judged = _by_word(model, list(word_ids))
    prior = settings.prior * judged
    count = np.ones(len(word_ids))
    count[: len(raw.words)] = raw.count()
    emissions, transitions = judged * count[:, None], model.transitions
    emissions /= emissions.sum(axis=0)
    while True:
        found = expected_counts(emissions, raw, transitions, hard)
        total = _weighted(labelled, found, settings)
        model = table_model(total, word_ids, prior, model.unknown, settings.raw_smoothing)
        emissions, transitions = model.emissions, model.transitions
        yield Iteration(model, found.log_likelihood)


def _feature_passes(
    corpus: LabelledCorpus, raw: RawTokens, tags: Sequence[str], settings: BaselineSettings, hard: bool
) -> Iterator[Iteration[FeatureHiddenMarkovModel]]:
    model = supervised_feature_model(corpus, tags, settings)
    yield Iteration(model, None)
    word_ids = _joint_vocabulary(raw, dict.fromkeys(word for sentence in corpus.words for word in sentence))
    labelled = observed_counts(corpus, word_ids, tags)
    names = [identity_features(word) for word in word_ids]
    raw_count = np.zeros(len(names), np.int64)
    raw_count[: len(raw.words)] = raw.count()
    kept = np.flatnonzero((raw_count >= settings.feature_count) | (labelled.words.sum(axis=1) > 0))
    columns = feature_columns([list(model.columns), *(names[row] for row in kept)])
    features = feature_matrix(names, columns)
    listed = sparse.csr_array(features[kept])
    weights = np.zeros((len(columns), len(tags)))
    weights[: len(model.columns)] = model.emissions.weights
    emissions = LogLinearEmissions(weights, model.emissions.log_normaliser)
    transitions = model.transitions
    while True:
        found = expected_counts(np.exp(emissions.log_scores(features)), raw, transitions, hard)
        total = _weighted(labelled, found, settings)
        mean = mean_features(listed, total.words[kept])
        emissions = fit_emissions(listed, mean, settings.penalty, emissions.weights, settings.steps)
        transitions = normalised(total.pairs + settings.raw_smoothing)
        yield Iteration(FeatureHiddenMarkovModel(columns, emissions, transitions), found.log_likelihood)


def _joint_vocabulary(raw: RawTokens, labelled: Mapping[str, object]) -> Mapping[str, int]:
    """Raw words by their own ids, then the labelled words that raw text does not have."""
    return {word: row for row, word in enumerate(dict.fromkeys([*raw.words, *labelled]))}


def _by_word(model: TableHiddenMarkovModel, words: Sequence[str]) -> Floats:
    """p(tag | word) [words, K] by Bayes' rule."""
    joint = model.word_scores(words) * model.tag_probability
    return np.asarray(joint / joint.sum(axis=1, keepdims=True))


def _weighted(labelled: TagCounts, found: TagCounts, settings: BaselineSettings) -> TagCounts:
    weight = settings.labelled_weight
    return TagCounts(found.words + weight * labelled.words, found.pairs + weight * labelled.pairs)
