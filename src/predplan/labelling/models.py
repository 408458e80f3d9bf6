"""The three sequence models: hidden Markov, feature hidden Markov, and conditional random field on the posteriors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from predplan.labelling.chain import ChainWeights, Description
from predplan.labelling.decoding import Transitions, posteriors, viterbi
from predplan.labelling.features import feature_matrix, spelling_features
from predplan.labelling.lexicon import Lexicon
from predplan.labelling.loglinear import LogLinearEmissions

Floats = NDArray[np.float64]
Clusters = Mapping[str, Sequence[str]]
"""Names of the clusters a word belongs to, coarse to fine."""
LEAST_VALUE = 1e-3


class SequenceModel(Protocol):
    """Scores word types and tokens; tokens are ids into the distinct words, sentences are parted by offsets."""

    @property
    def transitions(self) -> Transitions:
        """Probabilities or potentials between neighbouring tags."""
        ...

    def token_scores(self, words: Sequence[str], ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """Scores >= 0 of each token's tags [tokens, K], proportional to p(word | tag) or a potential."""
        ...


@dataclass(frozen=True)
class HiddenMarkovModel:
    """Emissions by Bayes' rule from p(tag | word) (Eq. 3.15); p(word) is the same for all tags and drops out."""

    lexicon: Lexicon
    transitions: Transitions

    def token_scores(self, words: Sequence[str], ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """p(tag | word) / p(tag) of each token."""
        return np.asarray((self.lexicon.of(words) / self.lexicon.tag_probability)[ids])


@dataclass(frozen=True)
class FeatureHiddenMarkovModel:
    """Log-linear emissions over spelling features and word identity (Eq. 3.2); columns name the features."""

    columns: Mapping[str, int]
    emissions: LogLinearEmissions
    transitions: Transitions

    def token_scores(self, words: Sequence[str], ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """p(word | tag) of each token, each row up to a factor."""
        logs = self.emissions.log_scores(feature_matrix(map(identity_features, words), self.columns))
        return np.asarray(np.exp(logs - logs.max(axis=1, keepdims=True))[ids])


@dataclass(frozen=True)
class ChainModel:
    """A conditional random field that sees spelling, clusters and p(tag | word) of each word and of its neighbours."""

    lexicon: Lexicon
    clusters: Clusters
    tags: tuple[str, ...]
    chain: ChainWeights

    @property
    def transitions(self) -> Transitions:
        """Potentials between neighbouring tags."""
        return self.chain.transitions

    def token_scores(self, words: Sequence[str], ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """Potentials of each token's tags, which depend on the words beside it too."""
        contexts = self.lexicon.contexts_of(words)
        described = describe(words, self.lexicon.of(words), contexts, self.tags, self.clusters)
        logs = self.chain.token_scores(self.chain.word_scores(described), ids, offsets)
        return np.asarray(np.exp(logs - logs.max(axis=1, keepdims=True)))


def identity_features(word: str) -> list[str]:
    """Spelling features, the word itself and its small-letter form."""
    return [*spelling_features(word), f"word={word}", f"lower={word.lower()}"]


def describe(
    words: Sequence[str], posterior: Floats, contexts: Floats, tags: Sequence[str], clusters: Clusters
) -> list[Description]:
    """What the field sees of words, from p(tag | word) [words, K] and evidence of contexts [words, 2K] or none.

    Of its own word a token sees spelling, identity, clusters, posterior and contexts; of the words beside it their
    small-letter form, clusters and posterior.
    """
    names = [f"gamma={tag}" for tag in tags] + [f"ratio={tag}" for tag in tags]
    described = []
    for word, probabilities, evidence in zip(words, posterior.tolist(), contexts.tolist(), strict=True):
        shared = dict.fromkeys((f"lower={word.lower()}", *clusters.get(word, clusters.get(word.lower(), ()))), 1.0)
        shared |= {f"posterior={tag}": p for tag, p in zip(tags, probabilities, strict=True) if p > LEAST_VALUE}
        measured = {
            name if value > 0 else f"-{name}": abs(value)
            for name, value in zip(names, evidence, strict=False)
            if abs(value) > LEAST_VALUE
        }
        described.append(Description(dict.fromkeys(identity_features(word), 1.0) | shared | measured, shared))
    return described


@dataclass(frozen=True)
class Tokens:
    """Sentences as ids into their distinct words."""

    words: tuple[str, ...]
    ids: NDArray[np.int64]
    offsets: NDArray[np.int64]

    @classmethod
    def of(cls, sentences: Sequence[Sequence[str]]) -> Tokens:
        """Number the distinct words of sentences in order of first appearance."""
        distinct: dict[str, int] = {}
        ids = [distinct.setdefault(word, len(distinct)) for sentence in sentences for word in sentence]
        offsets = np.cumsum([0, *map(len, sentences)])
        return cls(tuple(distinct), np.array(ids, np.int64), offsets.astype(np.int64))


def decode(model: SequenceModel, tokens: Tokens, best_path: bool = False) -> NDArray[np.int64]:
    """Tag indices [tokens]: of least expected errors, or of the most probable path."""
    if best_path:
        return viterbi(model.token_scores(tokens.words, tokens.ids, tokens.offsets), tokens.offsets, model.transitions)
    return np.asarray(decode_posteriors(model, tokens).argmax(axis=1))


def decode_posteriors(model: SequenceModel, tokens: Tokens) -> Floats:
    """p(tag | sentence) of each token [tokens, K]."""
    scores = model.token_scores(tokens.words, tokens.ids, tokens.offsets)
    return posteriors(scores, tokens.offsets, model.transitions).tags
