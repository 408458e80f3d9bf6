"""What every part of the labeller exchanges: labelled sentences, and batches of raw sentences as word ids."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNIVERSAL_TAGS = ("NOUN", "VERB", "ADJ", "ADV", "PRON", "DET", "ADP", "NUM", "CONJ", "PRT", ".", "X")


@dataclass(frozen=True)
class LabelledCorpus:
    """Sentences with a tag a word; a tag of None marks a word nobody has labelled."""

    words: tuple[tuple[str, ...], ...]
    tags: tuple[tuple[str | None, ...], ...]

    def __len__(self) -> int:
        return len(self.words)

    def subset(self, indices: Sequence[int]) -> LabelledCorpus:
        """The sentences at `indices`, in that order."""
        return LabelledCorpus(tuple(self.words[i] for i in indices), tuple(self.tags[i] for i in indices))


@dataclass(frozen=True)
class TokenBatch:
    """Consecutive raw sentences: ids [tokens] index `vocabulary`; sentence s is ids[offsets[s]:offsets[s + 1]]."""

    vocabulary: tuple[str, ...]
    ids: NDArray[np.int32]
    offsets: NDArray[np.int64]


def label_counts(corpus: LabelledCorpus) -> dict[str, Counter[str]]:
    """How often each labelled word has each tag; words without a tag are passed over."""
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for words, tags in zip(corpus.words, corpus.tags, strict=True):
        for word, tag in zip(words, tags, strict=True):
            if tag is not None:
                counts[word][tag] += 1
    return dict(counts)
