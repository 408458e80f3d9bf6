"""Spelling features and classes: examples, and laws over any word."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from predplan.labelling.features import SpellingClasses, feature_matrix, kind, shape, spelling_features

WORDS = st.text(min_size=1, max_size=12)


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("@user", "mention"),
        ("#now", "hashtag"),
        ("#", "symbol"),
        ("http://t.co/x", "url"),
        ("www.x.org", "url"),
        ("3.5", "number"),
        ("4ever", "mixed"),
        ("!", "symbol"),
        ("...", "symbols"),
        ("NASA", "upper"),
        ("I", "title"),
        ("Lisboa", "title"),
        ("iPhone", "lower"),
        ("Jean-Luc", "title-"),
        ("don't", "lower'"),
        ("don’t", "lower'"),
        ("çok", "lower"),
        ("猫", "lower"),
    ],
)
def test_kinds(word: str, expected: str) -> None:
    assert kind(word) == expected


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("Covid-19", "Aa-0"),
        ("NASA", "A"),
        ("iPhone", "aAa"),
        ("...", "."),
        ("10:30", "0:0"),
        ("aBcDeFgHiJ", "aAaAaAaA"),
    ],
)
def test_shapes(word: str, expected: str) -> None:
    assert shape(word) == expected


def test_features_of_a_word() -> None:
    assert spelling_features("Ran") == (
        *("bias", "kind=title", "shape=Aa", "length=3"),
        *("suffix=n", "suffix=an", "suffix=ran", "prefix=r", "prefix=ra", "prefix=ran"),
        *("unicode=Ll", "unicode=Lu"),
    )


@given(word=WORDS)
def test_every_word_has_distinct_features_of_bounded_number(word: str) -> None:
    names = spelling_features(word)
    assert len(set(names)) == len(names)
    assert names == spelling_features(word)
    assert sum(name.startswith("suffix=") for name in names) <= 4
    assert sum(name.startswith("prefix=") for name in names) <= 3
    assert len(shape(word)) <= 8


def test_matrix_marks_known_features_only() -> None:
    columns = {"a": 0, "b": 1, "c": 2}
    matrix = feature_matrix([["c", "a"], [], ["unheard"], ["b"]], columns)
    np.testing.assert_array_equal(matrix.toarray(), [[1, 0, 1], [0, 0, 0], [0, 0, 0], [0, 1, 0]])
    assert feature_matrix([], columns).shape == (0, 3)


@given(words=st.lists(st.lists(st.sampled_from("abcdef"), unique=True), max_size=6))
def test_matrix_equals_membership(words: list[list[str]]) -> None:
    columns = {"b": 0, "a": 1, "e": 2}
    expected = [[float(name in row) for name in columns] for row in words]
    np.testing.assert_array_equal(feature_matrix(words, columns).toarray(), np.reshape(expected, (-1, 3)))


def test_classes_keep_suffixes_that_enough_rare_words_share() -> None:
    words = ["going", "doing", "seeing", "nothing", "cat", "dog", "Paris", "7", "8"]
    count = [1, 2, 2, 900, 1, 1, 1, 1, 1]
    classes = SpellingClasses.learn(words, count, rare=2, least_types=3)
    assert classes.known == {"lower:ing", "lower:ng", "lower:g", "lower"}
    assert classes.of("flying") == "lower:ing"
    assert classes.of("song") == "lower:ng"
    assert classes.of("hat") == "lower"
    assert classes.of("Lima") == "title"
    assert classes.of("1984") == "number"


@given(words=st.lists(WORDS, max_size=20), probe=WORDS, least=st.integers(1, 4))
def test_a_class_is_a_known_one_or_the_bare_kind(words: list[str], probe: str, least: int) -> None:
    classes = SpellingClasses.learn(words, [1] * len(words), rare=1, least_types=least)
    found = classes.of(probe)
    assert found in classes.known or found == kind(probe)
    assert found.startswith(kind(probe))
