"""Labelled text, dictionaries and tokenised text from the formats of the field; faults are named by file and line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal, get_args

import pyarrow as pa

from predplan.errors import InputError
from predplan.labelling.sentences import LabelledCorpus

Style = Literal["spaces", "tweets"]
Sentence = tuple[tuple[str, ...], tuple[str | None, ...]]

CONLLU_COLUMNS = 10
UNLABELLED = "_"


@dataclass(frozen=True)
class RawText:
    """Raw files, one sentence a line (plain, gzip or zstd), and how their lines become tokens."""

    paths: tuple[Path, ...]
    style: Style = "spaces"


def read_labelled(path: Path | str) -> LabelledCorpus:
    """CoNLL-U (FORM, UPOS), or two columns token<TAB>tag; blank lines part sentences; the tag `_` becomes None.

    In CoNLL-U, comments, multiword-token lines (`1-2`) and empty nodes (`8.1`) are passed over.
    Raises InputError with file and line for an empty file, a wrong number of columns, a label without word,
    a word without label, text that is not UTF-8, and NUL.
    """
    lines = read_lines(path)
    conllu = _is_conllu(lines, path)
    rows: list[tuple[str, str | None]] = []
    sentences: list[Sentence] = []
    for number, line in enumerate([*lines, ""], 1):
        if not line.strip():
            if rows:
                words, tags = zip(*rows, strict=True)
                sentences.append((words, tags))
                rows = []
        elif not conllu:
            rows.append(_two_columns(line, f"{path}:{number}"))
        elif not line.startswith("#"):
            columns = _conllu_columns(line, f"{path}:{number}")
            if columns[0].isdigit():
                rows.append((columns[1], None if columns[3] == UNLABELLED else columns[3]))
    return _corpus(sentences, path)


def read_pairs(*paths: Path | str, separator: str = "|") -> LabelledCorpus:
    """One sentence a line of word|tag, split at each pair's last separator (so `@:|:` is the word `@:`)."""
    sentences: list[Sentence] = []
    for path in paths:
        for number, line in enumerate(read_lines(path), 1):
            pairs = [_pair(item, separator, f"{path}:{number}") for item in line.split()]
            if pairs:
                words, tags = zip(*pairs, strict=True)
                sentences.append((words, tags))
    return _corpus(sentences, paths[0] if paths else "no file")


def read_brown(folder: Path | str) -> LabelledCorpus:
    """The Brown corpus: files ca01 to cr09 of word/tag; tags in upper case, as the published map has them."""
    paths = sorted(Path(folder).glob("c[a-r][0-9][0-9]"))
    if not paths:
        raise InputError(f"{folder}: no file of the Brown corpus found; expected ca01 to cr09")
    corpus = read_pairs(*paths, separator="/")
    return LabelledCorpus(corpus.words, tuple(tuple(tag and tag.upper() for tag in tags) for tags in corpus.tags))


def read_word_groups(*paths: Path | str) -> LabelledCorpus:
    """CoNLL-U of inflectional groups (turkish-treebanks): rows joined by the relation `ig` form one word.

    A row of relation `ig` and the row after it are groups of one word, whose tag is that of its last group
    (column 4, the coarse tag).
    """
    sentences: list[Sentence] = []
    for path in paths:
        words: list[str] = []
        tags: list[str | None] = []
        begun = ""
        for number, line in enumerate([*read_lines(path), ""], 1):
            if not line.strip():
                if begun:
                    raise InputError(f"{path}:{number}: the sentence ends within the word {begun!r} (relation ig)")
                if words:
                    sentences.append((tuple(words), tuple(tags)))
                words, tags = [], []
            elif not line.startswith("#"):
                columns = _conllu_columns(line, f"{path}:{number}")
                begun += columns[1]
                if columns[7] != "ig":
                    words.append(begun)
                    tags.append(columns[3])
                    begun = ""
    return _corpus(sentences, paths[0] if paths else "no file")


def read_dictionary(path: Path | str) -> Mapping[str, frozenset[str]]:
    """Word -> its possible tags, from word<TAB>tag lines or from word|tag items parted by white space."""
    tags: dict[str, set[str]] = {}
    lines = read_lines(path)
    tabbed = "\t" in next((line for line in lines if line.strip()), "")
    for number, line in enumerate(lines, 1):
        where = f"{path}:{number}"
        if tabbed:
            entries = [_two_columns(line, where)] if line.strip() else []
        else:
            entries = [_pair(item, "|", where) for item in line.split()]
        for word, tag in entries:
            if tag is not None:
                tags.setdefault(word, set()).add(tag)
    if not tags:
        raise InputError(f"{path}: no entry found; expected word<TAB>tag lines or word|tag items")
    return {word: frozenset(found) for word, found in tags.items()}


