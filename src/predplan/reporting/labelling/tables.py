"""Accuracies: Tables 3.1 to 3.4, and one table of what a user would choose among."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from predplan.labelling.methods import METHODS
from predplan.reporting.document import Cell, Table
from predplan.reporting.labelling.results import CorpusResults, Summary, summarise
from predplan.reporting.labelling.thesis import TABLE_3_1, TABLE_3_2, TABLE_3_3, TABLE_3_4

MISSING = "-"
Published = Mapping[str, Mapping[int, float]]

ROWS_3_1: tuple[tuple[str, str | None, str | None], ...] = (
    ("Supervised", None, None),
    ("add-one for unknown words", "supervised-addone", None),
    ("unknown words judged by spelling", "supervised", "supervised-fhmm"),
    ("Semi-supervised", None, None),
    ("EM", "em", "em-fhmm"),
    ("self-training", "self-training", "self-training-fhmm"),
    ("Anchors, after the thesis", None, None),
    ("least squares, λ = 0", "anchor-lambda0", "anchor-literal-lambda0"),
    ("least squares, λ = 1", "anchor-lambda1", "anchor-literal-lambda1"),
    ("KL, λ = 0", "anchor-kl-lambda0", "anchor-fhmm-lambda0"),
    ("KL, λ = 1", "anchor-kl-lambda1", "anchor-fhmm-lambda1"),
    ("Anchors, ours", None, None),
    ("calibrated on the labels", "anchor", "anchor-fhmm"),
)
ROWS_3_2 = (
    ("counts (ML), λ = 1", "anchor-fhmm-lambda1"),
    ("composite likelihood (CL), λ = 1", "anchor-composite-lambda1"),
    ("composite likelihood (CL), λ = 0", "anchor-composite-lambda0"),
    ("counts, ours", "anchor-fhmm"),
)
ROWS_3_3 = (
    ("same features", "crf"),
    ("same + posteriors", "crf-posteriors"),
    ("same + clusters", "crf-clusters"),
    ("same + clusters + posteriors", "crf-clusters-posteriors"),
    ("all features", "crf-all"),
    ("all + posteriors", "crf-all-posteriors"),
    ("all + clusters", "crf-all-clusters"),
    ("all + clusters + posteriors", "crf-all-clusters-posteriors"),
)
ROWS_3_4 = (
    "supervised-fhmm",
    "em-fhmm",
    "self-training-fhmm",
    "anchor-fhmm-lambda1",
    "anchor",
    "anchor-fhmm",
    "crf",
    "crf-clusters",
    "crf-posteriors",
    "crf-clusters-posteriors",
)
HEADLINE = (
    "supervised",
    "em",
    "self-training",
    "crf",
    "crf-clusters",
    "anchor",
    "anchor-fhmm",
    "crf-posteriors",
    "crf-clusters-posteriors",
)

READING = "Accuracy per test word, %: mean over the draws of the training set, beside it the least and the greatest"


def headline_table(corpora: Sequence[CorpusResults]) -> Table:
    """The methods a user would choose among, a row for each corpus and size."""
    rows: list[tuple[str | Cell, ...]] = []
    for corpus in corpora:
        found = summarise(corpus.scores, "accuracy", 100)
        for size in corpus.sizes:
            cells = _row([found.get((method, size)) for method in HEADLINE])
            rows.append((f"{corpus.title}, {size:,}", *cells))
    return Table(
        ("Corpus, labelled sentences", *(METHODS[method].label for method in HEADLINE)),
        tuple(rows),
        "Accuracy per test word, %, mean over draws of the training set. The best of each row stands out.",
    )


def table_3_1(corpus: CorpusResults) -> Table:
    """Table 3.1: baselines and anchor models, HMM and FHMM."""
    found = summarise(corpus.scores, "accuracy", 100)
    published = TABLE_3_1 if corpus.source == "twitter" else {}
    columns = [(side, size) for side in (1, 2) for size in corpus.sizes]
    best = {
        (side, size): max((_mean(found, (row[side], size)) for row in ROWS_3_1 if row[side]), default=0.0)
        for side, size in columns
    }
    rows: list[tuple[str | Cell, ...]] = []
    for row in ROWS_3_1:
        if row[1] is row[2] is None:
            rows.append((row[0],))
            continue
        cells = []
        for side, size in columns:
            method = str(row[side])
            cells.append(
                accuracy_cell(found.get((method, size)), published.get(method, {}).get(size), best[side, size])
            )
        rows.append((row[0], *cells))
    names = {1: "HMM", 2: "FHMM"}
    return Table(
        ("Method", *(f"{names[side]}, {size:,}" for side, size in columns)),
        tuple(rows),
        f"Table 3.1 on {corpus.title}: models, labelled sentences. {_reading(bool(published))}",
    )


def table_3_2(corpus: CorpusResults) -> Table:
    """Table 3.2: transitions by counts and by composite likelihood."""
    return _by_size(corpus, "Table 3.2", "transitions of the anchor FHMM", ROWS_3_2, TABLE_3_2)


def table_3_3(corpus: CorpusResults) -> Table:
    """Table 3.3: stacked taggers."""
    return _by_size(
        corpus,
        "Table 3.3",
        "CRF with further features. In the thesis a MEMM; all features add a published tag dictionary where one exists",
        ROWS_3_3,
        TABLE_3_3,
    )


def table_3_4(corpora: Sequence[CorpusResults]) -> Table:
    """Table 3.4: every corpus with all its labelled sentences; the thesis has Malagasy."""
    found = [summarise(corpus.scores, "accuracy", 100) for corpus in corpora]
    best = [
        max((_mean(each, (m, c.sizes[-1])) for m in ROWS_3_4), default=0.0)
        for c, each in zip(corpora, found, strict=True)
    ]
    rows: list[tuple[str | Cell, ...]] = []
    for method in ROWS_3_4:
        cells = []
        for corpus, each, top in zip(corpora, found, best, strict=True):
            published = TABLE_3_4.get(method, {}) if corpus.source == "malagasy" else {}
            number = published.get("malagasy with dictionary" if corpus.dictionary else "malagasy")
            cells.append(accuracy_cell(each.get((method, corpus.sizes[-1])), number, top))
        rows.append((METHODS[method].label, *cells))
    return Table(
        ("Method", *(f"{corpus.title}, {corpus.sizes[-1]:,}" for corpus in corpora)),
        tuple(rows),
        "Table 3.4, here for every corpus with the largest training set, its size beside the name. "
        + _reading(any(corpus.source == "malagasy" for corpus in corpora)),
    )


def accuracy_cell(found: Summary | None, published: float | None, best: float) -> Cell:
    """A mean with its range, the published number, and whether it is the best of its column or row."""
    thesis = "" if published is None else f"{published:g}" if published % 1 else f"{published:.1f}"
    if found is None:
        return Cell(MISSING, published=thesis)
    spread = f"{found.low:.1f}–{found.high:.1f}" if found.draws > 1 else ""
    return Cell(f"{found.mean:.1f}", spread, thesis, round(found.mean, 1) >= round(best, 1) > 0)


def _by_size(
    corpus: CorpusResults, name: str, what: str, methods: Sequence[tuple[str, str]], numbers: Published
) -> Table:
    found = summarise(corpus.scores, "accuracy", 100)
    published = numbers if corpus.source == "twitter" else {}
    best = {size: max(_mean(found, (method, size)) for _, method in methods) for size in corpus.sizes}
    rows: list[tuple[str | Cell, ...]] = []
    for label, method in methods:
        cells = [
            accuracy_cell(found.get((method, size)), published.get(method, {}).get(size), best[size])
            for size in corpus.sizes
        ]
        rows.append((label, *cells))
    return Table(
        ("Method", *(f"{size:,} labelled" for size in corpus.sizes)),
        tuple(rows),
        f"{name} on {corpus.title}: {what}. {_reading(bool(published))}",
    )


def _row(values: Sequence[Summary | None]) -> list[Cell]:
    best = max((value.mean for value in values if value), default=0.0)
    return [replace(accuracy_cell(value, None, best), spread="") for value in values]


def _mean(found: Mapping[tuple[str, int], Summary], key: tuple[str | None, int]) -> float:
    method, size = key
    value = found.get((method, size)) if method else None
    return value.mean if value else 0.0


def _reading(published: bool) -> str:
    return f"{READING}{', and the thesis’s number' if published else ''}."
