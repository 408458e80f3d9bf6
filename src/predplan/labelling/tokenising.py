"""Raw text to token ids in blocks of bytes: no token spans white space, so each distinct chunk is tokenised once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from predplan.errors import InputError
from predplan.labelling import tweets
from predplan.labelling.chunks import NEWLINE, Bytes, ChunkedText, Places, Spans, ascii_ends, replace, split_chunks
from predplan.labelling.readers import RawText, Style, open_bytes
from predplan.labelling.sentences import LabelledCorpus, TokenBatch

BLOCK_BYTES = 8 << 20
LONGEST_LINE = 100_000  # characters
_UTF8_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class LineReport:
    """What a text held: all lines, its tokens, and the malformed lines that were dropped, by kind."""

    lines: int = 0
    tokens: int = 0
    bad_utf8: int = 0
    nul: int = 0
    too_long: int = 0

    @property
    def malformed(self) -> int:
        """Dropped lines of all kinds."""
        return self.bad_utf8 + self.nul + self.too_long

    def __add__(self, other: LineReport) -> LineReport:
        return LineReport(
            self.lines + other.lines,
            self.tokens + other.tokens,
            self.bad_utf8 + other.bad_utf8,
            self.nul + other.nul,
            self.too_long + other.too_long,
        )


def read_blocks(raw: RawText, block_bytes: int = BLOCK_BYTES) -> Iterator[bytes]:
    """The decompressed text in blocks that end with a line, of about `block_bytes`; files do not share a block.

    Memory stays bounded: of a line that is too long for the tokeniser only the beginning is kept.
    """
    for path in raw.paths:
        begun = b""
        with open_bytes(path) as stream:
            try:
                while data := stream.read(block_bytes):
                    whole, newline, rest = data.rpartition(b"\n")
                    if newline:
                        yield begun + whole + newline
                        begun = rest
                    else:
                        begun = (begun + data)[: 4 * LONGEST_LINE + 1]
            except OSError as error:
                raise InputError(f"{path}: cannot be read ({error}); is it cut short?") from error
        if begun:
            yield begun


def tokenise_block(block: bytes, style: Style) -> tuple[TokenBatch, LineReport]:
    """Tokens of a block's lines; see `split_block` and `tokenise_chunks`."""
    return tokenise_chunks(split_block(block), style)


def split_block(block: bytes) -> tuple[ChunkedText, LineReport]:
    """The chunks of a block's lines. Leaves the interpreter to other threads.

    Lines with NUL, bytes that are not UTF-8, or more than 100,000 characters are dropped and counted.
    """
    block = block.removeprefix(_UTF8_BOM)
    report = LineReport(lines=block.count(b"\n") + (not block.endswith(b"\n") and block != b""))
    if b"\0" in block or _longest_line(block) > LONGEST_LINE:
        block, dropped = _drop_malformed(block)
        report += dropped
    try:
        text = split_chunks(block)
    except UnicodeDecodeError:
        block, dropped = _drop_malformed(block)
        report += dropped
        text = split_chunks(block)
    return text, report


def tokenise_chunks(split: tuple[ChunkedText, LineReport], style: Style) -> tuple[TokenBatch, LineReport]:
    """Tokens of what `split_block` gives, and their number in the report. Pure, fit for worker processes.

    A line without tokens is no sentence. The vocabulary is in order of first appearance.
    """
    text, report = split
    batch = _expand(text, style)
    return batch, report + LineReport(tokens=len(batch.ids))


def tokenise(text: str, style: Style) -> list[str]:
    """The tokens of one sentence."""
    return [token for chunk in text.split() for token in _TOKENISERS[style](chunk)]


def normalise(corpus: LabelledCorpus, style: Style) -> LabelledCorpus:
    """The corpus with its words in the form in which `tokenise` gives those of raw text."""
    if style == "spaces":
        return corpus
    return LabelledCorpus(tuple(tuple(map(tweets.normalise, words)) for words in corpus.words), corpus.tags)


_TOKENISERS: dict[Style, Callable[[str], Sequence[str]]] = {"spaces": str.split, "tweets": tweets.tokenise_chunk}
_PLAIN_ENDS: dict[Style, Callable[[Bytes, Places, Places], Places]] = {
    "spaces": ascii_ends,
    "tweets": tweets.plain_ends,
}


def _expand(text: ChunkedText, style: Style) -> TokenBatch:
    """Replaces each chunk by the ids of its tokens, and counts line ends in tokens.

    A plain chunk is a word and what may follow it; only the other chunks are tokenised one by one.
    """
    chunks = text.distinct
    cuts = _PLAIN_ENDS[style](chunks.text, chunks.starts, chunks.ends)
    plain, followed = cuts >= 0, (cuts >= 0) & (cuts < chunks.ends)
    others = list(map(_TOKENISERS[style], chunks[~plain].decode()))
    sizes = 1 + followed.astype(np.int64)
    sizes[~plain] = np.fromiter(map(len, others), np.int64, len(others))
    ends = np.cumsum(sizes)
    kinds = np.repeat(np.where(plain, 0, 2).astype(np.int8), sizes)
    kinds[ends[followed] - 1] = 1
    words = Spans(chunks.text, chunks.starts[plain], cuts[plain])
    rests = Spans(chunks.text, cuts[followed], chunks.ends[followed])
    tokens = words + rests + Spans.of(list(chain.from_iterable(others)))
    in_order = np.empty(len(tokens), np.int64)
    in_order[np.argsort(kinds, kind="stable")] = np.arange(len(tokens))
    vocabulary, numbers = tokens[in_order].distinct()
    ids, line_ends = replace(text.ids, text.line_ends, numbers, ends)
    offsets = np.concatenate(([0], line_ends[np.diff(line_ends, prepend=0) > 0]))
    return TokenBatch(tuple(vocabulary.decode()), ids, offsets)


def _longest_line(block: bytes) -> int:
    """Bytes in the longest line."""
    ends = np.flatnonzero(np.frombuffer(block, np.uint8) == NEWLINE)
    return int(np.max(np.diff(ends, prepend=-1, append=len(block))))


def _drop_malformed(block: bytes) -> tuple[bytes, LineReport]:
    """The block without its malformed lines, and their number by kind; a line counts under the first kind that fits."""
    kept: list[bytes] = []
    faults = Counter[str]()
    for line in block.split(b"\n"):
        fault = _fault(line)
        if fault is None:
            kept.append(line)
        else:
            faults[fault] += 1
    return b"\n".join(kept), LineReport(**faults)


def is_malformed(line: bytes) -> bool:
    """Whether `split_block` drops the line."""
    return _fault(line) is not None


def _fault(line: bytes) -> str | None:
    """The field of LineReport that a malformed line counts under."""
    if b"\0" in line:
        return "nul"
    if len(line.decode(errors="replace")) > LONGEST_LINE:
        return "too_long"
    try:
        line.decode()
    except UnicodeDecodeError:
        return "bad_utf8"
    return None
