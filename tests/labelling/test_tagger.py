"""The estimator end to end on sentences drawn from a known hidden Markov model, and its saved models."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.labelling import AnchorTagger, read_raw
from predplan.labelling.anchors import AnchorSettings
from predplan.labelling.chain import labelled_runs
from predplan.labelling.evaluation import Scores
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.storage import ModelKind
from predplan.labelling.tagger import count_text, tag_set
from predplan.labelling.training import MomentSettings, TrainingSettings
from tests.labelling.generated import TAGS, draw_corpus, write_raw

SETTINGS = TrainingSettings(MomentSettings(5, 5, 5), AnchorSettings(labelled_count=2, raw_count=20))
KINDS: tuple[ModelKind, ...] = ("hmm", "fhmm", "crf")


@pytest.fixture(scope="module")
def train() -> LabelledCorpus:
    return draw_corpus(60, seed=1)


@pytest.fixture(scope="module")
def test() -> LabelledCorpus:
    return draw_corpus(100, seed=2)


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_raw(tmp_path_factory.mktemp("raw") / "raw.txt", draw_corpus(1500, seed=3))


@pytest.fixture(scope="module", params=KINDS)
def tagger(request: pytest.FixtureRequest, train: LabelledCorpus, raw: Path) -> AnchorTagger:
    return AnchorTagger(request.param, settings=SETTINGS).fit(train, read_raw(raw))


def without(corpus: LabelledCorpus, share: float) -> LabelledCorpus:
    """The corpus with a share of its labels taken away."""
    rng = np.random.default_rng(0)
    return replace(
        corpus, tags=tuple(tuple(None if rng.random() < share else tag for tag in tags) for tags in corpus.tags)
    )


def test_learns_most_tags(tagger: AnchorTagger, test: LabelledCorpus) -> None:
    assert tagger.score(test) > 0.9
    assert tagger.tags_ == TAGS
    assert {anchor.tag for anchor in tagger.anchors_} == set(TAGS)
    assert tagger.contexts_ is not None
    assert np.allclose(tagger.contexts_.gamma.sum(axis=1), 1.0)


def test_probabilities_are_those_of_the_predictions(tagger: AnchorTagger, test: LabelledCorpus) -> None:
    predicted, probabilities = tagger.predict(test.words), tagger.predict_proba(test.words)
    for tags, of, words in zip(predicted, probabilities, test.words, strict=True):
        assert of.shape == (len(words), len(TAGS))
        assert np.allclose(of.sum(axis=1), 1.0)
        assert [TAGS[place] for place in of.argmax(axis=1)] == tags


def test_empty_and_unknown_sentences(tagger: AnchorTagger) -> None:
    assert tagger.predict([]) == []
    empty, unknown = tagger.predict([[], ["zzzing", "日本", "!!", " "]])
    assert empty == []
    assert len(unknown) == 4
    assert set(unknown) <= set(TAGS)


def test_saved_and_loaded_it_tags_the_same(tagger: AnchorTagger, test: LabelledCorpus, tmp_path: Path) -> None:
    tagger.save(tmp_path / "model")
    loaded = AnchorTagger.load(tmp_path / "model")
    for before, after in zip(tagger.predict_proba(test.words), loaded.predict_proba(test.words), strict=True):
        assert np.array_equal(before, after)
    assert loaded.settings_ == tagger.settings_
    assert loaded.anchors_ == tagger.anchors_
    assert loaded.known_words_ == tagger.known_words_
    loaded.save(tmp_path / "again")
    assert contents(tmp_path / "again") == contents(tmp_path / "model")


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_bytes_with_any_number_of_workers(
    kind: ModelKind, train: LabelledCorpus, raw: Path, tmp_path: Path
) -> None:
    for workers in (1, 2):
        AnchorTagger(kind, settings=SETTINGS).fit(train, read_raw(raw), workers=workers).save(tmp_path / str(workers))
    assert contents(tmp_path / "1") == contents(tmp_path / "2")


def test_raw_text_helps(train: LabelledCorpus, test: LabelledCorpus, raw: Path) -> None:
    few = train.subset(range(12))
    alone = AnchorTagger(settings=SETTINGS).fit(few).score(test)
    assert AnchorTagger(settings=SETTINGS).fit(few, read_raw(raw)).score(test) > alone


def test_counts_stand_for_raw_text(train: LabelledCorpus, test: LabelledCorpus, raw: Path) -> None:
    text = read_raw(raw)
    counted = AnchorTagger(settings=SETTINGS).fit(train, count_text(text, train.words, 1))
    assert counted.predict(test.words) == AnchorTagger(settings=SETTINGS).fit(train, text).predict(test.words)


@pytest.mark.parametrize("kind", KINDS)
def test_partly_labelled_sentences(kind: ModelKind, train: LabelledCorpus, test: LabelledCorpus, raw: Path) -> None:
    partly = without(train, 0.4)
    tagger = AnchorTagger(kind, settings=SETTINGS).fit(partly, read_raw(raw))
    assert tagger.score(test) > 0.85
    assert tagger.evaluate(without(test, 0.5)).tokens < tagger.evaluate(test).tokens


def test_runs_of_labelled_words() -> None:
    assert labelled_runs(["A", None, "B", "A", None]) == [(0, 1), (2, 4)]
    assert labelled_runs(["A", "B"]) == [(0, 2)]
    assert labelled_runs([None]) == []
    assert labelled_runs([]) == []


def test_a_dictionary_restrains_words(train: LabelledCorpus, test: LabelledCorpus, raw: Path) -> None:
    few = train.subset(range(8))
    listed: dict[str, set[str]] = {}
    for words, tags in zip(test.words, test.tags, strict=True):
        for word, tag in zip(words, tags, strict=True):
            assert tag is not None
            listed.setdefault(word, set()).add(tag)
    dictionary = {word: frozenset(tags) for word, tags in listed.items()}
    plain = AnchorTagger(settings=SETTINGS).fit(few, read_raw(raw)).score(test)
    assert AnchorTagger(settings=SETTINGS).fit(few, read_raw(raw), dictionary).score(test) > plain


@pytest.mark.parametrize("kind", ["hmm", "crf"])
def test_settings_are_chosen_on_dev(kind: ModelKind, train: LabelledCorpus, test: LabelledCorpus, raw: Path) -> None:
    few, dev = train.subset(range(20)), draw_corpus(40, seed=4)
    default = AnchorTagger(kind, settings=SETTINGS).fit(few, read_raw(raw))
    chosen = AnchorTagger(kind, settings=SETTINGS).fit(few, read_raw(raw), dev=dev)
    assert chosen.score(dev) >= default.score(dev) - 0.01
    changed = {"lexicon", "chain"} if kind == "crf" else {"lexicon"}
    kept = {name: getattr(default.settings_, name) for name in changed}
    assert replace(chosen.settings_, **kept) == default.settings_


def test_tweets_are_tagged_by_their_normal_forms(tmp_path: Path, train: LabelledCorpus) -> None:
    words = tuple(("@someone", *sentence) for sentence in train.words)
    corpus = LabelledCorpus(words, tuple(("X", *tags) for tags in train.tags))
    path = write_raw(tmp_path / "raw.txt", corpus)
    tagger = AnchorTagger(settings=SETTINGS).fit(corpus, read_raw(path, style="tweets"), {"@you": frozenset({"X"})})
    assert "@USER" in tagger.known_words_
    assert tagger.predict([["@nobody"]]) == [["X"]]
    tagger.save(tmp_path / "model")
    assert AnchorTagger.load(tmp_path / "model").predict([["@nobody"]]) == [["X"]]


def test_tags_may_have_any_name() -> None:
    assert tag_set({"a": ["zed", "NOUN", "start"], "b": ["."]}, {"c": frozenset({"VERB"})}) == (
        "NOUN", "VERB", ".", "start", "zed",
    )  # fmt: skip


def test_unknown_words_are_those_without_a_label(tagger: AnchorTagger, test: LabelledCorpus) -> None:
    scores = tagger.evaluate(test)
    assert isinstance(scores, Scores)
    assert scores.unknown_tokens == sum(word not in tagger.known_words_ for words in test.words for word in words)


def test_a_model_replaces_a_model_and_nothing_else(tmp_path: Path, train: LabelledCorpus) -> None:
    tagger = AnchorTagger(settings=SETTINGS).fit(train)
    folder = tmp_path / "model"
    folder.mkdir()
    tagger.save(folder)
    tagger.save(folder)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("keep me")
    with pytest.raises(InputError, match="no predplan model"):
        tagger.save(tmp_path / "notes")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model", "notes"]


def test_a_broken_model_names_its_file_and_the_remedy(tmp_path: Path, train: LabelledCorpus) -> None:
    tagger = AnchorTagger("crf", settings=SETTINGS).fit(train)
    tagger.save(tmp_path / "model")
    for name in ("lexicon", "classifier", "transitions", "anchors", "chain"):
        path = tmp_path / "model" / f"{name}.parquet"
        whole = path.read_bytes()
        for damage in (whole[: len(whole) // 2], None):
            path.unlink()
            if damage is not None:
                path.write_bytes(damage)
            with pytest.raises(InputError, match=rf"{name}.parquet.*predplan label fit"):
                AnchorTagger.load(tmp_path / "model")
            path.write_bytes(whole)
    header = json.loads((tmp_path / "model" / "model.json").read_text())
    for change, message in (
        ({"version": 99}, "version 99.*predplan label fit"),
        ({"format": "other"}, "not the header"),
        ({"kind": "tree"}, "unknown kind"),
        ({"tags": ["A"]}, "model.json|transitions"),
        ({"settings": {"unheard": 1}}, "unheard"),
    ):
        (tmp_path / "model" / "model.json").write_text(json.dumps({**header, **change}))
        with pytest.raises(InputError, match=message):
            AnchorTagger.load(tmp_path / "model")
    with pytest.raises(InputError, match="no such folder"):
        AnchorTagger.load(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"model\.json"):
        AnchorTagger.load(tmp_path)


def test_bad_arguments(train: LabelledCorpus) -> None:
    make: Any = AnchorTagger
    for arguments, message in (
        ({"model": "tree"}, "model: found 'tree'"),
        ({"loss": "hinge"}, "loss: found 'hinge'"),
        ({"lam": 1.5}, "lambda: found 1.5"),
        ({"seed": -1}, "seed: found -1"),
    ):
        with pytest.raises(InputError, match=message):
            make(**arguments)
    with pytest.raises(InputError, match="at least two"):
        AnchorTagger().fit(LabelledCorpus((("a", "b"),), (("NOUN", None),)))
    with pytest.raises(InputError, match="not trained"):
        AnchorTagger().predict([["a"]])
    with pytest.raises(InputError, match="sentence 1: found the gold tag 'ODD'"):
        AnchorTagger(settings=SETTINGS).fit(train).score(LabelledCorpus((("a",),), (("ODD",),)))


def test_malformed_raw_lines_are_dropped_and_said(
    tmp_path: Path, train: LabelledCorpus, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "raw.txt"
    path.write_bytes(b"good line\n\xff\xfe bad\nnul \0 line\n")
    with caplog.at_level("WARNING"):
        AnchorTagger(settings=SETTINGS).fit(train, read_raw(path))
    assert "dropped 2 malformed of 3 lines (1 not UTF-8, 1 with NUL, 0 too long)" in caplog.text


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
