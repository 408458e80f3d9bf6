"""The estimator: a tagger from a few labelled sentences and raw text, with scikit-learn's habits."""

from __future__ import annotations

import logging
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from predplan.artifacts.provenance import Provenance
from predplan.errors import InputError
from predplan.labelling import storage, tweets
from predplan.labelling.anchors import Anchors
from predplan.labelling.counting import BigramCounts, count_sentences
from predplan.labelling.decoding import Transitions
from predplan.labelling.lexicon import Lexicon, Supervision, build_lexicon
from predplan.labelling.model_tables import AnchorWord
from predplan.labelling.models import HiddenMarkovModel, SequenceModel, Tokens, decode, decode_posteriors
from predplan.labelling.posteriors import ContextPosteriors, Loss
from predplan.labelling.readers import RawText, Style
from predplan.labelling.selection import select_settings
from predplan.labelling.sentences import UNIVERSAL_TAGS, LabelledCorpus, TokenBatch, label_counts
from predplan.labelling.storage import ModelKind, TrainedTagger
from predplan.labelling.tokenising import LineReport, normalise, read_blocks, split_block, tokenise_chunks
from predplan.labelling.training import (
    RawStatistics,
    TrainingSettings,
    learn_evidence,
    raw_statistics,
    train_chain_model,
    train_feature_model,
)
from predplan.labelling.transitions import counted_transitions

if TYPE_CHECKING:
    from predplan.labelling.evaluation import Scores

Floats = NDArray[np.float64]
Dictionary: TypeAlias = Mapping[str, frozenset[str]]
SENTENCES_AT_ONCE = 8192

logger = logging.getLogger(__name__)


