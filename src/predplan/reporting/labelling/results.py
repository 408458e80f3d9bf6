"""What the report on labelling is drawn from: one corpus's tables, and means over draws."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Rows = Sequence[Mapping[str, Any]]
"""A table's rows, by the columns of its schema in predplan.labelling.tables."""


@dataclass(frozen=True)
class CorpusResults:
    """One corpus: its name, its source, and the rows of the tables that the stages wrote.

    costs: of the methods in the tables; ablations: empty where none were run; facts: corpus.json; raw: tokenise.json.
    """

    name: str
    source: str
    dictionary: bool
    scores: Rows
    tag_scores: Rows
    confusion: Rows
    comparisons: Rows
    tagged: Rows
    curve: Rows
    costs: Rows
    ablations: Rows
    facts: Mapping[str, Any]
    raw: Mapping[str, Any]

    @property
    def title(self) -> str:
        """The corpus as the report calls it."""
        known = {"brown": "Brown (English)", "turkish": "Turkish treebanks", "twitter": "Twitter"}
        if self.source == "malagasy":
            return "Malagasy, type+token" if self.dictionary else "Malagasy, token"
        return known.get(self.source, self.name)

    @property
    def sizes(self) -> list[int]:
        """Labelled sentences of the training sets, smallest first."""
        return sorted({size_of(row["subset"]) for row in self.scores})


@dataclass(frozen=True)
class Summary:
    """Mean, least and greatest value over draws of the training set."""

    mean: float
    low: float
    high: float
    draws: int


def size_of(subset: str) -> int:
    """Labelled sentences of a training set named SIZE-DRAW."""
    return int(subset.split("-")[0])


def summarise(rows: Rows, value: str, scale: float = 1.0) -> dict[tuple[str, int], Summary]:
    """A column by method and labelled sentences, over draws, times `scale`."""
    groups: defaultdict[tuple[str, int], list[float]] = defaultdict(list)
    for row in rows:
        size = row["size"] if "size" in row else size_of(row["subset"])
        groups[row["method"], size].append(scale * row[value])
    return {key: summary(values) for key, values in groups.items()}


def summary(values: Iterable[float]) -> Summary:
    """Mean and range of some values."""
    found = sorted(values)
    return Summary(sum(found) / len(found), found[0], found[-1], len(found))
