"""A block of text as ids of its distinct chunks (runs of characters between ASCII white space), in one pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ids = NDArray[np.int32]
Places = NDArray[np.int64]

NEWLINE = 10
_SPACES = np.array([byte < 128 and chr(byte).isspace() for byte in range(256)])


@dataclass(frozen=True)
class ChunkedText:
    """distinct: the chunks in order of appearance; ids [chunks] index it; line l ends before chunk line_ends[l]."""

    distinct: list[str]
    ids: Ids
    line_ends: Places


def split_chunks(block: bytes) -> ChunkedText:
    """The chunks of a block's lines; raises UnicodeDecodeError where the block is not UTF-8."""
    ids, starts, ends, line_ends = _compiled_intern(np.frombuffer(block + b"\n", np.uint8), _SPACES)
    spans = zip(starts.tolist(), ends.tolist(), strict=True)
    joined = b"\n".join([block[start:end] for start, end in spans])
    return ChunkedText(joined.decode().split("\n") if joined else [], ids, line_ends)


def _intern(text: NDArray[np.uint8], spaces: NDArray[np.bool_]) -> tuple[Ids, Places, Places, Places]:
    """Chunks of bytes [n], of which the last is a newline: a hash table (FNV-1a, open addressing) of those seen.

    Gives for each place its chunk; where each distinct chunk first starts and ends; chunks up to each line's end.
    """
    ids = np.empty(text.size // 2 + 1, np.int32)
    line_ends = np.empty(np.sum(text == NEWLINE), np.int64)
    starts = np.empty(1 << 15, np.int64)
    ends = np.empty(1 << 15, np.int64)
    hashes = np.empty(1 << 15, np.uint64)
    table = np.full(1 << 16, -1, np.int32)
    count = distinct = lines = 0
    begin = -1
    key = np.uint64(0)
    for place in range(text.size):
        byte = text[place]
        if not spaces[byte]:
            if begin < 0:
                begin = place
                key = np.uint64(0xCBF29CE484222325)
            key = (key ^ np.uint64(byte)) * np.uint64(0x100000001B3)
            continue
        if begin >= 0:
            mask = np.uint64(table.size - 1)
            slot = (key ^ (key >> np.uint64(32))) & mask
            while table[slot] >= 0:
                other = table[slot]
                if hashes[other] == key and ends[other] - starts[other] == place - begin:
                    same = 0
                    while same < place - begin and text[starts[other] + same] == text[begin + same]:
                        same += 1
                    if same == place - begin:
                        break
                slot = (slot + np.uint64(1)) & mask
            if table[slot] < 0:
                if distinct == starts.size:
                    starts = np.concatenate((starts, np.empty_like(starts)))
                    ends = np.concatenate((ends, np.empty_like(ends)))
                    hashes = np.concatenate((hashes, np.empty_like(hashes)))
                starts[distinct], ends[distinct], hashes[distinct] = begin, place, key
                table[slot] = distinct
                distinct += 1
            ids[count] = table[slot]
            count += 1
            begin = -1
            if 2 * distinct > table.size:
                table = np.full(2 * table.size, -1, np.int32)
                mask = np.uint64(table.size - 1)
                for index in range(distinct):
                    slot = (hashes[index] ^ (hashes[index] >> np.uint64(32))) & mask
                    while table[slot] >= 0:
                        slot = (slot + np.uint64(1)) & mask
                    table[slot] = index
        if byte == NEWLINE:
            line_ends[lines] = count
            lines += 1
    return ids[:count], starts[:distinct], ends[:distinct], line_ends


_compiled_intern: Callable[[NDArray[np.uint8], NDArray[np.bool_]], tuple[Ids, Places, Places, Places]] = njit(
    cache=True, nogil=True
)(_intern)
