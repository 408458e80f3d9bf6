"""p(tag | word) of any word: a log-linear classifier of word types over spelling and over what the contexts say.

The anchors' posteriors rank words well but are too sure of themselves: neighbouring words are not independent given
the tag, and anchors are frequent words while new words are rare ones. The labelled words say how far to trust them,
together with the spelling, at each frequency; an unknown word is judged by its spelling alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.errors import InputError
from predplan.labelling.features import feature_matrix, spelling_features
from predplan.labelling.logistic import fit_logistic

Floats = NDArray[np.float64]
LEAST_PROBABILITY = 1e-5
WORDS_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class Evidence:
    """What raw text says of some words: their counts [n] and measurements [n, D] that grow with confidence."""

    word_ids: Mapping[str, int]
    count: NDArray[np.int64]
    values: NDArray[np.float32]

    def rows(self, words: Sequence[str], width: int | None = None) -> Floats:
        """Measurements [words, D], or the first `width` of them; zero for words of which nothing is said."""
        ids = np.fromiter((self.word_ids.get(word, -1) for word in words), np.int64, len(words))
        found = self.values[ids, :width].astype(np.float64)
        found[ids < 0] = 0.0
        return found

    def features(self, word: str) -> list[str]:
        """Spelling features, and how frequent the word is in the raw text on a scale of powers of two."""
        word_id = self.word_ids.get(word)
        count = 0 if word_id is None else int(self.count[word_id])
        return [*spelling_features(word), f"frequency={(count + 1).bit_length() - 1}"]


def confidence(count: NDArray[np.int64]) -> Floats:
    """Scale of a measurement from `count` occurrences [V]: log2(1 + n) / 4, measured best on dev of several."""
    return np.asarray(np.log2(1.0 + count) / 4.0)


@dataclass(frozen=True)
class WordClassifier:
    """Weights of named features, columns -> row of spelling [W, K], and of evidence [D, K]."""

    columns: Mapping[str, int]
    spelling: Floats
    evidence: Floats

    def probabilities(self, words: Sequence[str], evidence: Evidence) -> Floats:
        """p(tag | word) [words, K], none below 1e-5."""
        found = np.empty((len(words), self.spelling.shape[1]))
        for start in range(0, len(words), WORDS_AT_ONCE):
            some = slice(start, start + WORDS_AT_ONCE)
            found[some] = self._some(words[some], evidence)
        return found

    def _some(self, words: Sequence[str], evidence: Evidence) -> Floats:
        scores = feature_matrix((evidence.features(word) for word in words), self.columns) @ self.spelling
        if evidence.word_ids:
            scores = scores + evidence.rows(words) @ self.evidence
        odds = np.exp(scores - scores.max(axis=1, keepdims=True))
        odds = odds / odds.sum(axis=1, keepdims=True) + LEAST_PROBABILITY
        return np.asarray(odds / odds.sum(axis=1, keepdims=True))


def fit_classifier(
    labels: Mapping[str, Counter[str]], evidence: Evidence, tags: Sequence[str], inverse_penalty: float
) -> WordClassifier:
    """Fit to labelled word types (label_counts): each weighs one, shared between its tags by their frequency.

    Raises InputError where fewer than two tags are labelled.
    """
    examples = [(word, tag, n / of.total()) for word, of in labels.items() for tag, n in of.items()]
    present = sorted({tags.index(tag) for _, tag, _ in examples})
    if len(present) < 2:
        raise InputError(f"labelled data: found {len(labels)} labelled words of one tag, expected at least two tags")
    words = [word for word, _, _ in examples]
    names = [evidence.features(word) for word in words]
    columns = {name: column for column, name in enumerate(sorted({name for row in names for name in row}))}
    inputs = sparse.hstack([feature_matrix(names, columns), sparse.csr_array(evidence.rows(words))]).tocsr()
    target = np.eye(len(tags))[[tags.index(tag) for _, tag, _ in examples]][:, present]
    share = np.array([share for _, _, share in examples])
    weights = np.zeros((inputs.shape[1], len(tags)))
    bias = np.full(len(tags), np.log(LEAST_PROBABILITY))
    weights[:, present], bias[present] = fit_logistic(inputs, target, share, inverse_penalty)
    weights[columns["bias"]] += bias
    return WordClassifier(columns, weights[: len(columns)], weights[len(columns) :])


@dataclass(frozen=True)
class Lexicon:
    """p(tag | word): probabilities [V, K] of the words it lists, the classifier's for all others.

    count [V] in raw text; contexts [V, 2K]: the evidence of their contexts, gamma and log ratios, or [V, 0];
    tag_probability [K]: p(h), the sum of p(tag | word) p(word) over raw text (Eq. 3.16).
    """

    word_ids: Mapping[str, int]
    count: NDArray[np.int64]
    probabilities: Floats
    contexts: Floats
    tag_probability: Floats
    classifier: WordClassifier

    def of(self, words: Sequence[str]) -> Floats:
        """p(tag | word) [words, K]."""
        ids = self._ids(words)
        found = np.where(ids[:, None] >= 0, self.probabilities[ids], 0.0)
        unknown = np.flatnonzero(ids < 0).tolist()
        if unknown:
            found[unknown] = self.classifier.probabilities([words[i] for i in unknown], NO_EVIDENCE)
        return found

    def contexts_of(self, words: Sequence[str]) -> Floats:
        """The evidence of the words' contexts [words, 2K]; zero for words that are not listed."""
        ids = self._ids(words)
        return np.where(ids[:, None] >= 0, self.contexts[ids], 0.0)

    def _ids(self, words: Sequence[str]) -> NDArray[np.int64]:
        return np.fromiter((self.word_ids.get(word, -1) for word in words), np.int64, len(words))


