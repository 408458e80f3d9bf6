"""p(tag | word) of any word: a log-linear classifier of word types over spelling and over what the contexts say.

The anchors' posteriors rank words well but are too sure of themselves: neighbouring words are not independent given
the tag, and anchors are frequent words while new words are rare ones. The labelled words say how far to trust them,
together with the spelling, at each frequency; an unknown word is judged by its spelling alone.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from sklearn.linear_model import LogisticRegression

from predplan.labelling.features import feature_matrix, spelling_features
from predplan.labelling.sentences import LabelledCorpus

Floats = NDArray[np.float64]
LEAST_PROBABILITY = 1e-5


@dataclass(frozen=True)
class Evidence:
    """What raw text says of each word of a vocabulary: its count and measurements [V, D] that grow with confidence."""

    word_ids: Mapping[str, int]
    count: NDArray[np.int64]
    values: Floats

    def rows(self, words: Sequence[str]) -> Floats:
        """Measurements [words, D]; zero for words the raw text does not have."""
        ids = np.fromiter((self.word_ids.get(word, -1) for word in words), np.int64, len(words))
        return np.where(ids[:, None] >= 0, self.values[ids], 0.0)

    def features(self, word: str) -> list[str]:
        """Spelling features, and how frequent the word is in the raw text on a scale of powers of two."""
        word_id = self.word_ids.get(word)
        count = 0 if word_id is None else int(self.count[word_id])
        return [*spelling_features(word), f"frequency={(count + 1).bit_length() - 1}"]


def confidence(count: NDArray[np.int64]) -> Floats:
    """How much a measurement from `count` occurrences is scaled [V]: log2(1 + n) / 4, measured best on dev of several."""
    return np.asarray(np.log2(1.0 + count) / 4.0)


@dataclass(frozen=True)
class WordClassifier:
    """Weights of named features, columns -> row of spelling [W, K], and of evidence [D, K]."""

    columns: Mapping[str, int]
    spelling: Floats
    evidence: Floats

    def probabilities(self, words: Sequence[str], evidence: Evidence) -> Floats:
        """p(tag | word) [words, K], none below 1e-5."""
        spelled = feature_matrix((evidence.features(word) for word in words), self.columns)
        scores = spelled @ self.spelling + evidence.rows(words) @ self.evidence
        odds = np.exp(scores - scores.max(axis=1, keepdims=True))
        odds = odds / odds.sum(axis=1, keepdims=True) + LEAST_PROBABILITY
        return np.asarray(odds / odds.sum(axis=1, keepdims=True))


def fit_classifier(
    corpus: LabelledCorpus, evidence: Evidence, tags: Sequence[str], inverse_penalty: float
) -> WordClassifier:
    """Fit to labelled word types: each weighs one, shared between its tags by their frequency."""
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for word, tag in labelled_tokens(corpus):
        counts[word][tag] += 1
    examples = [(word, tag, n / sum(of.values())) for word, of in counts.items() for tag, n in of.items()]
    words = [word for word, _, _ in examples]
    names = [evidence.features(word) for word in words]
    columns = {name: column for column, name in enumerate(sorted({name for row in names for name in row}))}
    inputs = sparse.hstack([feature_matrix(names, columns), sparse.csr_array(evidence.rows(words))]).tocsr()
    target = np.array([tags.index(tag) for _, tag, _ in examples])
    model = LogisticRegression(C=inverse_penalty, max_iter=1000)
    model.fit(inputs, target, sample_weight=[weight for _, _, weight in examples])
    weights = np.zeros((inputs.shape[1], len(tags)))
    weights[:, model.classes_] = model.coef_.T
    bias = np.full(len(tags), np.log(LEAST_PROBABILITY))
    bias[model.classes_] = model.intercept_
    weights[columns["bias"]] += bias
    return WordClassifier(columns, weights[: len(columns)], weights[len(columns) :])


def labelled_tokens(corpus: LabelledCorpus) -> Iterable[tuple[str, str]]:
    """The (word, tag) pairs that have a tag."""
    for words, tags in zip(corpus.words, corpus.tags, strict=True):
        for word, tag in zip(words, tags, strict=True):
            if tag is not None:
                yield word, tag
