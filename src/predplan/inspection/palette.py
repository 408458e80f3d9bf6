"""Colours, the same wherever a thing is drawn: in recordings here, and in the report's figures.

The hues are Paul Tol's "vibrant" and "muted" schemes, chosen to stay apart for colour-blind readers
(https://sro.sron.nl/pault): bright ones for what the thesis proposes and for fields, earth and grey for the rest.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Mapping

BACKGROUND = "#0d0d0d"
"""The viewer's own background, so that pictures have no border."""
TEXT = "#d5d9dd"
FAINT = "#7d848c"
ACCENT = "#33bbee"
WARNING = "#ee7733"
SEQUENTIAL = "magma"
"""Colour map for shares and counts: dark is little."""
DIVERGING = (
    (0.0, "#235585"),
    (0.25, "#122c45"),
    (0.5, "#0d0d0d"),
    (0.65, "#803511"),
    (0.82, "#ee7733"),
    (1.0, "#ffe9c0"),
)
"""Colour map for values on both sides of zero, which is dark: blue below it, orange above."""

_METHODS: tuple[tuple[frozenset[str], str], ...] = tuple(
    (frozenset(words.split()), colour)
    for words, colour in (
        ("crf clusters posteriors", "#ee3377"),
        ("crf posteriors", "#0099dd"),
        ("crf clusters", "#009988"),
        ("crf", "#66ccee"),
        ("anchor fhmm", "#dd4422"),
        ("em fhmm", "#aa8844"),
        ("self training fhmm", "#88883a"),
        ("fhmm", "#7b8fa8"),
        ("anchor", "#ee7733"),
        ("em", "#ddcc77"),
        ("self training", "#bbcc66"),
        ("supervised", "#bbbbbb"),
    )
)
_PLAIN = frozenset(("hmm", "supervised"))
"""Words that a name may have or lack without a change of method."""
_OTHERS = ("#cc6677", "#88ccee", "#44aa99", "#117733", "#aa4499", "#ddcc77", "#999933", "#6688cc")


def method_colour(name: str) -> str:
    """Colour of a method as #rrggbb, a function of its name alone.

    A name that says which model and how it was trained ("anchor-fhmm", "crf-clusters") has that kind's colour, and
    further words in it a shade of that colour; any other name has one of eight further colours.
    """
    words = frozenset(re.findall(r"[a-z0-9]+", name.lower()))
    for kind, colour in _METHODS:
        if kind <= words:
            return _shade(colour, words - kind - _PLAIN)
    return _OTHERS[zlib.crc32(name.encode()) % len(_OTHERS)]


def method_colours(names: Iterable[str]) -> Mapping[str, str]:
    """The colour of each method."""
    return {name: method_colour(name) for name in names}


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of #rrggbb."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _shade(colour: str, words: frozenset[str]) -> str:
    """Mixed with black or white by an amount that the words decide; itself without words."""
    if not words:
        return colour
    amount = (-0.5, -0.35, -0.2, 0.2, 0.35, 0.5)[zlib.crc32(" ".join(sorted(words)).encode()) % 6]
    end = 255 if amount > 0 else 0
    mixed = (round(part + (end - part) * abs(amount)) for part in rgb(colour))
    return "#{:02x}{:02x}{:02x}".format(*mixed)
