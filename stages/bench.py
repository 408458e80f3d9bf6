"""Speed on this machine, all in one run: `make bench`; figures go to the screen and to data/bench.json.

Raw text: the mirror's tweets (PREDPLAN_MIRROR) where they are, else Brown's words as the corpus stage left them.
"""

from __future__ import annotations

import gzip
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from predplan.artifacts.files import write_json
from predplan.errors import InputError
from predplan.labelling import AnchorTagger
from predplan.labelling.readers import RawText, Style, read_labelled
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.simplex import kkt_residuals, solve_active_set, solve_piqp
from predplan.labelling.tables import read_corpus
from predplan.labelling.tagger import count_text
from predplan.labelling.tagmaps import map_tags, own_tagmap
from stages.common import mirror_folder

STATES, WORDS = 12, 20_000
LABELLED = 150
TRAIN = Path("data/labelling/brown/train.parquet")
BROWN_RAW = Path("data/labelling/brown/raw")


def main() -> None:
    """Measure, print and write every figure."""
    raw, style = raw_text()
    figures = {**quadratic_programs(), **counting(raw, style), **whole_runs(raw, style)}
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
    """Tokens a second from compressed files to bigram counts."""
    figures = {}
    for workers in (1, 2):
        start = time.perf_counter()
        counts = count_text(RawText(raw, style), [], workers)
        figures[f"counting, million tokens a second, {workers} workers"] = (
            counts.count.sum() / (time.perf_counter() - start) / 1e6
        )
    return figures


def whole_runs(raw: tuple[Path, ...], style: Style) -> dict[str, float]:
    """Raw text in, trained tagger out, by the command line; then the model's size, loading and tagging."""
    corpus = labelled_sentences(style)
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        labelled = Path(folder) / "labelled.tsv"
        pairs = (
            "\n".join(map("\t".join, zip(w, map(str, t), strict=True)))
            for w, t in zip(*vars(corpus).values(), strict=True)
        )
        labelled.write_text("\n\n".join(pairs) + "\n")
        for kind, copies in (("hmm", 1), ("hmm", 8), ("fhmm", 1), ("crf", 1)):
            out = Path(folder) / f"{kind}-{copies}"
            files = [f"--raw={path}" for path in raw * copies]
            command = [sys.executable, "-m", "predplan", "label", "fit", f"--labelled={labelled}", *files]
            start = time.perf_counter()
            subprocess.run([*command, f"--style={style}", f"--model={kind}", f"--out={out}", "--workers=2"], check=True)
            name = f"label fit {kind}" + (f", text {copies} times" if copies > 1 else "")
            figures[f"{name}, s"] = time.perf_counter() - start
            figures[f"{name}, peak MB so far"] = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
            if copies == 1:
                figures |= model_figures(kind, out, raw[0])
    return figures


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
    main()
