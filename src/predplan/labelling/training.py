"""From counts of raw text and a few labelled sentences to the three models: Algorithms 3 and 5, and stacking."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.labelling.anchors import Anchors, AnchorSettings, supervised_anchors, tag_matrix
from predplan.labelling.chain import ChainSettings, Description, train_chain
from predplan.labelling.counting import BigramCounts
from predplan.labelling.decoding import Transitions
from predplan.labelling.features import SpellingClasses, feature_matrix
from predplan.labelling.lexicon import (
    Evidence,
    Lexicon,
    LexiconSettings,
    Supervision,
    confidence,
    fit_supervised,
    judge,
)
from predplan.labelling.loglinear import fit_emissions, mean_parameters
from predplan.labelling.models import ChainModel, Clusters, FeatureHiddenMarkovModel, describe, identity_features
from predplan.labelling.moments import ContextMoments, canonical_contexts, canonical_vectors, context_moments, parts
from predplan.labelling.posteriors import ContextPosteriors, PosteriorSettings, cross_fitted_posteriors
from predplan.labelling.sentences import LabelledCorpus, label_counts

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MomentSettings:
    """Which contexts are told apart, and how rare words are classed."""

    context_count: int = 20
    """Words seen at least this often are contexts of their own; rarer ones stand for their class of spelling."""
    class_types: int = 30
    """Rare words that must share a suffix for it to be a class."""
    vectors: int = 50
    """Dimension of the words' canonical vectors; 0 for none."""


@dataclass(frozen=True)
class TrainingSettings:
    """All knobs of training, a component each; the defaults were chosen on development data."""

    moments: MomentSettings = field(default_factory=MomentSettings)
    anchors: AnchorSettings = field(default_factory=AnchorSettings)
    posteriors: PosteriorSettings = field(default_factory=PosteriorSettings)
    lexicon: LexiconSettings = field(default_factory=LexiconSettings)
    chain: ChainSettings = field(default_factory=ChainSettings)
    folds: int = 5
    """Parts for judging anchors, and labelled sentences, by the others only."""
    emission_penalty: float = 1e-4
    """Penalty on the squared weights of log-linear emissions (epsilon of Eq. 3.26)."""
    emission_count: int = 10
    """Words at least this frequent have a weight of their own in log-linear emissions."""


@dataclass(frozen=True)
class RawStatistics:
    """All that is learned of the raw text before any label: moments, and the projection [2C, D] to words' vectors."""

    moments: ContextMoments
    projection: Floats

    @cached_property
    def word_ids(self) -> Mapping[str, int]:
        """The row of each raw word; training alone does without, which saves its memory."""
        return {word: row for row, word in enumerate(self.moments.vocabulary)}

    def vectors(self, rows: NDArray[np.int64]) -> Floats:
        """Canonical vectors [n, D] of the words in `rows` [n]."""
        return canonical_vectors(self.moments.counts[rows], self.projection)


def raw_statistics(bigrams: BigramCounts, settings: MomentSettings, seed: int) -> RawStatistics:
    """Moments of contexts, and the canonical correlations of words with them."""
    rare = settings.context_count
    classes = SpellingClasses.learn(bigrams.vocabulary, bigrams.count.tolist(), rare, settings.class_types)
    moments = context_moments(bigrams, classes, settings.context_count)
    if settings.vectors == 0:
        return RawStatistics(moments, np.zeros((moments.counts.shape[1], 0)))
    return RawStatistics(moments, canonical_contexts(moments, settings.vectors, seed))


def find_anchors(
    raw: RawStatistics, supervision: Supervision, tags: Sequence[str], settings: AnchorSettings
) -> Anchors:
    """Anchors of every tag from labels and dictionary."""
    listed = {word: dict.fromkeys(allowed, 1) for word, allowed in supervision.dictionary.items()}
    rows = known_rows(raw, supervision)
    place = {raw.moments.vocabulary[row]: place for place, row in enumerate(rows.tolist())}
    found = supervised_anchors(
        tag_matrix(supervision.labels, place, tags),
        tag_matrix(listed, place, tags),
        raw.moments.word_count[rows],
        tags,
        settings,
    )
    chosen = np.zeros((len(raw.moments.vocabulary), len(tags)), np.bool_)
    chosen[rows] = found.chosen
    return Anchors(chosen, found.thresholds)


def known_rows(raw: RawStatistics, supervision: Supervision) -> NDArray[np.int64]:
    """Rows of the raw words that labels or dictionary know, rising."""
    known = {*supervision.labels, *supervision.dictionary}
    return np.array([row for row, word in enumerate(raw.moments.vocabulary) if word in known], np.int64)


