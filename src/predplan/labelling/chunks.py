"""A block of text as numbers of its distinct chunks (runs of characters between ASCII white space).

Every byte passes through here, so it is compiled, and leaves the interpreter to other threads. First all spans of bytes
are found, then their keys, then their numbers: in separate loops, a processor waits for memory less often.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Ids = NDArray[np.int32]
Places = NDArray[np.int32]
Ends = NDArray[np.int64]
Keys = NDArray[np.uint64]
Marks = NDArray[np.bool_]
Compiled = TypeVar("Compiled", bound=Callable[..., Any])

NEWLINE = 10
_SPACES = np.array([byte < 128 and chr(byte).isspace() for byte in range(256)])
_KEY_BYTES = 7  # of a span that is its own key; the keys of longer ones have the highest bit
_LONG = np.uint64(1 << 63)
_PRIME = np.uint64(0x100000001B3)  # FNV-1a's
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # spreads keys over a table (Knuth's multiplicative hashing)
_SMALLEST_TABLE = 10  # bits of a place in it


@dataclass(frozen=True)
class Spans:
    """Span i is text[starts[i]:ends[i]], and holds no NUL."""

    text: Bytes
    starts: Places
    ends: Places

    @classmethod
    def of(cls, strings: Sequence[str]) -> Spans:
        """Strings without NUL as spans of UTF-8."""
        text = np.frombuffer(bytearray("\0".join([*strings, ""]).encode()), np.uint8)
        ends = np.flatnonzero(text == 0).astype(np.int32)
        return cls(text, ends - np.diff(ends, prepend=np.int32(-1)) + 1, ends)

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, which: NDArray[Any]) -> Spans:
        """Some spans, in a text of their own."""
        starts, ends = self.starts[which], self.ends[which]
        new_ends = np.cumsum(ends - starts + 1, dtype=np.int32) - 1
        return Spans(_join(self.text, starts, ends), new_ends - (ends - starts), new_ends)

    def __add__(self, other: Spans) -> Spans:
        shift = np.int32(len(self.text))
        return Spans(
            np.concatenate((self.text, other.text)),
            np.concatenate((self.starts, other.starts + shift)),
            np.concatenate((self.ends, other.ends + shift)),
        )

    def decode(self) -> list[str]:
        """The spans as strings; raises UnicodeDecodeError where one is not UTF-8."""
        return _join(self.text, self.starts, self.ends).tobytes().decode().split("\0")[:-1]

    def distinct(self) -> tuple[Spans, Ids]:
        """The distinct spans in order of appearance, and for each span the number of its like among them."""
        ids, first = _number(self.text, self.starts, self.ends, _keys(self.text, self.starts, self.ends))
        return self[first], ids


@dataclass(frozen=True)
class ChunkedText:
    """distinct: the chunks in order of appearance; ids [chunks] index it; line l ends before chunk line_ends[l]."""

    distinct: Spans
    ids: Ids
    line_ends: Ends


def split_chunks(block: bytes) -> ChunkedText:
    """The chunks of a block's lines. The block is shorter than 2 GiB and holds no NUL.

    Raises UnicodeDecodeError where the block is not UTF-8.
    """
    text = np.full(len(block) + 1, NEWLINE, np.uint8)
    text[:-1] = np.frombuffer(block, np.uint8)
    starts, ends, line_ends = _find(text, _SPACES)
    distinct, ids = Spans(text, starts, ends).distinct()
    distinct.text.tobytes().decode()
    return ChunkedText(distinct, ids, line_ends)


def compiled(function: Compiled) -> Compiled:
    """The function compiled by numba; leaves the interpreter to other threads."""
    return cast(Compiled, numba.njit(cache=True, nogil=True)(function))


@compiled
def _find(text: Bytes, spaces: Marks) -> tuple[Places, Places, Ends]:
    """Where runs between `spaces` start and end in a text that ends with a newline; runs up to each line's end."""
    runs = lines = 0
    for place in range(text.size):
        runs += spaces[text[place]] and place > 0 and not spaces[text[place - 1]]
        lines += text[place] == NEWLINE
    starts = np.empty(runs, np.int32)
    ends = np.empty(runs, np.int32)
    line_ends = np.empty(lines, np.int64)
    count = lines = 0
    inside = False
    for place in range(text.size):
        byte = text[place]
        if not spaces[byte]:
            if not inside:
                starts[count] = place
                inside = True
            continue
        if inside:
            ends[count] = place
            count += 1
            inside = False
        if byte == NEWLINE:
            line_ends[lines] = count
            lines += 1
    return starts, ends, line_ends


