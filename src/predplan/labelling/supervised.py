"""What labels alone give: hidden Markov, feature hidden Markov and conditional random field, the baselines to beat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.errors import InputError
from predplan.labelling.chain import ChainSettings, ChainWeights, train_chain
from predplan.labelling.decoding import Transitions
from predplan.labelling.expectations import TagCounts, observed_counts
from predplan.labelling.features import feature_matrix
from predplan.labelling.lexicon import LEAST_PROBABILITY, Evidence, WordClassifier, fit_classifier
from predplan.labelling.loglinear import fit_emissions
from predplan.labelling.models import Clusters, FeatureHiddenMarkovModel, describe, identity_features
from predplan.labelling.sentences import LabelledCorpus, label_counts
from predplan.labelling.suffixes import SuffixTree
from predplan.labelling.transitions import normalised

Floats = NDArray[np.float64]
LEAST_COUNT = 1e-3
SPELLING_ALONE = Evidence({}, np.empty(0, np.int64), np.zeros((1, 0), np.float32))


@dataclass(frozen=True)
class BaselineSettings:
    """Knobs of the baselines; the defaults were chosen on development data."""

    unknown: Literal["classifier", "suffixes"] = "classifier"
    """How the spelling of an unknown word says its tag: log-linear classifier, or suffixes of rare labelled words."""
    inverse_penalty: float = 1.0
    """Inverse strength of the classifier's penalty on squared weights."""
    suffix_count: int = 2
    """Words of at most this many labels teach the suffixes."""
    suffix_backoff: float = 5.0
    """Pseudo-counts that a shorter suffix gives a longer one."""
    shrinkage: float = 0.2
    """How many labels its spelling counts for in a labelled word."""
    smoothing: float = 1.0
    """Added to each labelled count of neighbouring tags."""
    penalty: float = 1e-4
    """Penalty on the squared weights of log-linear emissions (epsilon of Eq. 3.26)."""
    chain: ChainSettings = field(default_factory=lambda: ChainSettings(penalty=0.1))
    """How the conditional random field is trained."""
    labelled_weight: float = 100.0
    """How many raw tokens a labelled one counts for, in EM and in self-training."""
    prior: float = 1.0
    """How many raw tokens of a word the supervised model's opinion of it counts for."""
    raw_smoothing: float = 1.0
    """Added to each raw count of neighbouring tags."""
    feature_count: int = 3
    """Log-linear emissions are normalised over raw words at least this frequent, besides the labelled ones."""
    steps: int = 20
    """Steps of L-BFGS in each pass of a feature model."""


class UnknownWords(Protocol):
    """Judges words that a model's table does not list."""

    def probabilities(self, words: Sequence[str]) -> Floats:
        """p(tag | word) [words, K]."""
        ...


@dataclass(frozen=True)
class Indifference:
    """Judges unknown words by tag_probability [K] alone, whatever their spelling."""

    tag_probability: Floats

    def probabilities(self, words: Sequence[str]) -> Floats:
        """p(tag | word) [words, K]."""
        return np.tile(self.tag_probability, (len(words), 1))


@dataclass(frozen=True)
class SpellingClassifier:
    """Judges unknown words by the classifier of word types."""

    classifier: WordClassifier

    def probabilities(self, words: Sequence[str]) -> Floats:
        """p(tag | word) [words, K]."""
        return self.classifier.probabilities(words, SPELLING_ALONE)


