from collections.abc import Callable, Iterator, Sequence
from itertools import islice, pairwise, product
from typing import Literal, TypeAlias, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from predplan.errors import InputError
from predplan.labelling.decoding import Transitions
from predplan.labelling.expectations import RawTokens, expected_counts, observed_counts
from predplan.labelling.models import FeatureHiddenMarkovModel, SequenceModel, Tokens, decode
from predplan.labelling.semisupervised import (
    Iteration,
    best_iteration,
    expectation_maximisation,
    feature_expectation_maximisation,
    feature_self_training,
    self_training,
)
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.suffixes import SuffixTree, suffix_chain
from predplan.labelling.supervised import (
    BaselineSettings,
    TableHiddenMarkovModel,
    add_one_model,
    supervised_chain_model,
    supervised_feature_model,
    supervised_model,
)

Floats = NDArray[np.float64]
Drawn: TypeAlias = tuple[Floats, LabelledCorpus, RawTokens]
Model = TypeVar("Model", bound=SequenceModel)
Training: TypeAlias = Callable[[LabelledCorpus, RawTokens, Sequence[str], BaselineSettings], Iterator[Iteration[Model]]]
TAGS = ("A", "B", "C")
TRANSITIONS = Transitions(
    np.array([0.6, 0.3, 0.1]),
    np.array([[0.1, 0.7, 0.1], [0.2, 0.1, 0.6], [0.6, 0.1, 0.2]]),
    np.array([0.1, 0.1, 0.1]),
)
PURE = BaselineSettings(labelled_weight=0.0, prior=0.0, raw_smoothing=0.0)
PROPORTIONAL = BaselineSettings(labelled_weight=1.0, prior=0.0, raw_smoothing=0.0, smoothing=0.0, shrinkage=0.0)
TOY = LabelledCorpus((("a", "b"), ("a",)), (("A", "B"), ("B",)))


def emissions_of_truth() -> Floats:
    return np.random.default_rng(5).dirichlet(np.full(30, 0.3), 3).T


def sample(sentences: int, seed: int, emissions: Floats) -> LabelledCorpus:
    """Sentences drawn from a known hidden Markov model: words, and tags."""
    rng = np.random.default_rng(seed)
    words, tags = [], []
    for _ in range(sentences):
        tag = rng.choice(3, p=TRANSITIONS.start)
        path = []
        while tag < 3:
            path.append(int(tag))
            tag = rng.choice(4, p=[*TRANSITIONS.between[tag], TRANSITIONS.stop[tag]])
        words.append(tuple(f"w{rng.choice(len(emissions), p=emissions[:, tag])}" for tag in path))
        tags.append(tuple(TAGS[tag] for tag in path))
    return LabelledCorpus(tuple(words), tuple(tags))


def raw_of(corpus: LabelledCorpus, parts: int = 2) -> RawTokens:
    tokens = Tokens.of(corpus.words)
    cuts = np.linspace(0, len(corpus), parts + 1).astype(int)
    batches = [
        (
            tokens.ids[tokens.offsets[a] : tokens.offsets[b]].astype(np.int32),
            tokens.offsets[a : b + 1] - tokens.offsets[a],
        )
        for a, b in pairwise(cuts)
    ]
    return RawTokens(tokens.words, batches)


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    emissions = emissions_of_truth()
    return emissions, sample(30, 1, emissions), raw_of(sample(2000, 2, emissions))


def test_add_one_equals_counts_by_hand() -> None:
    model = add_one_model(TOY, ("A", "B"))
    np.testing.assert_allclose(model.emissions, [[2 / 4, 2 / 5], [1 / 4, 2 / 5]])
    scores = model.token_scores(["a", "new"], np.array([0, 1]), np.array([0, 2]))
    np.testing.assert_allclose(scores[1, 0] / scores[1, 1], (1 / 4) / (1 / 5))
    np.testing.assert_allclose(model.transitions.start, [2 / 4, 2 / 4])
    np.testing.assert_allclose(model.transitions.between, [[1 / 4, 2 / 4], [1 / 5, 1 / 5]])
    np.testing.assert_allclose(model.transitions.stop, [1 / 4, 3 / 5])


