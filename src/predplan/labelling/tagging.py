"""From a stream of sentences to tagged CoNLL-U, a batch of sentences at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice

from predplan.errors import InputError
from predplan.labelling.readers import CONLLU_COLUMNS

Predict = Callable[[Sequence[Sequence[str]]], Sequence[Sequence[str]]]
SENTENCES_AT_ONCE = 4096
UPOS = 3


@dataclass(frozen=True)
class Sentence:
    """Words, and the CoNLL-U lines they were read from, split at tabs; without lines the sentence was plain text."""

    words: Sequence[str]
    lines: Sequence[Sequence[str]] = ()

    def tagged(self, tags: Sequence[str]) -> str:
        """The sentence in CoNLL-U: its own lines with the tags as UPOS, or new ones; then a blank line."""
        if not self.lines:
            pairs = enumerate(zip(self.words, tags, strict=True), 1)
            return "".join(f"{place}\t{word}\t_\t{tag}\t_\t_\t_\t_\t_\t_\n" for place, (word, tag) in pairs) + "\n"
        remaining = iter(tags)
        rows = (
            [*line[:UPOS], next(remaining), *line[UPOS + 1 :]] if line[0].isdigit() else line for line in self.lines
        )
        return "\n".join(map("\t".join, rows)) + "\n\n"


def tag_lines(predict: Predict, lines: Iterable[bytes], name: str) -> Iterator[str]:
    """Tagged text, one string a batch, of lines that are a sentence each (tokens parted by spaces) or CoNLL-U.

    Raises InputError naming the line where it is not UTF-8, holds NUL, or is neither; and where there is no sentence.
    """
    sentences = read_sentences(lines, name)
    batch = list(islice(sentences, SENTENCES_AT_ONCE))
    if not batch:
        raise InputError(f"{name}: found no sentence; expected one a line, tokens separated by spaces, or CoNLL-U")
    while batch:
        tags = predict([sentence.words for sentence in batch])
        yield "".join(sentence.tagged(of) for sentence, of in zip(batch, tags, strict=True))
        batch = list(islice(sentences, SENTENCES_AT_ONCE))


def read_sentences(lines: Iterable[bytes], name: str) -> Iterator[Sentence]:
    """Sentences of a stream; the first line that is not blank and no comment tells CoNLL-U from plain text."""
    numbered = ((number, _decoded(line, f"{name}:{number}")) for number, line in enumerate(lines, 1))
    begun: list[tuple[int, str]] = []
    for number, line in numbered:
        begun.append((number, line))
        if line.strip() and not line.startswith("#"):
            read = _read_conllu if line.count("\t") + 1 == CONLLU_COLUMNS else _read_plain
            yield from read(chain(begun, numbered), name)
            return
    yield from _read_plain(begun, name)


def _read_plain(lines: Iterable[tuple[int, str]], name: str) -> Iterator[Sentence]:
    for number, line in lines:
        if "\t" in line:
            raise InputError(
                f"{name}:{number}: found a tab; expected tokens separated by spaces, or CoNLL-U of 10 columns"
            )
        words = line.split()
        if words:
            yield Sentence(words)


def _read_conllu(lines: Iterable[tuple[int, str]], name: str) -> Iterator[Sentence]:
    rows: list[list[str]] = []
    for number, line in chain(lines, [(0, "")]):
        if line.strip():
            columns = [line] if line.startswith("#") and "\t" not in line else line.split("\t")
            if len(columns) != CONLLU_COLUMNS and not line.startswith("#"):
                raise InputError(
                    f"{name}:{number}: found {len(columns)} columns, expected the {CONLLU_COLUMNS} of CoNLL-U"
                )
            if columns[0].isdigit() and not columns[1]:
                raise InputError(f"{name}:{number}: found no word in the second column")
            rows.append(columns)
        elif rows:
            words = [columns[1] for columns in rows if columns[0].isdigit()]
            if words:
                yield Sentence(words, rows)
            rows = []


def _decoded(line: bytes, where: str) -> str:
    try:
        text = line.decode()
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise InputError(f"{where}: byte 0x{byte:02x} is not UTF-8; expected UTF-8 throughout") from error
    if "\0" in text:
        raise InputError(f"{where}: found a NUL character")
    return text.removeprefix("\ufeff").rstrip("\r\n")
