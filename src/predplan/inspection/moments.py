"""The page of the moments: which word stands before which, and how often."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from scipy.cluster.hierarchy import leaves_list, linkage

from predplan.artifacts.tables import read_provenance, read_table
from predplan.inspection.figures import Panel, Scale, heat_maps
from predplan.inspection.labelling import corpus_of
from predplan.inspection.markdown import about, escape, markdown_table
from predplan.inspection.palette import DIVERGING
from predplan.inspection.plots import zipf_plot
from predplan.inspection.recording import Page, log_picture, log_text, picture_view, text_view
from predplan.labelling.tables import BIGRAMS, WORDS

Floats = NDArray[np.float64]

EDGE = "‹edge›"
SHOWN_WORDS, SHOWN_PAIRS, MOST_BITS = 40, 20, 5.0


def draw_moments(recording: rr.RecordingStream, artifact: Path) -> Page:
    """Words side by side, from the words table and the bigrams table in one folder, and the words' frequencies."""
    words, bigrams = (
        read_table(artifact.with_name(f"{name}.parquet"), of) for name, of in (("words", WORDS), ("bigrams", BIGRAMS))
    )
    count = words["count"].to_numpy()
    shown = min(SHOWN_WORDS, len(words))
    names = [*words["word"][:shown].to_pylist(), EDGE]
    pairs, total = _top_pairs(bigrams, shown, len(words)), int(pc.sum(bigrams["n"]).as_py())
    margins = np.append(count[:shown], max(total - int(count.sum()), 1)).astype(float)
    expected = np.outer(margins, margins) / total
    association = np.log2((pairs + 1.0) / (expected + 1.0))
    logs = np.log10(np.where(pairs > 0, pairs, np.nan))
    order = similar_first(association)
    scale = Scale("association [bit]", DIVERGING, (-MOST_BITS, MOST_BITS))
    log_picture(recording, "association", _pair_picture(names, order, association, scale))
    scale = Scale("log10 of occurrences", limits=None)
    log_picture(recording, "counts", _pair_picture(names, np.arange(len(names)), logs, scale))
    log_picture(recording, "zipf", zipf_plot(words["word"].to_pylist(), count))
    log_text(recording, "pairs", _strongest(names, pairs, association))
    provenance = read_provenance(artifact)
    text = (
        f"Which word stands before which, for the {shown} most frequent of {len(words):,} words; {EDGE} is where a "
        "sentence starts or ends. **Association** compares a pair's count with chance: orange where the two attract "
        "each other, black where they do not care, blue where they avoid each other, and words with like neighbours "
        "lie next to each other. The blocks are what the method learns tags from: words of one class keep the same "
        "company."
    )
    figures = (
        f"{int(count.sum()):,} tokens, {len(words):,} words, {len(bigrams):,} distinct pairs. Association is log2 of a "
        "pair's count over what chance would give, one occurrence added to both."
    )
    return Page(
        f"{corpus_of(provenance)}: moments",
        about("Moments of raw text", text, provenance, figures),
        rrb.Tabs(picture_view("association", "Association of neighbours"), picture_view("counts", "Counts")),
        rrb.Tabs(picture_view("zipf", "Frequency of words by rank"), text_view("pairs", "Strongest pairs")),
    )


def _top_pairs(bigrams: pa.Table, shown: int, edge: int) -> Floats:
    """Counts [shown + 1, shown + 1] of the pairs among the first words and the edge, which comes last."""
    previous, following = bigrams["previous"].to_numpy(), bigrams["next"].to_numpy()
    kept = ((previous < shown) | (previous == edge)) & ((following < shown) | (following == edge))
    pairs = np.zeros((shown + 1, shown + 1))
    pairs[np.minimum(previous[kept], shown), np.minimum(following[kept], shown)] = bigrams["n"].to_numpy()[kept]
    return pairs


def similar_first(association: Floats) -> NDArray[np.intp]:
    """An order in which words with like neighbours on both sides lie near each other; the edge last."""
    profile = np.hstack([association, association.T])[:-1]
    if len(profile) < 3:
        return np.arange(len(association))
    order = leaves_list(linkage(profile, "average", optimal_ordering=True))
    return np.append(order, len(profile)).astype(np.intp)


def _pair_picture(names: Sequence[str], order: NDArray[np.intp], values: Floats, scale: Scale) -> bytes:
    named, axes = [names[row] for row in order], ("a word", "the word after it")
    return heat_maps([Panel("", values[np.ix_(order, order)])], named, named, axes, scale, (11.0, 9.6))


def _strongest(names: Sequence[str], pairs: Floats, association: Floats) -> str:
    order = np.argsort(-association, axis=None, kind="stable")[:SHOWN_PAIRS]
    lines = [
        (escape(names[a]), escape(names[b]), f"{pairs[a, b]:,.0f}", f"{association[a, b]:+.1f}")
        for a, b in zip(*np.unravel_index(order, pairs.shape), strict=True)
        if pairs[a, b]
    ]
    header = ("a word", "the word after it", "times", "association [bit]")
    return f"## The strongest pairs\n\n{markdown_table(header, lines, header[2:])}"
