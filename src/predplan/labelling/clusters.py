"""Hierarchical word clusters from a file of bit paths (the CMU tagger's `6mpaths`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from predplan.errors import InputError
from predplan.labelling.readers import read_lines
from predplan.labelling.tweets import MENTION, URL

LENGTHS = tuple(range(2, 17, 2))  # of path prefixes, as Owoputi et al. 2013 use them
_COLUMNS = 3


def read_clusters(path: Path | str, lengths: tuple[int, ...] = LENGTHS) -> Mapping[str, tuple[str, ...]]:
    """Word -> the prefixes of its path, coarse to fine, from lines path<TAB>word<TAB>count.

    The file's own names for mentions and URLs (`<@MENTION>`, `<URL-host>`) become the normal forms of this tokeniser; a
    URL takes the path of the most frequent host. Words of the CMU file are in lower case.
    """
    paths: dict[str, str] = {}
    most = 0
    for number, line in enumerate(read_lines(path), 1):
        columns = line.split("\t")
        if not line.strip():
            continue
        if len(columns) != _COLUMNS or set(columns[0]) - {"0", "1"} or not columns[2].isdigit():
            raise InputError(f"{path}:{number}: found {line!r}; expected bits<TAB>word<TAB>count")
        bits, word, count = columns[0], columns[1], int(columns[2])
        if word == "<@MENTION>":
            paths[MENTION] = bits
        elif not word.startswith("<URL-"):
            paths[word] = bits
        elif count > most:
            paths[URL], most = bits, count
    return {word: _prefixes(bits, lengths) for word, bits in paths.items()}


def _prefixes(bits: str, lengths: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(bits[:length] for length in lengths))
