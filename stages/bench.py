"""Speed on this machine, all in one run: `make bench`; figures go to the screen and to data/bench.json.

Raw text: the mirror's tweets (PREDPLAN_MIRROR) where they are, else Brown's words as the corpus stage left them. With
`make bench LARGE=--large` also a fit on 100 million tokens of generated text, which takes some minutes and 300 MB of
temporary files.
"""

from __future__ import annotations

import argparse
import gzip
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from predplan.artifacts.files import write_json
from predplan.errors import InputError, PredplanError
from predplan.labelling import AnchorTagger
from predplan.labelling.readers import RawText, Style, read_labelled
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.simplex import kkt_residuals, solve_active_set, solve_piqp
from predplan.labelling.tables import read_corpus
from predplan.labelling.tagger import count_text
from predplan.labelling.tagmaps import map_tags, own_tagmap
from predplan.labelling.tokenising import tokenise_block
from stages.common import mirror_folder

STATES, WORDS = 12, 20_000
LABELLED = 150
LARGE_TOKENS, SENTENCE_LENGTH, SENTENCES_AT_ONCE = 100_000_000, 16, 100_000
SYLLABLES = [consonant + vowel for consonant in "bcdfghjklmnpqrstvwxz" for vowel in "aeiou"]
TRAIN = Path("data/labelling/brown/train.parquet")
BROWN_RAW = Path("data/labelling/brown/raw")


def main(large: bool) -> None:
    """Measure, print and write every figure."""
    raw, style = raw_text()
    figures = {**quadratic_programs(), **counting(raw, style), **whole_runs(raw, style)}
    if large:
        figures |= large_run()
    write_json(Path("data/bench.json"), figures)
    table = Table("what", "figure", title=f"raw text: {len(raw)} files, style {style}")
    for name, value in figures.items():
        table.add_row(name, f"{value:,.4g}")
    Console().print(table)


def raw_text() -> tuple[tuple[Path, ...], Style]:
    """Files of raw text, and how their lines become tokens."""
    mirror = mirror_folder()
    if mirror is not None and (tweets := tuple(sorted((mirror / "tweets-unlabelled").glob("*.gz")))):
        return tweets, "tweets"
    if not TRAIN.exists():
        raise InputError(f"{TRAIN}: no such file; make it first: make results")
    return tuple(sorted(BROWN_RAW.iterdir())), "spaces"


def labelled_sentences(style: Style) -> LabelledCorpus:
    """A few labelled sentences of the raw text's kind."""
    mirror = mirror_folder()
    if style == "spaces" or mirror is None:
        return read_corpus(TRAIN).subset(range(LABELLED))
    path = mirror / "twitter-pos" / "oct27.splits" / "oct27.train"
    return map_tags(read_labelled(path), own_tagmap("en-tweet"), path.name).subset(range(LABELLED))


