"""The report on labelling, put together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from predplan.labelling.methods import METHODS
from predplan.reporting.document import Block, Items, Section, Table, Tagged, TaggedWord, Text
from predplan.reporting.labelling import figures, measurements, tables
from predplan.reporting.labelling.departures import DEPARTURES
from predplan.reporting.labelling.results import CorpusResults, size_of

EXAMPLES = 8

WHAT = (
    "A few labelled sentences and much raw text become a part-of-speech tagger. Anchor words, which nearly always have "
    "one tag, tell what surrounds each tag; the neighbours of every other word, counted in one pass over the raw text, "
    "are then a mixture of those surroundings, and the mixture's weights are the word's tags. From them follow the "
    "emissions of an HMM, or of one with features (FHMM), and features for a CRF, without tagging the raw text once."
)
HOW = (
    "Everything was chosen on development sentences; test labels are read only where these numbers are made. Training "
    "sets are drawn by seed, and every method has the same ones. Baselines: supervised HMM and FHMM, EM and "
    "self-training on the same raw text, CRFs on the labels alone and with word clusters."
)


def labelling_section(corpora: Sequence[CorpusResults]) -> Section:
    """The whole report on labelling."""
    return Section(
        "Labelling",
        (Text(WHAT), tables.headline_table(corpora), Text(HOW)),
        (
            *(corpus_section(corpus) for corpus in corpora),
            Section("Table 3.4", (tables.table_3_4(corpora),)),
            Section("What differs from the thesis, and why", (Items(DEPARTURES),)),
        ),
    )


def corpus_section(corpus: CorpusResults) -> Section:
    """One corpus: its data, chapter 3's tables and figure, times, tests, mistakes."""
    chosen: tuple[Block, ...] = (measurements.chosen_table(corpus),)
    ablations: tuple[Block, ...] = (
        (figures.ablations(corpus), measurements.ablation_table(corpus)) if corpus.ablations else ()
    )
    sections = (
        Section("Training times", (figures.training_times(corpus), measurements.time_table(corpus)), folded=True),
        Section("Tests", (figures.differences(corpus), measurements.comparison_table(corpus)), folded=True),
        *((Section("Ablations", ablations, folded=True),) if ablations else ()),
        Section("Mistakes", (figures.confusion(corpus), tag_table(corpus), tagged_examples(corpus)), folded=True),
        Section("What was chosen on dev", chosen, folded=True),
    )
    main = (
        Text(data_text(corpus)),
        tables.table_3_1(corpus),
        figures.learning_curve(corpus),
        tables.table_3_2(corpus),
        tables.table_3_3(corpus),
    )
    return Section(corpus.title, main, sections)


def data_text(corpus: CorpusResults) -> str:
    """Which data were used, and what of the raw text was malformed."""
    parts = "; ".join(
        f"{part} {size['sentences']:,} sentences, {size['tokens']:,} words"
        for part, size in corpus.facts["parts"].items()
    )
    malformed = corpus.raw["malformed"]
    faults = (
        f"{malformed['bad_utf8']:,} with bad UTF-8, {malformed['nul']:,} with NUL, {malformed['too_long']:,} too long"
    )
    entries = corpus.facts["dictionary_entries"]
    dictionary = f" Tag dictionary: {entries:,} entries." if entries else ""
    return (
        f"Sources: {'; '.join(corpus.facts['sources'])}. Labelled: {parts}.{dictionary} Raw text: "
        f"{corpus.raw['lines']:,} lines, {corpus.raw['tokens']:,} tokens, {corpus.raw['words']:,} different words; "
        f"malformed lines: {faults}."
    )


def tag_table(corpus: CorpusResults) -> Table:
    """Precision, recall and F1 of the best tagger's tags, on one draw."""
    method, subset = corpus.tagged[0]["method"], corpus.tagged[0]["subset"]
    rows = [row for row in corpus.tag_scores if row["method"] == method and row["subset"] == subset]
    return Table(
        ("Tag", "Precision", "Recall", "F1", "Test words"),
        tuple(
            (
                row["tag"],
                f"{100 * row['precision']:.1f}",
                f"{100 * row['recall']:.1f}",
                f"{100 * row['f1']:.1f}",
                f"{row['support']:,}",
            )
            for row in rows
        ),
        f"Tags of {METHODS[method].label} on {corpus.title}, %, first draw of {size_of(subset)} labelled sentences.",
    )


def tagged_examples(corpus: CorpusResults) -> Tagged:
    """Some test sentences as tagged by the best method and by the supervised HMM."""
    sentences: defaultdict[tuple[str, ...], dict[str, tuple[TaggedWord, ...]]] = defaultdict(dict)
    for row in corpus.tagged:
        words = zip(row["words"], row["gold"], row["predicted"], strict=True)
        sentences[tuple(row["words"])][METHODS[row["method"]].label] = tuple(TaggedWord(*each) for each in words)
    with_mistakes = [
        each for each in sentences.values() if any(word.wrong for words in each.values() for word in words)
    ]
    step = max(1, len(with_mistakes) // EXAMPLES)
    return Tagged(
        tuple(tuple(each.items()) for each in with_mistakes[::step][:EXAMPLES]),
        f"Test sentences with mistakes, {size_of(corpus.tagged[0]['subset'])} labelled sentences. A wrong tag is "
        "struck out, the right one follows it.",
    )