class AnchorTagger:
    """A part-of-speech tagger learned from anchor words.

    `fit` sets tags_ (K names, in the order of all arrays), anchors_ (the anchor words of every tag), contexts_ (what
    contexts say of the listed raw words; None in a loaded tagger), lexicon_ (p(tag | word)), transitions_, model_ (the
    sequence model), known_words_ (the labelled words) and settings_ (those in force, chosen on dev where given).
    """

    tags_: tuple[str, ...]
    anchors_: tuple[AnchorWord, ...]
    contexts_: ContextPosteriors | None
    lexicon_: Lexicon
    transitions_: Transitions
    model_: SequenceModel
    known_words_: frozenset[str]
    settings_: TrainingSettings

    def __init__(
        self,
        model: ModelKind = "hmm",
        loss: Loss = "kl",
        lam: float = 1.0,
        seed: int = 0,
        settings: TrainingSettings | None = None,
    ) -> None:
        """model: hmm, fhmm (feature HMM) or crf (on the posteriors); loss: kl or ls, of the word mixtures;
        lam: weight of a word's own labels, 0 to 1. loss and lam override those in `settings`.

        Raises InputError for values other than these.
        """
        if model not in get_args(ModelKind):
            raise InputError(f"model: found {model!r}, expected one of {', '.join(get_args(ModelKind))}")
        if loss not in get_args(Loss):
            raise InputError(f"loss: found {loss!r}, expected one of {', '.join(get_args(Loss))}")
        if not 0.0 <= lam <= 1.0:
            raise InputError(f"lambda: found {lam}, expected a number from 0 to 1")
        if seed < 0:
            raise InputError(f"seed: found {seed}, expected a whole number, not negative")
        self.model, self.loss, self.lam, self.seed, self.settings = model, loss, lam, seed, settings
        self._trained: TrainedTagger | None = None

    def fit(
        self,
        labelled: LabelledCorpus,
        raw: RawText | BigramCounts | None = None,
        dictionary: Dictionary | None = None,
        dev: LabelledCorpus | None = None,
        workers: int = 1,
    ) -> AnchorTagger:
        """Learn from labelled sentences, raw text, a tag dictionary and sentences to choose settings on (selection.py).

        The labelled sentences count as raw text too; BigramCounts are taken as they are, words and all. A text of style
        "tweets" has labels, dictionary and later sentences brought to the forms of its tokens. The tagger is the same
        for any number of workers. Raises InputError where a tag has no possible anchor or only one tag is labelled.
        """
        style: Style = raw.style if isinstance(raw, RawText) else "spaces"
        labelled = normalise(labelled, style)
        supervision = Supervision(label_counts(labelled), _normalised_dictionary(dictionary or {}, style))
        tags = tag_set(supervision.labels, supervision.dictionary)
        if len(tags) < 2:
            raise InputError(f"labelled data: found {len(tags)} tags, expected at least two; a tag _ is no label")
        bigrams = raw if isinstance(raw, BigramCounts) else count_text(raw, labelled.words, workers)
        settings, raw_tokens, raw_words = self._settings(), int(bigrams.count.sum()), len(bigrams.vocabulary)
        logger.info("measuring the contexts of %d words", raw_words)
        statistics = raw_statistics(bigrams, settings.moments, self.seed)
        del bigrams  # the largest object of all, and not needed again
        logger.info("judging words by their contexts")
        anchors, contexts, evidence = learn_evidence(statistics, supervision, tags, settings, self.seed)
        transitions = counted_transitions(labelled, tags)
        if dev is not None:
            logger.info("choosing settings on %d development sentences", len(dev))
            chosen_on, chain = normalise(dev, style), self.model == "crf"
            settings = select_settings(
                chosen_on, labelled, supervision, evidence, transitions, tags, settings, self.seed, chain
            )
        logger.info("judging words by spelling, contexts and labels")
        lexicon = build_lexicon(supervision, evidence, tags, settings.lexicon)
        logger.info("training the %s", self.model)
        model: SequenceModel = HiddenMarkovModel(lexicon, transitions)
        if self.model == "fhmm":
            model = train_feature_model(
                list(lexicon.word_ids), lexicon.count, lexicon.probabilities, transitions, settings
            )
        elif self.model == "crf":
            model = train_chain_model(
                labelled, supervision.dictionary, lexicon, evidence, {}, tags, settings, self.seed
            )
        labels = {word: of.total() for word, of in supervision.labels.items()}
        data = {
            "labelled_sentences": len(labelled),
            "labelled_tokens": sum(labels.values()),
            "raw_tokens": raw_tokens,
            "raw_words": raw_words,
            "dictionary_words": len(supervision.dictionary),
        }
        words = _anchor_words(anchors, statistics, supervision, tags)
        provenance = Provenance({"settings": asdict(settings), "data": data}, self.seed)
        self._take(TrainedTagger(self.model, style, tags, settings, provenance, lexicon, labels, words, model))
        self.contexts_ = contexts
        return self

    def predict(self, sentences: Iterable[Sequence[str]]) -> list[list[str]]:
        """The tag of each word: of the fewest expected errors."""
        names = np.array(self._fitted().tags, object)
        return [
            names[tags].tolist()
            for tokens in self._batches(sentences)
            for tags in np.split(decode(self.model_, tokens), tokens.offsets[1:-1])
        ]

    def predict_proba(self, sentences: Iterable[Sequence[str]]) -> list[Floats]:
        """p(tag | sentence) of each word: an array [words, K] a sentence."""
        return [
            tags
            for tokens in self._batches(sentences)
            for tags in np.split(decode_posteriors(self.model_, tokens), tokens.offsets[1:-1])
        ]

    def score(self, corpus: LabelledCorpus) -> float:
        """Accuracy over the labelled words of a corpus."""
        return self.evaluate(corpus).accuracy

    def evaluate(self, corpus: LabelledCorpus) -> Scores:
        """All scores on a corpus. Raises InputError for a tag that the tagger does not know."""
        from predplan.labelling.evaluation import score  # draws in scipy.stats, which tagging need not wait for

        normal = normalise(corpus, self._fitted().style)
        return score(normal, self.predict(normal.words), self.known_words_, self.tags_)

    def save(self, folder: Path | str) -> None:
        """Write the model's folder, in place of a predplan model that may be there; see storage.py."""
        storage.save(self._fitted(), Path(folder))

    @classmethod
    def load(cls, folder: Path | str) -> AnchorTagger:
        """The tagger from a model's folder. Raises InputError naming the file at fault and the remedy."""
        trained = storage.load(Path(folder))
        settings = trained.settings
        tagger = cls(
            trained.kind, settings.posteriors.loss, settings.lexicon.lam, trained.provenance.seed or 0, settings
        )
        tagger._take(trained)
        return tagger

    def _fitted(self) -> TrainedTagger:
        if self._trained is None:
            raise InputError("the tagger is not trained: call fit, or load a saved one")
        return self._trained

    def _settings(self) -> TrainingSettings:
        given = self.settings or TrainingSettings()
        return replace(
            given,
            posteriors=replace(given.posteriors, loss=self.loss),
            lexicon=replace(given.lexicon, lam=self.lam),
        )

    def _take(self, trained: TrainedTagger) -> None:
        trained = storage.in_single_precision(trained)
        self._trained = trained
        self.tags_, self.anchors_, self.contexts_ = trained.tags, trained.anchors, None
        self.lexicon_, self.model_, self.transitions_ = trained.lexicon, trained.model, trained.model.transitions
        self.known_words_, self.settings_ = frozenset(trained.labels), trained.settings

    def _batches(self, sentences: Iterable[Sequence[str]]) -> Iterator[Tokens]:
        style = self._fitted().style
        remaining = iter(sentences)
        while batch := tuple(tuple(words) for words in islice(remaining, SENTENCES_AT_ONCE)):
            tokens = Tokens.of(batch)
            if style == "tweets":
                tokens = replace(tokens, words=tuple(map(tweets.normalise, tokens.words)))
            yield tokens


