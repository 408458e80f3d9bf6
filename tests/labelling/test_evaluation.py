"""Scores against scikit-learn and by hand; paired tests against statements of what they compute."""

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import confusion_matrix, precision_recall_fscore_support

from predplan.errors import InputError
from predplan.labelling.evaluation import (
    bootstrap_accuracy,
    bootstrap_difference,
    correctness,
    kolmogorov_smirnov,
    mcnemar,
    score,
)
from predplan.labelling.sentences import LabelledCorpus

TAGS = ("NOUN", "VERB", "X")
SEEDS = st.integers(0, 2**32 - 1)
GOLD = LabelledCorpus(
    (("dogs", "bark", "loud"), (), ("cats", "sleep"), ("hm",)),
    (("NOUN", "VERB", None), (), ("NOUN", "VERB"), (None,)),
)


def test_scores_by_hand() -> None:
    scores = score(GOLD, [["NOUN", "NOUN", "X"], [], ["NOUN", "VERB"], ["X"]], {"dogs", "bark", "loud"}, TAGS)
    assert (scores.accuracy, scores.sentence_accuracy, scores.tokens) == (0.75, 0.5, 4)
    assert (scores.unknown_accuracy, scores.unknown_tokens) == (1.0, 2)
    np.testing.assert_array_equal(scores.confusion, [[2, 0, 0], [1, 1, 0], [0, 0, 0]])
    noun, verb, other = scores.per_tag
    assert (noun.precision, noun.recall, noun.f1, noun.support) == (2 / 3, 1.0, 0.8, 2)
    assert (verb.precision, verb.recall, verb.f1, verb.support) == (1.0, 0.5, 2 / 3, 2)
    assert (other.tag, other.precision, other.recall, other.f1, other.support) == ("X", 0.0, 0.0, 0.0, 0)


def test_no_unknown_word_has_no_accuracy() -> None:
    words = [word for sentence in GOLD.words for word in sentence]
    assert score(GOLD, [["X"] * len(s) for s in GOLD.words], words, TAGS).unknown_accuracy is None


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_scores_agree_with_scikit_learn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 6, 10)
    gold = [[TAGS[i] for i in rng.integers(0, 3, n)] for n in lengths]
    predicted = [[TAGS[i] for i in rng.integers(0, 3, n)] for n in lengths]
    corpus = LabelledCorpus(tuple(("w",) * n for n in lengths), tuple(map(tuple, gold)))
    scores = score(corpus, predicted, set(), TAGS)
    flat = [tag for tags in gold for tag in tags], [tag for tags in predicted for tag in tags]
    np.testing.assert_array_equal(scores.confusion, confusion_matrix(*flat, labels=TAGS))
    expected = precision_recall_fscore_support(*flat, labels=TAGS, zero_division=0.0)
    found = [[t.precision, t.recall, t.f1, t.support] for t in scores.per_tag]
    np.testing.assert_allclose(np.array(found).T, expected)
    assert scores.sentence_accuracy == np.mean([g == p for g, p in zip(gold, predicted, strict=True)])


def test_differing_lengths_name_the_sentence() -> None:
    with pytest.raises(InputError, match=r"sentence 3: found 1 predicted tags, expected 2 .*'cats sleep'"):
        score(GOLD, [["X"] * 3, [], ["X"], ["X"]], (), TAGS)
    with pytest.raises(InputError, match="found 2 sentences, expected 4"):
        score(GOLD, [["X"] * 3, []], (), TAGS)


def test_unknown_tags_and_unlabelled_gold_are_refused() -> None:
    with pytest.raises(InputError, match="sentence 3: found the predicted tag 'NN', expected one of NOUN VERB X"):
        score(GOLD, [["X"] * 3, [], ["NN", "X"], ["X"]], (), TAGS)
    with pytest.raises(InputError, match="no labelled token"):
        score(LabelledCorpus((("hm",),), ((None,),)), [["X"]], (), TAGS)


def paired(both: int, only_a: int, only_b: int, neither: int) -> tuple[np.ndarray, np.ndarray]:
    counts = [both, only_a, only_b, neither]
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


