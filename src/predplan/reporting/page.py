"""The report as one HTML file that needs nothing else: styles and figures are inside it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from predplan.reporting.document import Cell, Section
from predplan.reporting.drawing import inlined


def to_page(title: str, summary: str, systems: Sequence[Section]) -> str:
    """The page: a bar with an entry a system and, below it, each system's sections in order."""
    environment = Environment(
        loader=PackageLoader("predplan.reporting"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters["anchor"] = anchor
    environment.filters["linked"] = linked
    environment.filters["inlined"] = lambda svg: Markup(inlined(svg))
    environment.filters["kind"] = lambda block: type(block).__name__
    environment.filters["as_cell"] = lambda cell: cell if isinstance(cell, Cell) else Cell(cell)
    return environment.get_template("page.html.j2").render(title=title, summary=summary, systems=systems)


def anchor(*titles: str) -> str:
    """The name by which the address bar knows a heading."""
    return "-".join(re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") for title in titles)


def linked(text: str) -> Markup:
    """The text with its web addresses as links."""
    parts = re.split(r"(https?://[^\s;,]*[^\s;,.)])", text)
    link = Markup('<a href="{0}" rel="noopener">{0}</a>')
    return Markup("").join(link.format(part) if number % 2 else escape(part) for number, part in enumerate(parts))
