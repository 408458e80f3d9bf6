"""A conditional random field whose features each look at one word: the token's own, the one before or the one after.

python-crfsuite trains it; its weights are taken out, so that a model is tables of numbers and a word type is scored
once, not once a token.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycrfsuite
from numpy.typing import NDArray
from scipy import sparse

from predplan.errors import InputError
from predplan.labelling.decoding import Transitions
from predplan.labelling.sentences import LabelledCorpus

Floats = NDArray[np.float64]

OFFSETS = (-1, 0, 1)
Features = Mapping[str, float]
"""Names of features with their values, none negative: CRFsuite drops features that sum below zero."""


@dataclass(frozen=True)
class Description:
    """What the field sees of a word: its features for its own token, and for the tokens beside it."""

    own: Features
    beside: Features


EDGE = Description({}, {"edge": 1.0})


@dataclass(frozen=True)
class ChainSettings:
    """How the conditional random field is trained."""

    penalty: float = 0.5
    """Coefficient of the squared weights."""
    iterations: int = 150
    """Most steps of L-BFGS."""


@dataclass(frozen=True)
class ChainWeights:
    """Weights of the field: columns name the features, weights [3, W, K] for the word before, here and after."""

    columns: Mapping[str, int]
    weights: Floats
    transitions: Transitions

    def word_scores(self, descriptions: Sequence[Description]) -> Floats:
        """Log-potentials each word adds to the token after it, to its own and to the one before [3, words, K]."""
        own = self._table([description.own for description in descriptions])
        beside = self._table([description.beside for description in descriptions])
        return np.stack([beside @ self.weights[0], own @ self.weights[1], beside @ self.weights[2]])

    def _table(self, rows: Sequence[Features]) -> sparse.csr_array:
        indptr, indices, values = [0], [], []
        for features in rows:
            for name, value in features.items():
                column = self.columns.get(name)
                if column is not None:
                    indices.append(column)
                    values.append(value)
            indptr.append(len(indices))
        shape = (len(rows), len(self.columns))
        return sparse.csr_array((np.array(values), np.array(indices, np.int64), np.array(indptr)), shape=shape)

    def token_scores(self, words: Floats, ids: NDArray[np.int64], offsets: NDArray[np.int64]) -> Floats:
        """Log-potentials of tokens [tokens, K] from those of word types [3, words, K]; ids index types."""
        edge = self.word_scores([EDGE])[:, 0]
        before = np.empty((len(ids), words.shape[2]))
        after = np.empty_like(before)
        before[1:], after[:-1] = words[0, ids[:-1]], words[2, ids[1:]]
        filled = offsets[:-1] < offsets[1:]
        before[offsets[:-1][filled]] = edge[0]
        after[offsets[1:][filled] - 1] = edge[2]
        return np.asarray(words[1, ids] + before + after)


def train_chain(
    corpus: LabelledCorpus,
    descriptions: Sequence[Sequence[Description]],
    tags: Sequence[str],
    settings: ChainSettings,
) -> ChainWeights:
    """Fit to every run of labelled words, seen among all words of its sentence; descriptions[s][i] describes word i.

    A sentence without descriptions is passed over. Raises InputError where no labelled word is left.
    """
    trainer = pycrfsuite.Trainer("lbfgs", verbose=False)
    trainer.set_params(
        {
            "c1": 0.0,
            "c2": settings.penalty,
            "max_iterations": settings.iterations,
            "feature.possible_transitions": True,
        }
    )
    runs = [
        (windows[start:stop], sentence_tags[start:stop])
        for sentence, sentence_tags in zip(descriptions, corpus.tags, strict=True)
        for windows in [_windows(sentence)]
        for start, stop in (labelled_runs(sentence_tags) if windows else ())
    ]
    if not runs:
        raise InputError("the conditional random field: found no labelled word to train on, expected several sentences")
    for windows, run_tags in runs:
        trainer.append(pycrfsuite.ItemSequence(windows), list(run_tags))
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "weights.crfsuite")
        trainer.train(path)
        tagger = pycrfsuite.Tagger()
        tagger.open(path)
        dumped = tagger.info()
        tagger.close()
    number = {tag: index for index, tag in enumerate(tags)}
    entries = [(*attribute.split("|", 1), tag, weight) for (attribute, tag), weight in dumped.state_features.items()]
    columns = {name: column for column, name in enumerate(sorted({name for _, name, _, _ in entries}))}
    weights = np.zeros((len(OFFSETS), len(columns), len(tags)))
    for offset, name, tag, weight in entries:
        weights[OFFSETS.index(int(offset)), columns[name], number[tag]] = weight
    between = np.ones((len(tags), len(tags)))
    for (previous, following), weight in dumped.transitions.items():
        between[number[previous], number[following]] = np.exp(weight)
    return ChainWeights(columns, weights, Transitions(np.ones(len(tags)), between, np.ones(len(tags))))


def labelled_runs(tags: Sequence[str | None]) -> list[tuple[int, int]]:
    """Where each longest run of labelled words begins and ends."""
    edges = np.flatnonzero(np.diff([0, *(tag is not None for tag in tags), 0]))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def _windows(sentence: Sequence[Description]) -> list[dict[str, float]]:
    padded = [EDGE, *sentence, EDGE]
    windows = []
    for before, here, after in zip(padded, sentence, padded[2:], strict=False):
        parts = zip(OFFSETS, (before.beside, here.own, after.beside), strict=True)
        windows.append({f"{offset}|{name}": value for offset, part in parts for name, value in part.items()})
    return windows
