"""Maps from a corpus's own tags to the 12 universal tags (Petrov, Das and McDonald 2011)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from predplan.errors import InputError
from predplan.labelling.readers import read_lines
from predplan.labelling.sentences import UNIVERSAL_TAGS, LabelledCorpus

TagMap = Mapping[str, str]


def read_tagmap(*paths: Path | str) -> TagMap:
    """Tag -> universal tag, from lines tag<TAB>universal tag; several files are joined and may not disagree."""
    tagmap: dict[str, str] = {}
    for path in paths:
        for number, line in enumerate(read_lines(path), 1):
            if not line.strip():
                continue
            tag, _, universal = line.partition("\t")
            if not tag or universal not in UNIVERSAL_TAGS:
                expected = f"tag<TAB>universal tag, one of {' '.join(UNIVERSAL_TAGS)}"
                raise InputError(f"{path}:{number}: found {line!r}; expected {expected}")
            if tagmap.setdefault(tag, universal) != universal:
                raise InputError(f"{path}:{number}: {tag} is mapped to {universal}, but before to {tagmap[tag]}")
    return tagmap


def own_tagmap(*names: str) -> TagMap:
    """The package's own maps by name, joined: en-brown, en-ptb, en-tweet, mlg, mlg-dev-extra, tr-treebanks, ud, ..."""
    folder = Path(str(files("predplan.labelling") / "maps"))
    known = sorted(path.stem for path in folder.glob("*.map"))
    for name in names:
        if name not in known:
            raise InputError(f"tag map: no map is named {name!r}; expected one of {', '.join(known)}, or a file")
    return read_tagmap(*(folder / f"{name}.map" for name in names))


def map_tags(corpus: LabelledCorpus, tagmap: TagMap, name: str) -> LabelledCorpus:
    """The corpus with each tag mapped (None stays None); raises InputError that lists all unmapped tags with counts."""
    _check_mapped(Counter(tag for tags in corpus.tags for tag in tags if tag is not None), tagmap, name)
    mapped = tuple(tuple(None if tag is None else tagmap[tag] for tag in tags) for tags in corpus.tags)
    return LabelledCorpus(corpus.words, mapped)


def map_dictionary(dictionary: Mapping[str, frozenset[str]], tagmap: TagMap, name: str) -> Mapping[str, frozenset[str]]:
    """The tag dictionary with each tag mapped; raises as `map_tags` does."""
    _check_mapped(Counter(tag for tags in dictionary.values() for tag in tags), tagmap, name)
    return {word: frozenset(tagmap[tag] for tag in tags) for word, tags in dictionary.items()}


def strip_tag_suffix(corpus: LabelledCorpus, suffix: str) -> LabelledCorpus:
    """The corpus with `suffix` taken off every tag that ends in it (the Malagasy dev file marks heads with `-H`)."""
    tags = tuple(tuple(tag and tag.removesuffix(suffix) for tag in tags) for tags in corpus.tags)
    return LabelledCorpus(corpus.words, tags)


def _check_mapped(counts: Counter[str], tagmap: TagMap, name: str) -> None:
    unmapped = sorted((-count, tag) for tag, count in counts.items() if tag not in tagmap)
    if unmapped:
        listed = ", ".join(f"{tag} ({-count})" for count, tag in unmapped)
        raise InputError(f"{name}: the tag map lacks {len(unmapped)} of its tags, with their counts: {listed}")
