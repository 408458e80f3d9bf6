"""Stack conditional random fields on the anchors' posteriors (Table 3.3): with and without them, and word clusters."""

from __future__ import annotations

import time
from collections.abc import Iterator

from predplan.labelling.clusters import learn_clusters, read_cluster_paths
from predplan.labelling.models import Clusters
from predplan.labelling.readers import read_letter_dictionary
from predplan.labelling.supervised import supervised_chain_model
from predplan.labelling.training import RawStatistics, train_chain_model
from stages.common import CorpusStage, run_stage
from stages.labelling.subsets import TrainingSet, read_evidence, read_statistics, read_tags, training_sets
from stages.labelling.trained import Sentences, Trained, emission_seconds, predict, write_predicted

CMU_CLUSTERS, CMU_DICTIONARY = "fetched/labelled/6mpaths", "fetched/labelled/tagdict.txt"


def main(stage: CorpusStage) -> None:
    names = ("train.parquet", "posteriors.parquet", "bigrams.parquet", "test_words.parquet")
    provenance = stage.provenance(*map(stage.path, names), training=stage.settings.labelling.training)
    raw, tags, sentences = read_statistics(stage), read_tags(stage), Sentences.read(stage)
    lists = word_lists(stage, raw)
    predicted = (
        predict(drawn.name, trained, sentences, tags)
        for drawn in training_sets(stage, stage.corpus.sizes)
        for trained in train(stage, drawn, raw, tags, lists)
    )
    write_predicted(stage, "stacked", provenance, predicted)


def word_lists(stage: CorpusStage, raw: RawStatistics) -> dict[str, Clusters]:
    """Classes of words by the suffix of the methods that see them; `all` adds a published tag dictionary, if any."""
    own = learn_clusters(raw, seed=stage.settings.labelling.seed)
    lists: dict[str, Clusters] = {"crf": {}, "crf-clusters": own}
    if stage.path(CMU_CLUSTERS).exists():
        lists["crf-clusters"] = joined(own, read_cluster_paths(stage.path(CMU_CLUSTERS)))
    if stage.path(CMU_DICTIONARY).exists():
        entries = read_letter_dictionary(stage.path(CMU_DICTIONARY))
        listed = {word: tuple(f"listed={tag}" for tag in tags) for word, tags in entries.items()}
        lists["crf-all"] = listed
        lists["crf-all-clusters"] = joined(lists["crf-clusters"], listed)
    return lists


def joined(first: Clusters, second: Clusters) -> Clusters:
    """Names from both, word by word; a word without small-letter form of its own takes that of its small letters."""
    words = dict.fromkeys([*first, *second])
    return {
        word: (*first.get(word, first.get(word.lower(), ())), *second.get(word, second.get(word.lower(), ())))
        for word in words
    }


def train(
    stage: CorpusStage, drawn: TrainingSet, raw: RawStatistics, tags: tuple[str, ...], lists: dict[str, Clusters]
) -> Iterator[Trained]:
    """A field for each list of words, without and with the posteriors."""
    labelling = stage.settings.labelling
    seconds = emission_seconds(stage)
    evidence, lexicon = read_evidence(stage, drawn, raw, tags)
    for name, clusters in lists.items():
        start = time.perf_counter()
        plain = supervised_chain_model(drawn.corpus, tags, labelling.baselines.chain, clusters)
        yield Trained(name, plain, time.perf_counter() - start)
        start = time.perf_counter()
        stacked = train_chain_model(
            drawn.corpus,
            drawn.supervision.dictionary,
            lexicon,
            evidence,
            clusters,
            tags,
            labelling.training,
            labelling.seed,
        )
        yield Trained(f"{name}-posteriors", stacked, seconds[drawn.name] + time.perf_counter() - start)


if __name__ == "__main__":
    run_stage(CorpusStage, main)
