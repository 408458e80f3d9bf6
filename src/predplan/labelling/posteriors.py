"""Tag posteriors of every word type from its contexts and the anchors' (section 3.3.4): gamma of Q = Gamma R."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from predplan.labelling.mixtures import fit_mixtures
from predplan.labelling.moments import ContextMoments, canonical_contexts, context_label_moments, parts
from predplan.labelling.simplex import Solver, simplex_posteriors

Floats = NDArray[np.float64]
Loss = Literal["kl", "ls"]
TOLERANCE = 1e-9
PROJECTION_SEED = 0


@dataclass(frozen=True)
class PosteriorSettings:
    """How gamma is fitted to a word's contexts."""

    loss: Loss = "kl"
    """kl: likelihood of a mixture of context distributions; ls: least squares, the thesis's."""
    smoothing: float = 50.0
    """Pseudo-counts of the overall context distribution in each tag's contexts."""
    prior: float = 0.5
    """Pseudo-counts spread over the tags in each word's mixture (kl)."""
    projection: int = 0
    """Dimension that canonical correlation analysis reduces contexts to (ls, section 3.5); 0 keeps them whole."""
    solver: Solver = "active_set"
    """Which solver takes the quadratic programs (ls)."""


@dataclass(frozen=True)
class ContextPosteriors:
    """What the contexts of n words say about their tags; rows [n] of the vocabulary are the words.

    gamma [n, K]: rows on the simplex; residual [n]: KKT residual of each word's problem;
    log_ratio [n, K]: mean log of R_hc / q_c over the word's contexts, centred over tags.
    """

    rows: NDArray[np.int64]
    gamma: Floats
    residual: Floats
    log_ratio: Floats


def context_posteriors(
    moments: ContextMoments,
    anchors: NDArray[np.bool_],
    settings: PosteriorSettings,
    labelled: Floats | None = None,
    lam: float = 0.0,
) -> ContextPosteriors:
    """gamma of all words from the anchors [V, K]; with lam > 0 and labelled counts [V, K] regularised as in Eq. 3.27.

    Under the KL loss the regulariser is the likelihood's own: labelled counts enter as counts, lam / (1 - lam) each,
    and lam = 1 keeps a labelled word's relative frequencies, as it does under least squares.
    """
    label_contexts = context_label_moments(moments, anchors, settings.smoothing)
    return _fit(moments, np.arange(len(anchors)), label_contexts, settings, labelled, lam)


def cross_fitted_posteriors(
    moments: ContextMoments,
    anchors: NDArray[np.bool_],
    settings: PosteriorSettings,
    folds: int,
    rng: np.random.Generator,
    rows: NDArray[np.int64],
) -> ContextPosteriors:
    """As `context_posteriors` for the words in `rows`, but each anchor is judged by the anchors of other folds only.

    An anchor's contexts are part of its own tag's, so judged by itself it looks surer than other words are. A tag
    whose anchors all fall into one fold keeps them. `rows` rise, and all anchors are among them.
    """
    label_contexts = context_label_moments(moments, anchors, settings.smoothing)
    result = _fit(moments, rows, label_contexts, settings, None, 0.0)
    words = np.flatnonzero(anchors.any(axis=1))
    fold = rng.integers(0, folds, len(words))
    for held_out in (words[fold == number] for number in range(folds)):
        kept = anchors.copy()
        kept[held_out] = False
        kept[:, ~kept.any(axis=0)] = anchors[:, ~kept.any(axis=0)]
        judged = _fit(moments, held_out, context_label_moments(moments, kept, settings.smoothing), settings, None, 0.0)
        places = np.searchsorted(rows, held_out)
        result.gamma[places] = judged.gamma
        result.residual[places] = judged.residual
        result.log_ratio[places] = judged.log_ratio
    return result


def _fit(
    moments: ContextMoments,
    rows: NDArray[np.int64],
    label_contexts: Floats,
    settings: PosteriorSettings,
    labelled: Floats | None,
    lam: float,
) -> ContextPosteriors:
    shape = (len(rows), len(label_contexts))
    found = ContextPosteriors(rows, np.empty(shape), np.empty(len(rows)), np.empty(shape))
    projected = settings.loss == "ls" and settings.projection > 0
    projection = canonical_contexts(moments, settings.projection, PROJECTION_SEED) if projected else None
    for some in parts(moments.counts, rows):
        part = _fit_some(moments, rows[some], label_contexts, settings, projection, labelled, lam)
        found.gamma[some], found.residual[some], found.log_ratio[some] = part.gamma, part.residual, part.log_ratio
    return found


def _fit_some(
    moments: ContextMoments,
    rows: NDArray[np.int64],
    label_contexts: Floats,
    settings: PosteriorSettings,
    projection: Floats | None,
    labelled: Floats | None,
    lam: float,
) -> ContextPosteriors:
    counts = moments.counts[rows]
    overall = moments.context_probability
    totals = np.maximum(np.asarray(counts.sum(axis=1)).ravel(), 1.0)[:, None]
    ratio = np.log(
        label_contexts / np.where(overall > 0, overall, 1.0), where=overall > 0, out=np.zeros_like(label_contexts)
    )
    log_ratio = (counts @ ratio.T) / totals
    log_ratio -= log_ratio.mean(axis=1, keepdims=True)
    label_counts = np.zeros(log_ratio.shape) if labelled is None else labelled[rows]
    times = label_counts.sum(axis=1)
    seen = times > 0
    frequency = label_counts / np.maximum(times, 1.0)[:, None]
    if settings.loss == "ls":
        if projection is not None:
            projected = label_contexts @ projection
            gram, linear = projected @ projected.T, (counts @ (projection @ projected.T)) * 2 / totals
        else:
            scaled = label_contexts * np.divide(1.0, overall, out=np.zeros_like(overall), where=overall > 0)
            gram, linear = scaled @ label_contexts.T, (counts @ scaled.T) * 2 / totals
        solution = simplex_posteriors(gram, linear, frequency, seen, lam, settings.solver)
        return ContextPosteriors(rows, solution.gamma, solution.residual, log_ratio)
    prior = np.full(log_ratio.shape, settings.prior / log_ratio.shape[1])
    if lam < 1.0:
        prior += lam / (1.0 - lam) * label_counts
    mixture = fit_mixtures(
        counts.indptr, counts.indices, counts.data, label_contexts, prior, np.ones(len(rows)), TOLERANCE, threads=2
    )
    if lam == 1.0:
        mixture.gamma[seen], mixture.residual[seen] = frequency[seen], 0.0
    return ContextPosteriors(rows, mixture.gamma, mixture.residual, log_ratio)