def test_words_without_label_are_passed_over() -> None:
    partly = LabelledCorpus((("a", "x", "b"),), (("A", None, "B"),))
    counts = observed_counts(partly, {"a": 0, "b": 1}, ("A", "B"))
    np.testing.assert_array_equal(counts.words, [[1, 0], [0, 1]])
    np.testing.assert_array_equal(counts.pairs, [[0, 0, 0], [0, 0, 1], [1, 0, 0]])
    with pytest.raises(InputError, match="no labelled word"):
        add_one_model(LabelledCorpus((("a",),), ((None,),)), ("A", "B"))


def test_expected_counts_equal_those_of_all_paths() -> None:
    rng = np.random.default_rng(0)
    emissions = rng.dirichlet(np.ones(4), 3).T
    sentence = [2, 0, 3]
    raw = RawTokens("abcd", [(np.array([*sentence, 1], np.int32), np.array([0, 3, 3, 4]))])
    words, pairs, log_likelihood = np.zeros((4, 3)), np.zeros((4, 4)), 0.0
    for ids in (sentence, [1]):
        paths = {}
        for path in product(range(3), repeat=len(ids)):
            steps = [TRANSITIONS.between[a, b] for a, b in pairwise(path)]
            emitted = [emissions[word, tag] for word, tag in zip(ids, path, strict=True)]
            paths[path] = TRANSITIONS.start[path[0]] * np.prod(steps) * np.prod(emitted) * TRANSITIONS.stop[path[-1]]
        total = sum(paths.values())
        log_likelihood += np.log(total)
        for path, mass in paths.items():
            edged = [3, *path, 3]
            for word, tag in zip(ids, path, strict=True):
                words[word, tag] += mass / total
            for previous, following in pairwise(edged):
                pairs[previous, following] += mass / total
    found = expected_counts(emissions, raw, TRANSITIONS)
    np.testing.assert_allclose(found.words, words)
    np.testing.assert_allclose(found.pairs, pairs, atol=1e-15)
    assert found.log_likelihood == pytest.approx(log_likelihood)


def test_hard_counts_are_those_of_the_decoded_text(drawn: Drawn) -> None:
    _emissions, corpus, _ = drawn
    model = supervised_model(corpus, TAGS, BaselineSettings())
    raw, tokens = raw_of(corpus), Tokens.of(corpus.words)
    emitted = model.word_scores(raw.words)
    found = expected_counts(emitted, raw, model.transitions, hard=True)
    decoded = [TAGS[tag] for tag in decode(model, tokens)]
    tagged = tuple(tuple(decoded[a:b]) for a, b in zip(tokens.offsets, tokens.offsets[1:], strict=False))
    expected = observed_counts(
        LabelledCorpus(corpus.words, tagged), {word: row for row, word in enumerate(raw.words)}, TAGS
    )
    np.testing.assert_array_equal(found.words, expected.words)
    np.testing.assert_array_equal(found.pairs, expected.pairs)


def test_likelihood_of_raw_text_never_decreases(drawn: Drawn) -> None:
    _, corpus, raw = drawn
    iterations = list(islice(expectation_maximisation(corpus, raw, TAGS, PURE), 16))
    assert iterations[0].log_likelihood_before is None
    steps = np.diff([iteration.log_likelihood_before for iteration in iterations[1:]])
    assert (steps > -1e-6).all()
    assert steps[0] > 1.0


def test_em_recovers_the_model_the_text_was_drawn_from(drawn: Drawn) -> None:
    truth, corpus, raw = drawn
    names = [f"w{word}" for word in range(len(truth))]
    iterations = list(islice(expectation_maximisation(corpus, raw, TAGS, PURE), 31))

    def error(model: TableHiddenMarkovModel) -> float:
        scores = model.word_scores(names)
        return float(np.abs(scores / scores.sum(axis=0) - truth).sum(axis=0).max() / 2)

    assert error(iterations[-1].model) < 0.05 < error(iterations[0].model)
    np.testing.assert_allclose(iterations[-1].model.transitions.between, TRANSITIONS.between, atol=0.05)


