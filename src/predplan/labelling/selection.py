"""Choosing a few settings on development sentences, from a small fixed grid.

First the lexicon's, by the accuracy of the hidden Markov model on it; then, for the conditional random field, its
penalty. Candidates are judged on lexicons of only the words that labelled and development sentences hold, since of the
other words nothing shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import product
from typing import TypeVar

import numpy as np

from predplan.labelling.decoding import Transitions
from predplan.labelling.lexicon import Evidence, Supervision, build_lexicon
from predplan.labelling.models import HiddenMarkovModel, SequenceModel, Tokens, decode
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.training import TrainingSettings, train_chain_model

SHRINKAGE = (0.03, 0.1, 0.3, 1.0)
INVERSE_PENALTY = (0.3, 1.0, 3.0)
CHAIN_PENALTY = (0.1, 0.5, 2.0)
Candidate = TypeVar("Candidate")


def select_settings(
    dev: LabelledCorpus,
    labelled: LabelledCorpus,
    supervision: Supervision,
    evidence: Evidence,
    transitions: Transitions,
    tags: tuple[str, ...],
    settings: TrainingSettings,
    seed: int,
    chain: bool,
) -> TrainingSettings:
    """The settings under which most development tokens get their tag; on a tie those given stay, else the first."""
    shown = _restricted(evidence, [*dev.words, *labelled.words])

    def lexicon_model(candidate: TrainingSettings) -> SequenceModel:
        return HiddenMarkovModel(build_lexicon(supervision, shown, tags, candidate.lexicon), transitions)

    def chain_model(candidate: TrainingSettings) -> SequenceModel:
        return train_chain_model(labelled, supervision.dictionary, lexicon, shown, {}, tags, candidate, seed)

    grid = [
        replace(settings, lexicon=replace(settings.lexicon, shrinkage=shrinkage, inverse_penalty=inverse_penalty))
        for inverse_penalty, shrinkage in product(INVERSE_PENALTY, SHRINKAGE)
    ]
    best = _best([settings, *grid], lambda candidate: _right(lexicon_model(candidate), dev, tags))
    if not chain:
        return best
    lexicon = build_lexicon(supervision, shown, tags, best.lexicon)
    grid = [replace(best, chain=replace(best.chain, penalty=penalty)) for penalty in CHAIN_PENALTY]
    return _best([best, *grid], lambda candidate: _right(chain_model(candidate), dev, tags))


def _best(candidates: Iterable[Candidate], right: Callable[[Candidate], int]) -> Candidate:
    return max(dict.fromkeys(candidates), key=right)


def _right(model: SequenceModel, dev: LabelledCorpus, tags: tuple[str, ...]) -> int:
    """Development tokens that get their tag."""
    number = {tag: index for index, tag in enumerate(tags)}
    gold = np.array([-1 if tag is None else number.get(tag, -1) for sentence in dev.tags for tag in sentence])
    return int((decode(model, Tokens.of(dev.words)) == gold).sum())


def _restricted(evidence: Evidence, sentences: Iterable[Iterable[str]]) -> Evidence:
    words = [word for word in dict.fromkeys(word for words in sentences for word in words) if word in evidence.word_ids]
    ids = [evidence.word_ids[word] for word in words]
    return Evidence({word: place for place, word in enumerate(words)}, evidence.count[ids], evidence.values[ids])
