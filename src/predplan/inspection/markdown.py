"""Markdown as the viewer shows it: tables of values, and what an artifact was made of."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from predplan.artifacts.provenance import Provenance

LONGEST_LIST = 14

# What Inter draws, the one font the viewer has for text: it may stop working where it meets anything else.
_DRAWN = (
    (0x20, 0x7E),
    (0xA0, 0x148),
    (0x14A, 0x1C3),
    (0x1C5, 0x31E),
    (0x384, 0x3E1),
    (0x400, 0x49D),
    (0x4A0, 0x4FF),
    (0x1E00, 0x1FFF),
    (0x2010, 0x2027),
    (0x2030, 0x205E),
    (0x20A0, 0x20BF),
    (0x2190, 0x2199),
)
_MARKUP = re.compile(r"([\\`*_{}\[\]<>#|~!$&^:+.-])")


def escape(text: str) -> str:
    """Text that Markdown shows as it stands, as far as the viewer can draw it."""
    return _MARKUP.sub(r"\\\1", viewable(text))


def viewable(text: str) -> str:
    """Text with every character that the viewer cannot draw as its code point, and white space as spaces."""
    return "".join(_drawn(character) for character in text)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> str:
    """A Markdown table of cells that are Markdown already; the columns named in `right` stand to the right."""
    rule = ["--:" if name in right else ":--" for name in header]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))


def about(title: str, explanation: str, provenance: Provenance | None, *further: str) -> str:
    """The panel of a page: its title, what one sees, more of that, and where it came from."""
    parts = [f"# {escape(title)}", explanation, *further]
    if provenance is not None:
        parts += ["### Made from", provenance_table(provenance)]
    return "\n\n".join(part for part in parts if part) + "\n"


def provenance_table(provenance: Provenance) -> str:
    """Version, seed, settings by dotted name, and inputs by the start of their hash."""
    rows = [
        ("predplan", escape(provenance.version)),
        ("seed", "none" if provenance.seed is None else f"{provenance.seed}"),
    ]
    rows += [(escape(name), escape(value)) for name, value in _flat("", provenance.params)]
    rows += [(escape(name), f"`{digest[:12]}`") for name, digest in provenance.upstream.items()]
    return markdown_table(("setting or input", "value"), rows)


def cell(value: Any) -> str:
    """A value of a table, short, as Markdown."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, list):
        parts = [f"{part:.3f}" if isinstance(part, float) else cell(part) for part in value[:LONGEST_LIST]]
        return " ".join(parts if len(value) <= LONGEST_LIST else [*parts, "…"])
    return escape(str(value))


def _drawn(character: str) -> str:
    code = ord(character)
    if any(low <= code <= high for low, high in _DRAWN) and unicodedata.category(character) != "Cn":
        return character
    return " " if character.isspace() else f"‹{code:X}›"


def _flat(prefix: str, value: Any) -> Iterable[tuple[str, str]]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _flat(f"{prefix}.{name}" if prefix else str(name), part)
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value)) or "none"
    elif value is not None:
        yield prefix, str(value)