def gather_evidence(raw: RawStatistics, contexts: ContextPosteriors) -> Evidence:
    """What contexts say of each word they judged, each measurement scaled by the confidence its count gives."""
    count = raw.moments.word_count[contexts.rows]
    trust, states = confidence(count)[:, None], contexts.gamma.shape[1]
    values = np.empty((len(count), 2 * states + raw.projection.shape[1]), np.float32)
    values[:, :states] = contexts.gamma * trust
    values[:, states : 2 * states] = contexts.log_ratio * (0.5 * trust)
    for some in parts(raw.moments.counts, contexts.rows):
        values[some, 2 * states :] = raw.vectors(contexts.rows[some]) * trust[some]
    word_ids = {raw.moments.vocabulary[row]: place for place, row in enumerate(contexts.rows.tolist())}
    return Evidence(word_ids, count, values)


def learn_evidence(
    raw: RawStatistics, supervision: Supervision, tags: Sequence[str], settings: TrainingSettings, seed: int
) -> tuple[Anchors, ContextPosteriors, Evidence]:
    """Anchors, the posteriors they give every word, and these as evidence."""
    anchors = find_anchors(raw, supervision, tags, settings.anchors)
    contexts = judge_contexts(raw, supervision, anchors.chosen, settings, seed)
    return anchors, contexts, gather_evidence(raw, contexts)


def judge_contexts(
    raw: RawStatistics,
    supervision: Supervision,
    anchors: NDArray[np.bool_],
    settings: TrainingSettings,
    seed: int,
) -> ContextPosteriors:
    """Posteriors, by the anchors [V, K], of every word that a lexicon will list."""
    wanted = raw.moments.word_count >= settings.lexicon.least_count
    wanted[known_rows(raw, supervision)] = True
    rng = np.random.default_rng(seed)
    rows = np.flatnonzero(wanted)
    return cross_fitted_posteriors(raw.moments, anchors, settings.posteriors, settings.folds, rng, rows)


def train_feature_model(
    words: Sequence[str],
    count: NDArray[np.int64],
    posterior: Floats,
    transitions: Transitions,
    settings: TrainingSettings,
) -> FeatureHiddenMarkovModel:
    """Log-linear emissions whose expected features match those that p(tag | word) [V, K] gives (Algorithm 5).

    A feature has a weight if two words share it; a word of its own only if it occurs often enough, count [V].
    """
    columns, features = emission_features(words, count, settings.emission_count)
    weight = np.maximum(count, 1).astype(np.float64)
    mean = mean_parameters(features, weight / weight.sum(), posterior)
    return FeatureHiddenMarkovModel(columns, fit_emissions(features, mean, settings.emission_penalty), transitions)


def emission_features(
    words: Sequence[str], count: NDArray[np.int64], own_count: int
) -> tuple[Mapping[str, int], sparse.csr_array]:
    """Columns of the features that have a weight in log-linear emissions, and the words' features [V, W]."""
    names = [identity_features(word) for word in words]
    shared = Counter(name for row in names for name in row)
    own = {f"word={word}" for word, n in zip(words, count.tolist(), strict=True) if n >= own_count}
    columns = {name: place for place, name in enumerate(name for name, n in shared.items() if n > 1 or name in own)}
    return columns, feature_matrix(names, columns)


def train_chain_model(
    corpus: LabelledCorpus,
    dictionary: Mapping[str, frozenset[str]],
    lexicon: Lexicon,
    evidence: Evidence,
    clusters: Clusters,
    tags: tuple[str, ...],
    settings: TrainingSettings,
    seed: int,
) -> ChainModel:
    """Stack a conditional random field on the posteriors.

    Each labelled sentence is described by posteriors from the labels of the other folds, since new sentences too will
    be described by posteriors that have not seen their labels.
    """
    fold = np.random.default_rng(seed).integers(0, settings.folds, len(corpus))
    described: list[list[Description]] = [[] for _ in range(len(corpus))]
    for number in range(settings.folds):
        inside = np.flatnonzero(fold == number).tolist()
        others = Supervision(label_counts(corpus.subset(np.flatnonzero(fold != number).tolist())), dictionary)
        if not inside or not others.labels:
            continue
        words = list(dict.fromkeys(word for sentence in inside for word in corpus.words[sentence]))
        classifier = fit_supervised(others, evidence, tags, settings.lexicon)
        posterior = judge(words, classifier, others, evidence, tags, settings.lexicon)
        contexts = evidence.rows(words, 2 * len(tags))
        description = dict(zip(words, describe(words, posterior, contexts, tags, clusters), strict=True))
        for sentence in inside:
            described[sentence] = [description[word] for word in corpus.words[sentence]]
    return ChainModel(lexicon, clusters, tags, train_chain(corpus, described, tags, settings.chain))