NO_EVIDENCE = Evidence({}, np.empty(0, np.int64), np.empty((0, 0), np.float32))


@dataclass(frozen=True)
class LexiconSettings:
    """How labels, spelling and contexts are weighed in p(tag | word)."""

    inverse_penalty: float = 1.0
    """Inverse strength of the classifier's penalty on squared weights."""
    shrinkage: float = 0.1
    """How many labels the classifier's opinion of a labelled word counts for."""
    lam: float = 1.0
    """Weight of a word's own labels, 0 to 1 (the role of lambda in Eq. 3.27)."""
    least_count: int = 2
    """Words rarer than this in raw text, and not labelled, are left to the classifier."""
    disallowed: float = 0.05
    """Factor on the odds of a tag that the dictionary does not list for a word it has."""


@dataclass(frozen=True)
class Supervision:
    """What is known of words: tags with their counts in labelled sentences, and a tag dictionary (may be empty)."""

    labels: Mapping[str, Counter[str]]
    dictionary: Mapping[str, frozenset[str]]


def fit_supervised(
    supervision: Supervision, evidence: Evidence, tags: Sequence[str], settings: LexiconSettings
) -> WordClassifier:
    """The classifier of word types; a word that only the dictionary has counts once for each tag it allows."""
    listed = {
        word: Counter(sorted(allowed))
        for word, allowed in supervision.dictionary.items()
        if word not in supervision.labels
    }
    return fit_classifier({**supervision.labels, **listed}, evidence, tags, settings.inverse_penalty)


def judge(
    words: Sequence[str],
    classifier: WordClassifier,
    supervision: Supervision,
    evidence: Evidence,
    tags: Sequence[str],
    settings: LexiconSettings,
) -> Floats:
    """p(tag | word) [words, K]: the classifier's opinion, kept to the dictionary, under the word's own labels."""
    probabilities = classifier.probabilities(words, evidence)
    number = {tag: index for index, tag in enumerate(tags)}
    for place, word in enumerate(words):
        if word in supervision.dictionary:
            factor = np.full(len(tags), settings.disallowed)
            factor[[number[tag] for tag in supervision.dictionary[word]]] = 1.0
            probabilities[place] *= factor / (probabilities[place] @ factor)
        if word in supervision.labels:
            own = np.zeros(len(tags))
            for tag, n in supervision.labels[word].items():
                own[number[tag]] = settings.lam * n
            probabilities[place] = (own + settings.shrinkage * probabilities[place]) / (own.sum() + settings.shrinkage)
    return probabilities


def build_lexicon(
    supervision: Supervision, evidence: Evidence, tags: Sequence[str], settings: LexiconSettings
) -> Lexicon:
    """Fit the classifier, and judge every word that raw text has often enough or that labels or dictionary know."""
    classifier = fit_supervised(supervision, evidence, tags, settings)
    count_of = dict(zip(evidence.word_ids, evidence.count.tolist(), strict=True))
    frequent = [word for word, n in count_of.items() if n >= settings.least_count]
    words = frequent + sorted({*supervision.labels, *supervision.dictionary}.difference(frequent))
    probabilities = judge(words, classifier, supervision, evidence, tags, settings)
    count = np.array([count_of.get(word, 0) for word in words], np.int64)
    mass = np.maximum(count, 1) @ probabilities
    word_ids = {word: place for place, word in enumerate(words)}
    contexts = evidence.rows(words, 2 * len(tags))
    return Lexicon(word_ids, count, probabilities, contexts, mass / mass.sum(), classifier)
