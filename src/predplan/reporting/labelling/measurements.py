"""What stands beside the accuracies: training times, tests, choices on dev, and ablations."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

from predplan.labelling.methods import METHODS
from predplan.reporting.document import Cell, Table
from predplan.reporting.labelling.results import CorpusResults, size_of, summarise, summary
from predplan.reporting.labelling.tables import MISSING, accuracy_cell
from predplan.reporting.labelling.thesis import TRAINING_HOURS


def time_table(corpus: CorpusResults) -> Table:
    """Training times beside the thesis's, and as multiples of the anchor HMM's."""
    found = summarise(corpus.costs, "training_s")
    rows: list[tuple[str | Cell, ...]] = []
    for method in METHODS:
        if not any((method, size) in found for size in corpus.sizes):
            continue
        cells: list[str | Cell] = [METHODS[method].label]
        for size in corpus.sizes:
            time, anchor = found.get((method, size)), found.get(("anchor", size))
            cells.append(MISSING if time is None else seconds(time.mean))
            cells.append(MISSING if time is None or anchor is None else _times(time.mean / anchor.mean))
        hours = TRAINING_HOURS.get(method) if corpus.source == "twitter" else None
        rows.append((*cells, MISSING if hours is None else f"{hours} h"))
    header = [name for size in corpus.sizes for name in (f"{size:,}: time", f"{size:,}: to anchor HMM")]
    return Table(
        ("Method", *header, "thesis"),
        tuple(rows),
        f"Training times on {corpus.title}. Wall time, mean over draws, all in one run on one machine; tokenising and "
        "counting the raw text, which all but the supervised ones need once, are left out. Beside each, how many times "
        "as long as the anchor HMM took. Thesis: 2.7 million tweets on its machine.",
    )


def comparison_table(corpus: CorpusResults) -> Table:
    """Differences with intervals and tests, over the draws of each size."""
    groups: defaultdict[tuple[int, str, str], list[Mapping[str, float]]] = defaultdict(list)
    for row in corpus.comparisons:
        groups[size_of(row["subset"]), row["method"], row["other"]].append(row)
    order = list(METHODS)
    rows: list[tuple[str | Cell, ...]] = []
    last = ""
    for (size, method, other), drawn in sorted(
        groups.items(), key=lambda item: (item[0][0], order.index(item[0][1]), order.index(item[0][2]))
    ):
        heading = f"{METHODS[method].label}, {size:,} labelled sentences, against"
        if heading != last:
            rows.append((heading,))
            last = heading
        better, worse = sum(row["low"] > 0 for row in drawn), sum(row["high"] < 0 for row in drawn)
        rows.append(
            (
                METHODS[other].label,
                f"{100 * summary(row['difference'] for row in drawn).mean:+.1f}",
                f"{100 * min(row['low'] for row in drawn):+.1f} to {100 * max(row['high'] for row in drawn):+.1f}",
                f"{better} / {worse} of {len(drawn)}",
                probability(max(row["mcnemar_p"] for row in drawn)),
                probability(max(row["ks_p"] for row in drawn)),
            )
        )
    return Table(
        ("Other method", "Difference", "95 % intervals", "Better / worse", "McNemar p", "KS p"),
        tuple(rows),
        f"Differences of accuracy on {corpus.title}, points. The mean over draws; the hull of their 95 % bootstrap "
        "intervals (test sentences drawn anew 1,000 times); in how many draws the whole interval lies above and below "
        "zero; and the largest p-value over draws of McNemar's test and of the thesis's Kolmogorov-Smirnov test. "
        "p-values are not corrected for the number of pairs.",
    )


def chosen_table(corpus: CorpusResults) -> Table:
    """What was chosen on the development sentences."""
    drawn: defaultdict[tuple[str, int], dict[str, None]] = defaultdict(dict)
    for row in corpus.costs:
        if row["chosen"]:
            drawn[row["method"], size_of(row["subset"])][row["chosen"]] = None
    dev = summarise(corpus.costs, "dev_accuracy", 100)
    rows = []
    for method in METHODS:
        for size in corpus.sizes:
            if (method, size) in drawn:
                choices = " | ".join(drawn[method, size])
                rows.append((METHODS[method].label, f"{size:,}", f"{dev[method, size].mean:.1f}", choices))
    return Table(
        ("Method", "Labelled", "Dev accuracy, %", "Chosen"),
        tuple(rows),
        f"Chosen on the development sentences of {corpus.title}. Where draws differ, each choice is named.",
    )


def ablation_table(corpus: CorpusResults) -> Table:
    """Accuracy on dev with one thing changed at a time."""
    found: defaultdict[tuple[str, str, bool], defaultdict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in corpus.ablations:
        found[row["component"], row["setting"], row["default"]][size_of(row["subset"])].append(
            100 * row["dev_accuracy"]
        )
    sizes = sorted({size for each in found.values() for size in each})
    rows: list[tuple[str | Cell, ...]] = []
    last = ""
    for (component, setting, default), by_size in found.items():
        if component != last:
            rows.append((component,))
            last = component
        cells = [accuracy_cell(summary(by_size[size]) if size in by_size else None, None, 0.0) for size in sizes]
        rows.append((f"{setting} (default)" if default else setting, *cells))
    return Table(
        ("Setting", *(f"{size:,}" for size in sizes)),
        tuple(rows),
        f"Ablations on {corpus.title}. Accuracy of the anchor HMM on the development sentences, %, with one thing "
        "changed at a time, by labelled sentences: mean over draws, beside it their range.",
    )


def seconds(time_s: float) -> str:
    """A time in s with two digits, not below what a clock tells."""
    return "< 0.001 s" if time_s < 0.001 else f"{time_s:#.2g} s" if time_s < 10 else f"{time_s:,.0f} s"


def probability(p: float) -> str:
    """A p-value, not below what it means."""
    return "< .001" if p < 0.001 else f"{p:.3f}".removeprefix("0")


def _times(ratio: float) -> str:
    return f"{ratio:.2g} ×" if ratio < 10 else f"{ratio:,.0f} ×"
