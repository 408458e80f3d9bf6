"""Corpora as the experiments use them: labelled parts, a dictionary, raw text, from a declared source or own files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from predplan.errors import InputError
from predplan.labelling.readers import (
    RawText,
    Style,
    read_brown,
    read_dictionary,
    read_labelled,
    read_pairs,
    read_raw,
    read_word_groups,
)
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.sources import Fetched, fetch
from predplan.labelling.tagmaps import TagMap, map_dictionary, map_tags, own_tagmap, strip_tag_suffix
from predplan.labelling.tokenising import normalise

Dictionary = Mapping[str, frozenset[str]]


@dataclass(frozen=True)
class SplitSettings:
    """How a corpus without splits of its own is cut, by seed: sentences for each part, the rest is raw text."""

    labelled: int
    dev: int
    test: int
    seed: int = 0


@dataclass(frozen=True)
class OwnFiles:
    """Paths of a corpus of one's own: labelled files as `read_labelled` takes them, raw text one sentence a line."""

    labelled: str
    dev: str
    test: str
    raw: tuple[str, ...] = ()
    dictionary: str | None = None


@dataclass(frozen=True)
class Corpus:
    """Parts of a corpus. raw: files of raw text; untagged: sentences whose tags nobody will look at, raw text too."""

    train: LabelledCorpus
    dev: LabelledCorpus
    test: LabelledCorpus
    dictionary: Dictionary
    raw: RawText
    untagged: Sequence[Sequence[str]]
    sources: Sequence[str]


def load_brown(mirror: Path | None, folder: Path, split: SplitSettings) -> Corpus:
    """The Brown corpus, cut by `split`; the sentences left over serve as raw text."""
    fetched = fetch("brown", mirror, folder)
    return _cut(map_tags(read_brown(folder), own_tagmap("en-brown"), "brown"), split, [_said(fetched)])


def load_turkish(mirror: Path | None, folder: Path, split: SplitSettings) -> Corpus:
    """The Turkish web and wiki treebanks, words joined from their groups, cut by `split`."""
    fetched = fetch("turkish", mirror, folder)
    corpus = read_word_groups(*fetched.paths)
    return _cut(map_tags(corpus, own_tagmap("tr-treebanks"), "turkish"), split, [_said(fetched)])


def load_twitter(mirror: Path | None, folder: Path) -> Corpus:
    """Oct27's train and dev parts, Daily547 as test, and raw tweets."""
    fetched, tweets = fetch("twitter", mirror, folder / "labelled"), fetch("raw-tweets", mirror, folder / "raw")
    tagmap = own_tagmap("en-tweet")
    splits = folder / "labelled" / "oct27.splits"
    train, dev, test = (
        normalise(map_tags(read_labelled(path), tagmap, path.name), "tweets")
        for path in (splits / "oct27.train", splits / "oct27.dev", folder / "labelled" / "daily547.conll")
    )
    return Corpus(train, dev, test, {}, RawText(tweets.paths, "tweets"), (), [_said(fetched), _said(tweets)])


def load_malagasy(mirror: Path | None, folder: Path, with_dictionary: bool) -> Corpus:
    """Garrette et al.'s four hours of Malagasy sentences; with the tag dictionary for type and token supervision."""
    fetched = fetch("malagasy", mirror, folder)
    tagmap = own_tagmap("mlg")
    train = map_tags(read_pairs(folder / "train" / "mlg-sentences-4hr-lc8.txt"), tagmap, "train")
    test = map_tags(read_pairs(folder / "test.txt"), tagmap, "test")
    dev = strip_tag_suffix(read_pairs(folder / "dev.txt"), "-H")
    dev = map_tags(dev, {**own_tagmap("mlg-dev-extra"), **tagmap}, "dev")
    dictionary: Dictionary = {}
    if with_dictionary:
        dictionary = map_dictionary(
            read_dictionary(folder / "train" / "mlg-tagdict-4hr-lc8.txt"), tagmap, "tag dictionary"
        )
    return Corpus(train, dev, test, dictionary, RawText((folder / "raw.txt",), "spaces"), (), [_said(fetched)])


def load_own(files: OwnFiles, style: Style, tagmap: TagMap | None) -> Corpus:
    """A corpus of one's own files; without a tag map its tags are used as they are."""

    def labelled(path: str) -> LabelledCorpus:
        corpus = read_labelled(path)
        return normalise(corpus if tagmap is None else map_tags(corpus, tagmap, path), style)

    dictionary: Dictionary = {} if files.dictionary is None else read_dictionary(files.dictionary)
    if tagmap is not None and files.dictionary is not None:
        dictionary = map_dictionary(dictionary, tagmap, files.dictionary)
    raw = read_raw(*files.raw, style=style) if files.raw else RawText((), style)
    parts = labelled(files.labelled), labelled(files.dev), labelled(files.test)
    return Corpus(*parts, dictionary, raw, (), ["own files"])


def training_subset(size: int, of: int, seed: int) -> list[int]:
    """Which of `of` sentences form the training set of `size` drawn with `seed`, in corpus order."""
    if size > of:
        raise InputError(f"training set of {size} sentences: the corpus has only {of} labelled ones")
    return sorted(np.random.default_rng(seed).permutation(of)[:size].tolist())


def _cut(corpus: LabelledCorpus, split: SplitSettings, sources: Sequence[str]) -> Corpus:
    needed = split.labelled + split.dev + split.test
    if needed > len(corpus):
        raise InputError(
            f"split: {needed} sentences wanted for labelled, dev and test, but the corpus has {len(corpus)}"
        )
    order = np.random.default_rng(split.seed).permutation(len(corpus)).tolist()
    cuts = np.cumsum([split.test, split.dev, split.labelled])
    test, dev, train = (corpus.subset(sorted(order[start:stop])) for start, stop in zip((0, *cuts), cuts, strict=False))
    rest = corpus.subset(sorted(order[needed:]))
    return Corpus(train, dev, test, {}, RawText(()), rest.words, sources)


def _said(fetched: Fetched) -> str:
    return f"{fetched.corpus}: {fetched.place}"