def tag_set(*tags_by_word: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    """All tags of some words: universal ones in their order, then the others by name."""
    found = {tag for by_word in tags_by_word for tags in by_word.values() for tag in tags}
    known = [tag for tag in UNIVERSAL_TAGS if tag in found]
    return (*known, *sorted(found.difference(known)))


def count_text(raw: RawText | None, sentences: Sequence[Sequence[str]], workers: int) -> BigramCounts:
    """Bigram counts of raw text and of further sentences. Malformed lines are dropped, with a warning in the log."""
    from predplan import parallel  # joblib, which only training needs

    report = LineReport()

    def batches() -> Iterator[TokenBatch]:
        nonlocal report
        tokens = Tokens.of(sentences)
        yield TokenBatch(tokens.words, tokens.ids.astype(np.int32), tokens.offsets)
        if raw is None:
            return
        tokenise = partial(tokenise_chunks, style=raw.style)
        chunks = parallel.ahead(map(split_block, read_blocks(raw)))
        for batch, part in parallel.run(tokenise, chunks, workers=workers):
            report += part
            logger.info("counting raw text: %d tokens", report.tokens)
            yield batch

    with tempfile.TemporaryDirectory() as folder:
        counts = count_sentences(parallel.ahead(batches()), Path(folder))
    if report.malformed:
        logger.warning(
            "raw text: dropped %d malformed of %d lines (%d not UTF-8, %d with NUL, %d too long)",
            report.malformed, report.lines, report.bad_utf8, report.nul, report.too_long,
        )  # fmt: skip
    return counts


def _normalised_dictionary(dictionary: Dictionary, style: Style) -> Dictionary:
    if style == "spaces":
        return dictionary
    allowed: dict[str, frozenset[str]] = {}
    for word, tags in dictionary.items():
        normal = tweets.normalise(word)
        allowed[normal] = allowed.get(normal, frozenset()) | tags
    return allowed


def _anchor_words(
    anchors: Anchors, raw: RawStatistics, supervision: Supervision, tags: Sequence[str]
) -> tuple[AnchorWord, ...]:
    """Anchors by tag, most frequent word first."""
    found = []
    for place, tag in enumerate(tags):
        for word_id in anchors.chosen[:, place].nonzero()[0].tolist():
            word = raw.moments.vocabulary[word_id]
            labels = supervision.labels.get(word, Counter())
            times = labels.total()
            purity = labels.get(tag, 0) / times if times else 1.0
            found.append(AnchorWord(tag, word, purity, times, int(raw.moments.word_count[word_id])))
    return tuple(found)
