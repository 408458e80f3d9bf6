"""Bigram counts against a loop over tokens, over any split into batches, and after an interruption."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.errors import InputError
from predplan.labelling.counting import BigramCounts, count_sentences
from predplan.labelling.sentences import TokenBatch

SENTENCES = st.lists(st.lists(st.sampled_from(["a", "b", "ab", "é", "猫", "Z"]), max_size=6), max_size=12)
TEXT = [["the", "cat", "saw", "the", "dog"], [], ["the", "dog", "the", "dog"], ["saw"]]


def batch(sentences: Sequence[Sequence[str]]) -> TokenBatch:
    """With a vocabulary of the batch's own, in the order of first appearance."""
    ids: dict[str, int] = {}
    tokens = [ids.setdefault(word, len(ids)) for sentence in sentences for word in sentence]
    return TokenBatch(tuple(ids), np.array(tokens, np.int32), np.cumsum([0, *map(len, sentences)]))


def split(sentences: Sequence[Sequence[str]], cuts: Sequence[int]) -> list[TokenBatch]:
    return [batch(sentences[a:b]) for a, b in pairwise([0, *sorted(cuts), len(sentences)])]


def check_equal_to_a_loop(found: BigramCounts, sentences: Sequence[Sequence[str]]) -> None:
    words = Counter(word for sentence in sentences for word in sentence)
    edge = ""
    pairs = Counter(pair for s in sentences if s for pair in pairwise([edge, *s, edge]))
    assert found.vocabulary == tuple(sorted(words, key=lambda word: (-words[word], word)))
    assert found.count.tolist() == [words[word] for word in found.vocabulary]
    names = [*found.vocabulary, edge]
    table = found.bigrams.tocoo()
    assert {(names[u], names[v]): n for u, v, n in zip(table.row, table.col, table.data, strict=True)} == pairs
    assert found.bigrams.shape == (len(names), len(names))


def check_same(found: BigramCounts, expected: BigramCounts) -> None:
    assert found.vocabulary == expected.vocabulary
    np.testing.assert_array_equal(found.count, expected.count)
    for part in ("indptr", "indices", "data"):
        np.testing.assert_array_equal(getattr(found.bigrams, part), getattr(expected.bigrams, part))


@settings(max_examples=25, deadline=None)
@given(sentences=SENTENCES, cuts=st.lists(st.integers(0, 12), max_size=3))
def test_any_split_into_batches_counts_as_a_loop_does(sentences: list[list[str]], cuts: list[int]) -> None:
    cuts = [min(cut, len(sentences)) for cut in cuts]
    with TemporaryDirectory() as folder:
        found = count_sentences(split(sentences, cuts), Path(folder))
    check_equal_to_a_loop(found, sentences)


def test_batches_and_their_order_of_words_leave_no_trace(tmp_path: Path) -> None:
    whole = count_sentences(split(TEXT, []), tmp_path / "whole")
    parts = count_sentences(split(TEXT, [1, 2, 3]), tmp_path / "parts")
    reverse = count_sentences(split(TEXT[::-1], [2]), tmp_path / "reverse")
    check_same(parts, whole)
    check_same(reverse, whole)


def test_an_interrupted_count_goes_on_where_it_was(tmp_path: Path) -> None:
    batches = split(TEXT, [1, 3])

    def interrupted() -> Iterator[TokenBatch]:
        yield from batches[:2]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        count_sentences(interrupted(), tmp_path)
    kept = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert sorted(kept) == ["part-00000.parquet", "part-00001.parquet"]
    check_equal_to_a_loop(count_sentences(batches, tmp_path), TEXT)
    assert kept == {name: (tmp_path / name).stat().st_mtime_ns for name in kept}


def test_a_word_may_be_in_a_vocabulary_without_occurring(tmp_path: Path) -> None:
    counts = count_sentences([TokenBatch(("x", "y"), np.array([1], np.int32), np.array([0, 1]))], tmp_path)
    assert dict(zip(counts.vocabulary, counts.count.tolist(), strict=True)) == {"x": 0, "y": 1}


def test_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no batch"):
        count_sentences([], tmp_path)
