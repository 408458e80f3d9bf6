"""What a report is made of, before it becomes Markdown or HTML."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Text:
    """A paragraph; addresses in it become links."""

    text: str


@dataclass(frozen=True)
class Items:
    """A numbered list, each item a short name and what there is to say."""

    items: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Cell:
    """A cell of a table: its value, its spread over draws, the published value, and whether it is the best."""

    value: str
    spread: str = ""
    published: str = ""
    best: bool = False


@dataclass(frozen=True)
class Table:
    """A table; the first column names the rows. A row of one cell heads the rows below it."""

    header: tuple[str, ...]
    rows: tuple[tuple[str | Cell, ...], ...]
    caption: str


@dataclass(frozen=True)
class Figure:
    """A drawing (a whole SVG document) and the name of its file."""

    name: str
    svg: str
    caption: str


@dataclass(frozen=True)
class TaggedWord:
    """A word, the tag it has and the tag it was given."""

    word: str
    gold: str
    predicted: str

    @property
    def wrong(self) -> bool:
        """Whether the tag given is another than the word's, where it has one."""
        return self.gold not in ("_", self.predicted)


@dataclass(frozen=True)
class Tagged:
    """Sentences, each as tagged by one tagger or more: (tagger, words)."""

    sentences: tuple[tuple[tuple[str, tuple[TaggedWord, ...]], ...], ...]
    caption: str


Block: TypeAlias = Text | Items | Table | Figure | Tagged


@dataclass(frozen=True)
class Section:
    """A heading, what stands below it, and the sections in it; folded ones open when clicked."""

    title: str
    blocks: tuple[Block, ...] = ()
    sections: tuple[Section, ...] = ()
    folded: bool = False