def quadratic_programs() -> dict[str, float]:
    """Microseconds a word on one core, and the largest KKT residual, of programs with correlated rows of R."""
    rng = np.random.default_rng(0)
    contexts = rng.dirichlet(np.full(400, 0.5), STATES) + rng.dirichlet(np.full(400, 0.5))
    observed = rng.dirichlet(np.full(STATES, 0.3), WORDS) @ contexts + rng.normal(0.0, 1e-3, (WORDS, 400))
    hessian, linear = contexts @ contexts.T, observed @ contexts.T
    figures = {"condition of R R'": float(np.linalg.cond(hessian))}
    few = linear[: WORDS // 20]

    def reference(words: NDArray[np.float64]) -> NDArray[np.float64]:
        ones, zeros = np.ones((1, STATES)), np.zeros(STATES)
        solved = [qpsolvers.solve_qp(2 * hessian, -2 * b, A=ones, b=np.ones(1), lb=zeros, solver="piqp") for b in words]
        return np.array(solved)

    solvers: dict[str, tuple[Callable[[NDArray[np.float64]], NDArray[np.float64]], NDArray[np.float64]]] = {
        "active set": (lambda words: solve_active_set(hessian, words).gamma, linear),
        "PIQP": (lambda words: solve_piqp(hessian, words).gamma, linear),
        "qpsolvers": (reference, few),
    }
    for name, (solve, words) in solvers.items():
        solve(words[:10])
        start = time.perf_counter()
        gamma = solve(words)
        figures[f"{name}, microseconds a word"] = (time.perf_counter() - start) / len(words) * 1e6
        figures[f"{name}, largest KKT residual"] = float(kkt_residuals(hessian, words, gamma).max())
    return figures


def counting(raw: tuple[Path, ...], style: Style) -> dict[str, float]:
    """Tokens a second from compressed files to bigram counts, by threads of this process and by processes."""
    tokenise_block(b"compiles once on a machine", style)
    figures = {}
    for workers in (1, 2):
        start, busy = time.perf_counter(), time.process_time()
        tokens = count_text(RawText(raw, style), [], workers).count.sum() / 1e6
        if workers == 1:
            figures["counting, million tokens a second of CPU"] = tokens / (time.process_time() - busy)
        figures[f"counting, million tokens a second, {workers} workers"] = tokens / (time.perf_counter() - start)
    return figures


def whole_runs(raw: tuple[Path, ...], style: Style) -> dict[str, float]:
    """Raw text in, trained tagger out, by the command line; then the model's size, loading and tagging."""
    corpus = labelled_sentences(style)
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        labelled = Path(folder) / "labelled.tsv"
        write_labelled(labelled, corpus)
        for kind, copies in (("hmm", 1), ("hmm", 8), ("fhmm", 1), ("crf", 1)):
            out = Path(folder) / f"{kind}-{copies}"
            name = f"label fit {kind}" + (f", text {copies} times" if copies > 1 else "")
            figures |= timed_fit(name, labelled, raw * copies, style, kind, out)
            if copies == 1:
                figures |= model_figures(kind, out, raw[0])
    return figures


def large_run() -> dict[str, float]:
    """A fit on generated text whose vocabulary grows as long as it goes on."""
    with tempfile.TemporaryDirectory() as name:
        folder, rng = Path(name), np.random.default_rng(0)
        sentences = next(zipf_sentences(rng))[:LABELLED]
        tags = tuple(tuple(f"T{sum(map(ord, word)) % STATES}" for word in words) for words in sentences)
        write_labelled(folder / "labelled.tsv", LabelledCorpus(tuple(map(tuple, sentences)), tags))
        raw, tokens = folder / "raw.txt.gz", 0
        with gzip.open(raw, "wt", compresslevel=1, encoding="utf-8") as file:
            for some in zipf_sentences(rng):
                file.writelines(f"{' '.join(words)}\n" for words in some)
                tokens += len(some) * SENTENCE_LENGTH
                if tokens >= LARGE_TOKENS:
                    break
        return timed_fit("label fit hmm, generated", folder / "labelled.tsv", [raw], "spaces", "hmm", folder / "model")


def zipf_sentences(rng: np.random.Generator) -> Iterator[list[list[str]]]:
    """Endless sentences of independent words; the word of rank r has a probability in proportion to (r + 20)^-1.4.

    So 5.8 million tokens hold some 250,000 words and 2 million pairs of neighbours, about as many as tweets do.
    """
    spelled: dict[int, str] = {}
    while True:
        ranks = np.minimum(20.0 * rng.pareto(0.4, SENTENCES_AT_ONCE * SENTENCE_LENGTH), 1e12).astype(np.int64).tolist()
        words = [spelled.get(rank) or spelled.setdefault(rank, spell(rank)) for rank in ranks]
        yield [words[first : first + SENTENCE_LENGTH] for first in range(0, len(words), SENTENCE_LENGTH)]


def spell(rank: int) -> str:
    """A pronounceable word of its own for each rank."""
    rest, last = divmod(rank, len(SYLLABLES))
    return (spell(rest - 1) if rest else "") + SYLLABLES[last]


def write_labelled(path: Path, corpus: LabelledCorpus) -> None:
    """Labelled sentences as columns."""
    columns = zip(corpus.words, corpus.tags, strict=True)
    pairs = ("\n".join(map("\t".join, zip(words, map(str, tags), strict=True))) for words, tags in columns)
    path.write_text("\n\n".join(pairs) + "\n")


def timed_fit(name: str, labelled: Path, raw: Sequence[Path], style: Style, kind: str, out: Path) -> dict[str, float]:
    """Seconds and peak memory of `predplan label fit`."""
    command = [sys.executable, "-m", "predplan", "label", "fit", f"--labelled={labelled}"]
    start = time.perf_counter()
    process = subprocess.Popen(
        [*command, *(f"--raw={path}" for path in raw), f"--style={style}", f"--model={kind}", f"--out={out}"]
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise PredplanError(f"{name}: ended with status {status}")
    return {
        f"{name}, s": time.perf_counter() - start,
        f"{name}, CPU s": usage.ru_utime + usage.ru_stime,
        f"{name}, peak MB": usage.ru_maxrss / 1e3,
    }


def model_figures(kind: str, folder: Path, raw: Path) -> dict[str, float]:
    """Size of a saved model, seconds to load it, and tokens it tags a second on one core."""
    start = time.perf_counter()
    tagger = AnchorTagger.load(folder)
    loading = time.perf_counter() - start
    with gzip.open(raw, "rt", encoding="utf-8") as lines:
        sentences = [line.split() for line, _ in zip(lines, range(20_000), strict=False)]
    start = time.perf_counter()
    tagger.predict(sentences)
    return {
        f"{kind}, model MB": sum(path.stat().st_size for path in folder.iterdir()) / 1e6,
        f"{kind}, loading s": loading,
        f"{kind}, tokens tagged a second": sum(map(len, sentences)) / (time.perf_counter() - start),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", action="store_true", help="fit on 100 million generated tokens too")
    main(parser.parse_args().large)