def test_self_training_on_the_labelled_text_itself_changes_nothing() -> None:
    words = (("the", "dog", "ran"), ("a", "cat", "sat"), ("the", "cat"))
    corpus = LabelledCorpus(words, (("A", "B", "C"), ("A", "B", "C"), ("A", "B")))
    first, second = islice(self_training(corpus, raw_of(corpus, 1), TAGS, PROPORTIONAL), 2)
    np.testing.assert_allclose(
        second.model.word_scores(["the", "dog", "sat"]), first.model.word_scores(["the", "dog", "sat"])
    )
    for name in ("start", "between", "stop"):
        np.testing.assert_allclose(getattr(second.model.transitions, name), getattr(first.model.transitions, name))


@pytest.mark.parametrize("train", [expectation_maximisation, self_training])
def test_raw_text_helps_and_the_best_iteration_is_kept(drawn: Drawn, train: Training[TableHiddenMarkovModel]) -> None:
    emissions, _, raw = drawn
    corpus, test = sample(8, 3, emissions), sample(300, 4, emissions)
    tokens, gold = Tokens.of(test.words), np.array([TAGS.index(tag) for tags in test.tags for tag in tags])

    def accuracy(model: TableHiddenMarkovModel) -> float:
        return float((decode(model, tokens) == gold).mean())

    best, scores = best_iteration(train(corpus, raw, TAGS, BaselineSettings()), accuracy, most=5)
    assert accuracy(best) == max(scores) > scores[0]


@pytest.mark.parametrize("train", [feature_expectation_maximisation, feature_self_training])
def test_feature_models_learn_from_raw_text(drawn: Drawn, train: Training[FeatureHiddenMarkovModel]) -> None:
    _emissions, corpus, raw = drawn
    settings = BaselineSettings(feature_count=1, penalty=1e-3, steps=20)
    iterations = list(islice(train(corpus, raw, TAGS, settings), 4))
    likelihoods = [iteration.log_likelihood_before or -np.inf for iteration in iterations[1:]]
    assert likelihoods[-1] > likelihoods[0]
    assert np.isfinite(iterations[-1].model.emissions.weights).all()


def test_raw_text_that_can_be_read_once_is_refused() -> None:
    with pytest.raises(InputError, match="only once"):
        RawTokens(["a"], iter([(np.array([0], np.int32), np.array([0, 1]))]))


@pytest.mark.parametrize("unknown", ["classifier", "suffixes"])
def test_unknown_words_are_judged_by_their_spelling(unknown: Literal["classifier", "suffixes"]) -> None:
    words = (("walked", "dogs"), ("jumped", "cats"), ("talked", "hens"))
    corpus = LabelledCorpus(words, (("A", "B"),) * 3)
    model = supervised_model(corpus, ("A", "B"), BaselineSettings(unknown=unknown))
    scores = model.word_scores(["barked", "cows"])
    assert scores[0, 0] > scores[0, 1]
    assert scores[1, 1] > scores[1, 0]


def test_suffixes_back_off_by_hand() -> None:
    tree = SuffixTree.grow(["ab", "cb"])
    judged = tree.judge(np.array([[1.0, 0.0], [0.0, 1.0]]), backoff=2.0)
    assert suffix_chain("ab") == ["", "lower", "lower:b", "lower:ab"]
    np.testing.assert_allclose(judged.probabilities(["ab", "xb", "9"]), [[2 / 3, 1 / 3], [0.5, 0.5], [0.5, 0.5]])


def test_a_tag_without_labels_leaves_every_model_finite() -> None:
    corpus = LabelledCorpus((("the", "dog"),), (("A", "B"),))
    settings = BaselineSettings()
    assert np.isfinite(add_one_model(corpus, TAGS).word_scores(["the", "new"])).all()
    assert decode(supervised_model(corpus, TAGS, settings), Tokens.of([["the", "dog"]])).tolist() == [0, 1]
    assert decode(supervised_feature_model(corpus, TAGS, settings), Tokens.of([["the", "dog"]])).tolist() == [0, 1]


def test_chain_on_labels_alone_learns_them(drawn: Drawn) -> None:
    _, corpus, _ = drawn
    model = supervised_chain_model(corpus, TAGS, BaselineSettings().chain)
    tokens = Tokens.of(corpus.words)
    gold = [TAGS.index(tag) for tags in corpus.tags for tag in tags]
    assert (decode(model, tokens) == gold).mean() > 0.9