def read_letter_dictionary(path: Path | str) -> Mapping[str, frozenset[str]]:
    """The CMU tagger's dictionary: word<TAB>one-letter tags without space between.

    Passed over: its metaphone keys (`**MP**...`), and the `null` and `not` that its published file has among the tags.
    """
    letters: dict[str, frozenset[str]] = {}
    for word, entries in read_dictionary(path).items():
        found = frozenset("".join(entry.replace("null", "").replace("not", "") for entry in entries))
        if found and not word.startswith("**MP**"):
            letters[word] = found
    return letters


def read_tokenised(path: Path | str) -> tuple[tuple[str, ...], ...]:
    """One sentence a line, tokens parted by white space; blank lines are passed over."""
    sentences = tuple(tuple(line.split()) for line in read_lines(path) if line.strip())
    if not sentences:
        raise InputError(f"{path}: no sentence found; expected one sentence a line, tokens separated by spaces")
    return sentences


def read_raw(*paths: Path | str, style: Style = "spaces") -> RawText:
    """Names raw files, one sentence a line, for the tokeniser; they are read when it runs."""
    if not paths:
        raise InputError("raw text: no file named; expected one or more files, one sentence a line")
    if style not in get_args(Style):
        raise InputError(f"raw text: unknown style {style!r}; expected one of {', '.join(get_args(Style))}")
    for path in paths:
        with open_bytes(path) as stream:
            if not stream.read(1):
                raise InputError(f"{path}: the file is empty; expected one sentence a line")
    return RawText(tuple(Path(path) for path in paths), style)


def open_bytes(path: Path | str) -> IO[bytes]:
    """The decompressed bytes of a plain, gzip or zstd file, told apart by their first bytes."""
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file")
    with open(path, "rb") as file:
        head = file.read(4)
    compression = "gzip" if head.startswith(b"\x1f\x8b") else "zstd" if head == b"\x28\xb5\x2f\xfd" else None
    stream: IO[bytes] = pa.input_stream(str(path), compression=compression)
    return stream


def read_lines(path: Path | str) -> list[str]:
    """The lines of a small text file; raises InputError with the line of the first NUL or byte that is not UTF-8."""
    try:
        with open_bytes(path) as stream:
            data = stream.read()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}); is it cut short?") from error
    if not data.strip():
        raise InputError(f"{path}: the file is empty")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        byte = error.object[error.start]
        raise InputError(f"{path}:{line}: byte 0x{byte:02x} is not UTF-8; expected UTF-8 throughout") from error
    if "\0" in text:
        raise InputError(f"{path}:{text.count(chr(10), 0, text.index(chr(0))) + 1}: found a NUL character")
    return [line.removesuffix("\r") for line in text.split("\n")]


def _is_conllu(lines: list[str], path: Path | str) -> bool:
    for number, line in enumerate(lines, 1):
        if line.strip() and not line.startswith("# "):
            columns = line.count("\t") + 1
            if columns in (2, CONLLU_COLUMNS):
                return columns == CONLLU_COLUMNS
            if not line.startswith("#"):
                raise InputError(f"{path}:{number}: found {_columns(columns)}; expected token<TAB>tag or CoNLL-U")
    raise InputError(f"{path}: no labelled word found")


def _two_columns(line: str, where: str) -> tuple[str, str | None]:
    columns = line.split("\t")
    if len(columns) != 2:
        raise InputError(f"{where}: found {_columns(len(columns))}; expected token<TAB>tag")
    word, tag = (column.strip(" ") for column in columns)
    return _labelled(word, tag, where)


def _pair(item: str, separator: str, where: str) -> tuple[str, str | None]:
    word, found, tag = item.rpartition(separator)
    if not found:
        raise InputError(f"{where}: {item!r} has no tag; expected word{separator}tag")
    return _labelled(word, tag, where)


def _labelled(word: str, tag: str, where: str) -> tuple[str, str | None]:
    if not word:
        raise InputError(f"{where}: the label {tag!r} has no word")
    if not tag:
        raise InputError(f"{where}: the word {word!r} has no label; write {UNLABELLED} for an unlabelled word")
    return word, None if tag == UNLABELLED else tag


def _conllu_columns(line: str, where: str) -> list[str]:
    columns = line.split("\t")
    if len(columns) != CONLLU_COLUMNS:
        raise InputError(f"{where}: found {_columns(len(columns))}; expected the {CONLLU_COLUMNS} of CoNLL-U")
    if not columns[0].replace("-", "", 1).replace(".", "", 1).isdigit():
        raise InputError(f"{where}: the first column is {columns[0]!r}; expected a word's number (1, 1-2 or 8.1)")
    if columns[0].isdigit():
        _labelled(columns[1], columns[3], where)
    return columns


def _columns(count: int) -> str:
    return "one column" if count == 1 else f"{count} columns"


def _corpus(sentences: list[Sentence], path: Path | str) -> LabelledCorpus:
    if not sentences:
        raise InputError(f"{path}: no labelled sentence found")
    words, tags = zip(*sentences, strict=True)
    return LabelledCorpus(words, tags)
