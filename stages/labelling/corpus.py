"""Fetch a corpus, map its tags, cut it into parts; test labels go to a file that only the evaluation reads."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Iterable
from pathlib import Path

from predplan.artifacts.files import write_json, write_whole
from predplan.artifacts.tables import write_table
from predplan.errors import InputError
from predplan.labelling import corpora
from predplan.labelling.languages import keep_language
from predplan.labelling.readers import RawText
from predplan.labelling.tables import DICTIONARY, UNTAGGED, write_corpus
from predplan.labelling.tagmaps import read_tagmap
from predplan.labelling.tokenising import read_blocks
from stages.common import CorpusStage, mirror_folder, run_stage


def main(stage: CorpusStage) -> None:
    corpus = load(stage)
    provenance = stage.provenance(corpus=stage.corpus)
    write_corpus(stage.path("train.parquet"), corpus.train, provenance)
    write_corpus(stage.path("dev.parquet"), corpus.dev, provenance)
    write_corpus(stage.path("test_gold.parquet"), corpus.test, provenance)
    write_table(stage.path("test_words.parquet"), UNTAGGED, {"words": list(corpus.test.words)}, provenance)
    entries = [(word, tag) for word, tags in sorted(corpus.dictionary.items()) for tag in sorted(tags)]
    columns = {"word": [word for word, _ in entries], "tag": [tag for _, tag in entries]}
    write_table(stage.path("dictionary.parquet"), DICTIONARY, columns, provenance)
    write_raw(stage, corpus)
    parts = {"train": corpus.train, "dev": corpus.dev, "test": corpus.test}
    write_json(
        stage.path("corpus.json"),
        {
            "sources": list(corpus.sources),
            "parts": {
                name: {"sentences": len(part), "tokens": sum(map(len, part.words))} for name, part in parts.items()
            },
            "dictionary_entries": len(entries),
        },
    )


def load(stage: CorpusStage) -> corpora.Corpus:
    """The corpus its settings describe."""
    mirror, folder, settings = mirror_folder(), stage.path("fetched"), stage.corpus
    folder.mkdir(parents=True, exist_ok=True)  # DVC expects it, even where nothing is fetched
    if settings.source == "twitter":
        return corpora.load_twitter(mirror, folder)
    if settings.source == "malagasy":
        return corpora.load_malagasy(mirror, folder, settings.dictionary)
    if settings.source == "files":
        if settings.files is None:
            raise InputError(f"labelling.corpora.{stage.name}.files: missing; source files needs the paths")
        tagmap = None if settings.tagmap is None else read_tagmap(settings.tagmap)
        return corpora.load_own(settings.files, settings.style, tagmap)
    if settings.split is None:
        raise InputError(
            f"labelling.corpora.{stage.name}.split: missing; source {settings.source} has no parts of its own"
        )
    load_cut = corpora.load_brown if settings.source == "brown" else corpora.load_turkish
    return load_cut(mirror, folder, settings.split)


def write_raw(stage: CorpusStage, corpus: corpora.Corpus) -> None:
    """Raw text: the files that came with the corpus, the sentences without labels, the labelled ones' words.

    Files are taken as they are, or their lines of some languages; what is malformed in them the tokeniser counts.
    """
    folder = stage.path("raw")
    folder.mkdir(parents=True, exist_ok=True)
    for number, path in enumerate(corpus.raw.paths):
        if stage.corpus.languages:
            target = folder / f"{number:03d}-{path.name.removesuffix('.gz')}.gz"
            blocks = read_blocks(RawText((path,)))
            lines = (line for block in blocks for line in block.removesuffix(b"\n").split(b"\n"))
            _write_lines(target, keep_language(lines, stage.corpus.languages))
        else:
            with write_whole(folder / f"{number:03d}-{path.name}") as temporary:
                shutil.copyfile(path, temporary)
    for name, sentences in (("untagged", corpus.untagged), ("labelled", corpus.train.words)):
        _write_lines(folder / f"{name}.txt.gz", (" ".join(words).encode() for words in sentences))


def _write_lines(path: Path, lines: Iterable[bytes]) -> None:
    with write_whole(path) as temporary, temporary.open("wb") as plain, gzip.GzipFile("", "wb", 6, plain, 0) as file:
        for line in lines:
            file.write(line + b"\n")


if __name__ == "__main__":
    run_stage(CorpusStage, main)
