"""Markdown as the viewer shows it: tables of values, and what an artifact was made of."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from predplan.artifacts.provenance import Provenance

_MARKUP = re.compile(r"([\\`*_{}\[\]<>#|~!$&^:+.-])")


def escape(text: str) -> str:
    """Text that Markdown shows as it stands."""
    return _MARKUP.sub(r"\\\1", text.replace("\n", " "))


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
        return " ".join(cell(part) for part in value)
    return escape(str(value))


def _flat(prefix: str, value: Any) -> Iterable[tuple[str, str]]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _flat(f"{prefix}.{name}" if prefix else str(name), part)
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value)) or "none"
    elif value is not None:
        yield prefix, str(value)
