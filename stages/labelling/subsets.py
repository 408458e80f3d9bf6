"""Training sets of a corpus: their names, their sentences, and what is known of words from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow.compute as pc

from predplan.artifacts.tables import read_table
from predplan.labelling.corpora import training_subset
from predplan.labelling.lexicon import Evidence, Lexicon, Supervision, build_lexicon
from predplan.labelling.posteriors import ContextPosteriors
from predplan.labelling.sentences import UNIVERSAL_TAGS, LabelledCorpus, label_counts
from predplan.labelling.tables import (
    POSTERIORS,
    TAG_NAMES,
    matrix_of,
    read_bigrams,
    read_corpus,
    read_dictionary_table,
)
from predplan.labelling.training import RawStatistics, gather_evidence, raw_statistics
from stages.common import CorpusStage


@dataclass(frozen=True)
class TrainingSet:
    """A draw of labelled sentences, named by its size and its seed."""

    name: str
    size: int
    seed: int
    corpus: LabelledCorpus
    supervision: Supervision

    def has_all(self, tags: tuple[str, ...]) -> bool:
        """Whether labels or dictionary have each of the tags; a tag that nobody has seen cannot be learned."""
        labelled = {tag for of in self.supervision.labels.values() for tag in of}
        listed = {tag for of in self.supervision.dictionary.values() for tag in of}
        return not set(tags) - labelled - listed


def training_sets(stage: CorpusStage, sizes: Sequence[int]) -> list[TrainingSet]:
    """The draws of each size; a size of all labelled sentences or more is drawn once."""
    train = read_corpus(stage.path("train.parquet"))
    dictionary = read_dictionary_table(stage.path("dictionary.parquet"))
    sets = []
    for size in sorted({min(size, len(train)) for size in sizes}):
        for seed in range(1 if size == len(train) else stage.corpus.draws):
            subset = train.subset(training_subset(size, len(train), seed))
            supervision = Supervision(label_counts(subset), dictionary)
            sets.append(TrainingSet(f"{size}-{seed}", size, seed, subset, supervision))
    return sets


def tag_names(sets: list[TrainingSet]) -> tuple[str, ...]:
    """Tags of all training sets, in the order of the universal tags, then by name."""
    found = {tag for drawn in sets for of in drawn.supervision.labels.values() for tag in of}
    known = [tag for tag in UNIVERSAL_TAGS if tag in found]
    return (*known, *sorted(found.difference(known)))


def read_tags(stage: CorpusStage) -> tuple[str, ...]:
    """The tags the anchors stage found."""
    return tuple(read_table(stage.path("tags.parquet"), TAG_NAMES)["tag"].to_pylist())


def read_statistics(stage: CorpusStage) -> RawStatistics:
    """Moments and canonical vectors of the raw text."""
    bigrams = read_bigrams(stage.path("words.parquet"), stage.path("bigrams.parquet"))
    labelling = stage.settings.labelling
    return raw_statistics(bigrams, labelling.training.moments, labelling.seed)


def read_evidence(
    stage: CorpusStage, drawn: TrainingSet, raw: RawStatistics, tags: tuple[str, ...]
) -> tuple[Evidence, Lexicon]:
    """What the emissions stage found for one training set: the evidence of each word, and the lexicon built on it."""
    training = stage.settings.labelling.training
    table = read_table(stage.path("posteriors.parquet"), POSTERIORS)
    rows = table.filter(pc.equal(table["subset"], drawn.name))
    ids = np.fromiter((raw.word_ids[word] for word in rows["word"].to_pylist()), np.int64)
    gamma, log_ratio = (matrix_of(rows[name], len(tags)) for name in ("gamma", "log_ratio"))
    contexts = ContextPosteriors(ids, gamma, rows["residual"].to_numpy(), log_ratio)
    evidence = gather_evidence(raw, contexts)
    return evidence, build_lexicon(drawn.supervision, evidence, tags, training.lexicon)
