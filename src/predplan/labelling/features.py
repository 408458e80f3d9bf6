"""What a word's spelling says: the features of section 3.6.1, and classes of spelling for rare words."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse

LONGEST_AFFIX = 4
_SMALL = re.compile("[a-z]+")
_REPEATED = re.compile(r"(.)\1+")


@lru_cache(maxsize=1 << 16)  # several models of one vocabulary ask in turn
def spelling_features(word: str) -> tuple[str, ...]:
    """Names of the binary features a word has: prefixes, suffixes, shape, length, Unicode classes of its characters."""
    lower = word.lower()
    names = ["bias", f"kind={kind(word)}", f"shape={shape(word)}", f"length={min(len(word), 8)}"]
    names += [f"suffix={lower[-n:]}" for n in range(1, LONGEST_AFFIX + 1) if len(lower) >= n]
    names += [f"prefix={lower[:n]}" for n in range(1, LONGEST_AFFIX) if len(lower) >= n]
    categories = {"Ll"} if _SMALL.fullmatch(word) else set(map(unicodedata.category, word))
    names += [f"unicode={category}" for category in sorted(categories)]
    return tuple(names)


def kind(word: str) -> str:
    """The coarsest description: mention, hashtag, url, number, symbols; for words their capitals and hyphens."""
    if len(word) > 1 and word[0] in "@#":
        return "mention" if word[0] == "@" else "hashtag"
    if word.startswith(("http://", "https://", "www.")):
        return "url"
    if word.isalpha():
        return _case(word)
    letters = any(character.isalpha() for character in word)
    if any(character.isdigit() for character in word):
        return "mixed" if letters else "number"
    if not letters:
        return "symbol" if len(word) == 1 else "symbols"
    inner = word[1:-1]
    link = "-" if "-" in inner else "'" if "'" in inner or "’" in inner else ""
    return _case(word) + link


def _case(word: str) -> str:
    return "upper" if len(word) > 1 and word.isupper() else "title" if word[0].isupper() else "lower"


def shape(word: str) -> str:
    """Runs of capitals, small letters and digits as A, a and 0, other characters as they are: `Covid-19` is `Aa-0`."""
    if _SMALL.fullmatch(word):
        return "a"
    classes = ("A" if c.isupper() else "a" if c.islower() else "0" if c.isdigit() else c for c in word)
    return _REPEATED.sub(r"\1", "".join(classes))[:8]


def feature_matrix(names: Iterable[Sequence[str]], columns: Mapping[str, int]) -> sparse.csr_array:
    """Binary features [words, W]; names that have no column are passed over."""
    indptr, indices = [0], list[int]()
    for row in names:
        indices.extend(column for name in row if (column := columns.get(name)) is not None)
        indptr.append(len(indices))
    return sparse.csr_array(
        (np.ones(len(indices)), np.array(indices, np.int32), np.array(indptr)), shape=(len(indptr) - 1, len(columns))
    )


@dataclass(frozen=True)
class SpellingClasses:
    """Classes of rare words: kind and the longest suffix that enough rare words share."""

    known: frozenset[str]

    @classmethod
    def learn(cls, words: Sequence[str], count: Sequence[int], rare: int, least_types: int) -> SpellingClasses:
        """Keep the classes that at least `least_types` words of at most `rare` occurrences fall into."""
        chains = Counter(_suffix_classes(word) for word, n in zip(words, count, strict=True) if n <= rare)
        sizes = Counter[str]()
        for chain, size in chains.items():
            sizes.update(dict.fromkeys(chain, size))
        return cls(frozenset(name for name, size in sizes.items() if size >= least_types))

    def of(self, word: str) -> str:
        """The most specific known class of a word; its kind alone where none is known."""
        chain = _suffix_classes(word)
        return next((name for name in chain if name in self.known), chain[-1])


def _suffix_classes(word: str) -> tuple[str, ...]:
    """Narrow to wide, the kind last."""
    return _classes_of(kind(word), word.lower()[-3:])


@lru_cache(maxsize=1 << 16)  # many words share an ending, and their classes' names too
def _classes_of(name: str, ending: str) -> tuple[str, ...]:
    if not name.startswith(("upper", "title", "lower")):
        return (name,)
    return (*(f"{name}:{ending[-n:]}" for n in (3, 2, 1) if len(ending) >= n), name)
