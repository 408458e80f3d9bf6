"""Anchors: who qualifies, the order in which thresholds relax, and Arora's anchors where they are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.errors import InputError
from predplan.labelling.active_set import Floats, Integers
from predplan.labelling.anchors import Anchors, AnchorSettings, supervised_anchors, tag_matrix, unsupervised_anchors

SEEDS = st.integers(0, 2**32 - 1)
SETTINGS = AnchorSettings(most=2, purity=0.7, labelled_count=4, raw_count=500)


def anchors(
    labelled: list[list[int]], raw: list[int], dictionary: Floats | None = None, settings: AnchorSettings = SETTINGS
) -> Anchors:
    counts = np.array(labelled, float)
    listed = np.zeros(counts.shape) if dictionary is None else dictionary
    return supervised_anchors(counts, listed, np.array(raw), [f"T{i}" for i in range(counts.shape[1])], settings)


def words_of(found: Anchors, tag: int) -> list[int]:
    return [int(word) for word in np.flatnonzero(found.chosen[:, tag])]


def test_the_most_frequent_pure_words_are_chosen() -> None:
    found = anchors([[9, 0], [8, 0], [7, 0], [6, 4], [0, 5], [2, 8]], [600, 900, 700, 9000, 500, 501])
    assert words_of(found, 0) == [1, 2]
    assert words_of(found, 1) == [4, 5]
    assert found.thresholds == (SETTINGS, SETTINGS)


def test_equal_frequency_goes_to_the_earlier_word() -> None:
    assert words_of(anchors([[4], [4], [4]], [500, 500, 500]), 0) == [0, 1]


@pytest.mark.parametrize(
    ("labelled", "raw", "expected"),
    [
        ([4, 0], 500, (0.7, 4, 500)),
        ([3, 0], 500, (0.7, 3, 500)),
        ([1, 0], 500, (0.7, 1, 500)),
        ([4, 0], 499, (0.7, 4, 100)),
        ([2, 0], 99, (0.7, 2, 20)),
        ([1, 0], 1, (0.7, 1, 1)),
        ([4, 4], 500, (0.5, 4, 500)),
        ([1, 2], 1, (1e-9, 3, 1)),
    ],
)
def test_thresholds_relax_only_as_far_as_needed(
    labelled: list[int], raw: int, expected: tuple[float, int, int]
) -> None:
    found = anchors([labelled, [0, 50]], [raw, 1000])
    assert words_of(found, 0) == [0]
    ended = found.thresholds[0]
    assert (ended.purity, ended.labelled_count, ended.raw_count) == expected
    assert found.thresholds[1] == SETTINGS


def test_labelled_count_relaxes_before_raw_count_and_that_before_purity() -> None:
    once, rare, impure = [1, 0], [9, 0], [6, 4]
    found = anchors([rare, once, impure, [0, 9]], [499, 500, 9000, 900])
    assert words_of(found, 0) == [1]
    found = anchors([rare, impure, [0, 9]], [1, 9000, 900])
    assert words_of(found, 0) == [0]


def test_relaxing_stops_where_every_threshold_is_already_low() -> None:
    low = AnchorSettings(most=5, purity=0.4, labelled_count=1, raw_count=0)
    assert words_of(anchors([[1, 3], [0, 3]], [2, 2], settings=low), 0) == [0]


def test_a_dictionary_entry_with_one_tag_serves_unless_labels_contradict() -> None:
    dictionary = np.array([[1, 0], [1, 1], [1, 0], [1, 0], [0, 0]], float)
    labelled = [[0, 0], [0, 0], [0, 3], [1, 0], [0, 9]]
    wide = AnchorSettings(most=10, purity=0.7, labelled_count=4, raw_count=500)
    found = anchors(labelled, [600, 9000, 9000, 500, 500], dictionary, wide)
    assert words_of(found, 0) == [0, 3]
    assert words_of(found, 1) == [4]


def test_a_tag_without_any_possible_anchor_is_named_with_a_remedy() -> None:
    with pytest.raises(InputError, match=r"^tag T1: no anchor word.*add a labelled sentence or a dictionary entry"):
        anchors([[9, 0], [0, 9]], [600, 0])


def test_counts_become_a_matrix_over_the_vocabulary() -> None:
    matrix = tag_matrix({"run": {"V": 3, "N": 1}, "gone": {"V": 2}}, {"the": 0, "run": 1}, ["N", "V"])
    np.testing.assert_array_equal(matrix, [[0, 0], [1, 3]])


def separable(seed: int, number: int) -> tuple[Floats, Integers]:
    """Rows Gamma R of 60 words of which `number`, given back, have a single tag."""
    rng = np.random.default_rng(seed)
    R = rng.dirichlet(np.full(30, 0.3), size=number)
    gamma = 0.95 * rng.dirichlet(np.ones(number), size=60) + 0.05 / number
    pure = rng.choice(60, number, replace=False)
    gamma[pure] = np.eye(number)
    return gamma @ R, pure


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, number=st.integers(1, 8))
def test_arora_anchors_are_found_exactly_without_noise(seed: int, number: int) -> None:
    contexts, pure = separable(seed, number)
    found = unsupervised_anchors(contexts, np.ones(60, np.bool_), number)
    if number > 1:
        assert sorted(found) == sorted(pure)
    else:
        assert len(found) == 1


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_arora_anchors_are_candidates(seed: int) -> None:
    contexts, pure = separable(seed, 4)
    candidates = np.ones(60, np.bool_)
    candidates[pure[0]] = False
    found = unsupervised_anchors(contexts, candidates, 4)
    assert candidates[found].all()
    assert set(pure[1:]) <= set(found)


def test_too_few_candidates_are_refused() -> None:
    with pytest.raises(InputError, match="3 anchors wanted, but only 2 words"):
        unsupervised_anchors(np.eye(4), np.array([True, True, False, False]), 3)
