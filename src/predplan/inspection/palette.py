"""Colours of the pages; those of the methods are `predplan.palette`'s, the same as in the report."""

from __future__ import annotations

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


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of #rrggbb."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