@pytest.mark.parametrize(("only_a", "only_b"), [(0, 0), (1, 0), (9, 2), (4, 4), (0, 24)])
def test_few_disagreements_give_the_binomial_p_value(only_a: int, only_b: int) -> None:
    n, least = only_a + only_b, min(only_a, only_b)
    expected = min(1.0, 2 * sum(comb(n, i) for i in range(least + 1)) / 2**n)
    result = mcnemar(*paired(50, only_a, only_b, 3))
    assert (result.only_first, result.only_second) == (only_a, only_b)
    assert result.p_value == pytest.approx(expected)


def test_many_disagreements_agree_with_the_exact_test() -> None:
    few = mcnemar(*paired(1000, 15, 9, 30)).p_value
    assert few == pytest.approx(0.3075, abs=1e-3)
    for only_a, only_b in [(40, 40), (250, 200), (2000, 2150)]:
        n = only_a + only_b
        exact = min(1.0, 2 * sum(comb(n, i) for i in range(min(only_a, only_b) + 1)) / 2**n)
        assert mcnemar(*paired(9, only_a, only_b, 0)).p_value == pytest.approx(exact, rel=0.02, abs=1e-3)


def test_mcnemar_holds_its_level() -> None:
    rng = np.random.default_rng(0)
    rejected = [mcnemar(rng.random(400) < 0.8, rng.random(400) < 0.8).p_value < 0.05 for _ in range(400)]
    assert 0.01 < np.mean(rejected) < 0.08


def test_kolmogorov_smirnov_sees_only_the_difference_of_accuracies() -> None:
    a, b = paired(800, 100, 20, 80)
    result = kolmogorov_smirnov(a, b)
    assert result.statistic == pytest.approx(0.08)
    assert result.p_value == pytest.approx(kolmogorov_smirnov(a, np.roll(b, 333)).p_value)
    assert mcnemar(a, b).p_value < result.p_value


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_bootstrap_interval_has_the_width_theory_gives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    correct = rng.random(4000) < 0.8
    offsets = np.arange(0, 4001, 4)
    found = bootstrap_accuracy(correct, offsets, rng, samples=2000)
    per_sentence = correct.reshape(-1, 4).mean(axis=1)
    half = 1.96 * per_sentence.std() / np.sqrt(1000)
    assert found.estimate == correct.mean()
    assert found.low == pytest.approx(found.estimate - half, abs=0.15 * half)
    assert found.high == pytest.approx(found.estimate + half, abs=0.15 * half)


def test_bootstrap_draws_whole_sentences() -> None:
    rng = np.random.default_rng(1)
    right = np.repeat(rng.random(200) < 0.5, 20)
    as_sentences = bootstrap_accuracy(right, np.arange(0, 4001, 20), rng)
    as_tokens = bootstrap_accuracy(right, np.arange(4001), rng)
    ratio = (as_sentences.high - as_sentences.low) / (as_tokens.high - as_tokens.low)
    assert ratio == pytest.approx(np.sqrt(20), rel=0.1)


def test_bootstrap_difference_is_paired_repeatable_and_signed() -> None:
    rng = np.random.default_rng(2)
    b = rng.random(3000) < 0.8
    a = b | (rng.random(3000) < 0.1)
    offsets = np.concatenate([[0, 0], np.sort(rng.choice(np.arange(1, 3000), 300, replace=False)), [3000]])
    found = bootstrap_difference(a, b, offsets, np.random.default_rng(7))
    assert found == bootstrap_difference(a, b, offsets, np.random.default_rng(7))
    assert found.estimate == pytest.approx(a.mean() - b.mean())
    assert 0 < found.low < found.estimate < found.high
    same = bootstrap_difference(a, a, offsets, np.random.default_rng(7))
    assert (same.estimate, same.low, same.high) == (0.0, 0.0, 0.0)


def test_bad_pairs_and_offsets_are_refused() -> None:
    a = np.ones(4, np.bool_)
    with pytest.raises(InputError, match="same tokens"):
        mcnemar(a, a[:3])
    with pytest.raises(InputError, match="expected at least two"):
        bootstrap_accuracy(a, np.array([0, 4]), np.random.default_rng(0))
    with pytest.raises(InputError, match="run from 0 to 4"):
        bootstrap_accuracy(a, np.array([0, 2, 3]), np.random.default_rng(0))


def test_correctness_marks_where_sentences_lie() -> None:
    right, offsets = correctness(GOLD, [["NOUN", "NOUN", "X"], [], ["NOUN", "VERB"], ["X"]])
    np.testing.assert_array_equal(right, [True, False, True, True])
    np.testing.assert_array_equal(offsets, [0, 2, 2, 4, 4])