@compiled
def _keys(text: Bytes, starts: Places, ends: Places) -> Keys:
    keys = np.empty(starts.size, np.uint64)
    for i in range(starts.size):
        key = np.uint64(0)
        for place in range(starts[i], min(ends[i], starts[i] + _KEY_BYTES)):
            key = (key << np.uint64(8)) | np.uint64(text[place])
        for place in range(starts[i] + _KEY_BYTES, ends[i]):
            key = ((key ^ np.uint64(text[place])) * _PRIME) | _LONG
        keys[i] = key
    return keys


@compiled
def _number(text: Bytes, starts: Places, ends: Places, keys: Keys) -> tuple[Ids, Places]:
    """A hash table with open addressing, of the spans seen. Long spans with equal keys are compared."""
    ids = np.empty(keys.size, np.int32)
    bits = _SMALLEST_TABLE
    while 4 << bits < keys.size:
        bits += 1
    first = np.empty(1 << bits, np.int32)
    table = np.full(1 << bits, -1, np.int32)
    table_keys = np.empty(1 << bits, np.uint64)
    distinct = 0
    for i in range(keys.size):
        key = keys[i]
        slot = (key * _GOLDEN) >> np.uint64(64 - bits)
        while table[slot] >= 0:
            if table_keys[slot] == key:
                if key < _LONG:
                    break
                start = starts[first[table[slot]]]
                size = ends[i] - starts[i]
                if ends[first[table[slot]]] - start == size:
                    same = 0
                    while same < size and text[start + same] == text[starts[i] + same]:
                        same += 1
                    if same == size:
                        break
            slot = (slot + np.uint64(1)) & np.uint64(table.size - 1)
        if table[slot] < 0:
            table[slot] = distinct
            table_keys[slot] = key
            first[distinct] = i
            distinct += 1
        ids[i] = table[slot]
        if 2 * distinct > table.size:
            bits += 1
            first = np.concatenate((first, np.empty_like(first)))
            table = np.full(1 << bits, -1, np.int32)
            table_keys = np.empty(1 << bits, np.uint64)
            for number in range(distinct):
                slot = (keys[first[number]] * _GOLDEN) >> np.uint64(64 - bits)
                while table[slot] >= 0:
                    slot = (slot + np.uint64(1)) & np.uint64(table.size - 1)
                table[slot] = number
                table_keys[slot] = keys[first[number]]
    return ids, first[:distinct]


@compiled
def _join(text: Bytes, starts: Places, ends: Places) -> Bytes:
    """The spans, each followed by NUL."""
    joined = np.empty(np.sum(ends - starts) + starts.size, np.uint8)
    place = 0
    for i in range(starts.size):
        for byte in text[starts[i] : ends[i]]:
            joined[place] = byte
            place += 1
        joined[place] = 0
        place += 1
    return joined


@compiled
def ascii_ends(text: Bytes, starts: Places, ends: Places) -> Places:
    """The end of each span that is ASCII, -1 for the others."""
    found = ends.copy()
    for i in range(starts.size):
        for byte in text[starts[i] : ends[i]]:
            if byte >= 128:
                found[i] = -1
    return found


@compiled
def replace(ids: Ids, line_ends: Ends, parts: Ids, part_ends: Ends) -> tuple[Ids, Ends]:
    """Each id i replaced by its parts, parts[part_ends[i - 1] : part_ends[i]]; and line ends counted in parts."""
    total = 0
    for number in ids:
        total += part_ends[number] - (part_ends[number - 1] if number else 0)
    replaced = np.empty(total, np.int32)
    new_line_ends = np.empty_like(line_ends)
    place = before = 0
    for line in range(line_ends.size):
        for number in ids[before : line_ends[line]]:
            for part in range(part_ends[number - 1] if number else 0, part_ends[number]):
                replaced[place] = parts[part]
                place += 1
        before = line_ends[line]
        new_line_ends[line] = place
    return replaced, new_line_ends