@dataclass(frozen=True)
class TableHiddenMarkovModel:
    """A hidden Markov model by tables: emissions [V, K] are p(word | tag) of the words listed; p(h) [K] of tags."""

    word_ids: Mapping[str, int]
    emissions: Floats
    tag_probability: Floats
    unknown: UnknownWords
    transitions: Transitions

    def word_scores(self, words: Sequence[str]) -> Floats:
        """Proportional to p(word | tag) [words, K]; unknown words by Bayes' rule."""
        rows = np.fromiter((self.word_ids.get(word, -1) for word in words), np.int64, len(words))
        scores = self.emissions[rows]
        missing = np.flatnonzero(rows < 0)
        if len(missing):
            judged = self.unknown.probabilities([words[i] for i in missing.tolist()])
            scores[missing] = judged / self.tag_probability
        return scores

    def token_scores(self, words: Sequence[str], ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """Proportional to p(word | tag) [tokens, K]."""
        return self.word_scores(words)[ids]


def add_one_model(corpus: LabelledCorpus, tags: Sequence[str]) -> TableHiddenMarkovModel:
    """The thesis's supervised model: one added to each count, of words (one more: unknown) and neighbouring tags."""
    counts, word_ids = _label_counts(corpus, tags)
    total = counts.words.sum(axis=0)
    unknown = 1.0 / (total + len(word_ids) + 1.0)
    tag_probability = (total + 1.0) / (total + 1.0).sum()
    return TableHiddenMarkovModel(
        word_ids,
        (counts.words + 1.0) * unknown,
        tag_probability,
        Indifference(unknown * tag_probability / (unknown @ tag_probability)),
        normalised(counts.pairs + 1.0),
    )


def supervised_model(corpus: LabelledCorpus, tags: Sequence[str], settings: BaselineSettings) -> TableHiddenMarkovModel:
    """The strong supervised model: unknown words, and to a small degree labelled ones, are judged by their spelling."""
    counts, word_ids = _label_counts(corpus, tags)
    unknown = learn_spelling(corpus, tags, settings)
    prior = settings.shrinkage * unknown.probabilities(list(word_ids))
    return table_model(counts, word_ids, prior, unknown, settings.smoothing)


def table_model(
    counts: TagCounts, word_ids: Mapping[str, int], prior: Floats, unknown: UnknownWords, smoothing: float
) -> TableHiddenMarkovModel:
    """Relative frequencies, with `prior` [V, K] pseudo-counts of words and `smoothing` of neighbouring tags."""
    words = counts.words + prior
    mass = words.sum(axis=0)
    emissions = np.divide(words, mass, out=np.zeros_like(words), where=mass > 0)
    return TableHiddenMarkovModel(
        word_ids,
        emissions,
        np.maximum(mass / mass.sum(), LEAST_PROBABILITY),
        unknown,
        normalised(counts.pairs + smoothing),
    )


def learn_spelling(corpus: LabelledCorpus, tags: Sequence[str], settings: BaselineSettings) -> UnknownWords:
    """What the spelling of rare labelled words says of unknown ones; of all labelled words where few tags have any."""
    labels = label_counts(corpus)
    if settings.unknown == "classifier":
        return SpellingClassifier(fit_classifier(labels, SPELLING_ALONE, tags, settings.inverse_penalty))
    rare = {word: of for word, of in labels.items() if of.total() <= settings.suffix_count} or labels
    return SuffixTree.grow(list(rare)).judge(_type_counts(rare, tags), settings.suffix_backoff)


def supervised_feature_model(
    corpus: LabelledCorpus, tags: Sequence[str], settings: BaselineSettings, raw_words: Sequence[str] = ()
) -> FeatureHiddenMarkovModel:
    """Log-linear emissions on mean parameters of the labels (Eq. 3.26).

    Normalised over the labelled words, and over `raw_words` where given (which did worse: 88.4 against 89.5 on Brown's
    development data with 150 sentences, since raw words without a label then count as never to be expected).
    """
    labelled, label_ids = _label_counts(corpus, tags)
    words = list(dict.fromkeys([*label_ids, *raw_words]))
    counts = np.zeros((len(words), len(tags)))
    counts[: len(label_ids)] = labelled.words
    names = [identity_features(word) for word in words]
    columns = feature_columns(names)
    features = feature_matrix(names, columns)
    emissions = fit_emissions(features, mean_features(features, counts), settings.penalty)
    return FeatureHiddenMarkovModel(columns, emissions, normalised(labelled.pairs + settings.smoothing))


def feature_columns(names: Iterable[Sequence[str]]) -> Mapping[str, int]:
    """A column for each feature, in the order of first appearance."""
    return {name: column for column, name in enumerate(dict.fromkeys(name for row in names for name in row))}


def mean_features(features: sparse.csr_array, counts: Floats) -> Floats:
    """E[phi(X) | h] [W, K] of words with counts of tags [V, K]; a tag without counts expects any word alike."""
    smoothed = counts + LEAST_COUNT / len(counts)
    return np.asarray(features.T @ (smoothed / smoothed.sum(axis=0)))


@dataclass(frozen=True)
class SpellingChainModel:
    """A conditional random field that sees spelling, identity and clusters of each word and of its neighbours."""

    clusters: Clusters
    tags: tuple[str, ...]
    chain: ChainWeights

    @property
    def transitions(self) -> Transitions:
        """The field's potentials of neighbouring tags."""
        return self.chain.transitions

    def token_scores(self, words: Sequence[str], ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """Potentials of tags [tokens, K], the largest of a token being one."""
        described = describe(words, *_unseen(words, self.tags), self.tags, self.clusters)
        logs = self.chain.token_scores(self.chain.word_scores(described), ids, offsets)
        return np.asarray(np.exp(logs - logs.max(axis=1, keepdims=True)))


def supervised_chain_model(
    corpus: LabelledCorpus, tags: Sequence[str], settings: ChainSettings, clusters: Clusters | None = None
) -> SpellingChainModel:
    """The conditional random field on labels alone (and clusters, where given)."""
    known: Clusters = {} if clusters is None else clusters
    described = [describe(words, *_unseen(words, tags), tags, known) for words in corpus.words]
    return SpellingChainModel(known, tuple(tags), train_chain(corpus, described, tags, settings))


def _label_counts(corpus: LabelledCorpus, tags: Sequence[str]) -> tuple[TagCounts, Mapping[str, int]]:
    labels = label_counts(corpus)
    if not labels:
        raise InputError("labelled data: found no labelled word, expected at least one")
    word_ids = {word: row for row, word in enumerate(labels)}
    return observed_counts(corpus, word_ids, tags), word_ids


def _type_counts(labels: Mapping[str, Counter[str]], tags: Sequence[str]) -> Floats:
    number = {tag: index for index, tag in enumerate(tags)}
    counts = np.zeros((len(labels), len(tags)))
    for row, of in enumerate(labels.values()):
        for tag, n in of.items():
            counts[row, number[tag]] = n / of.total()
    return counts


def _unseen(words: Sequence[str], tags: Sequence[str]) -> tuple[Floats, Floats]:
    """Neither posteriors nor contexts."""
    return np.zeros((len(words), len(tags))), np.zeros((len(words), 0))
