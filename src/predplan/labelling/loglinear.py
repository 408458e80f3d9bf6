"""Emissions of the feature HMM (section 3.4): mean parameters from posteriors, log-linear weights by L-BFGS.

p(word | tag) is proportional to exp(theta_tag' phi(word)) over the words of a vocabulary (Eq. 3.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.special import logsumexp

from predplan.errors import InputError, PredplanError
from predplan.labelling.moments import ContextMoments
from predplan.labelling.simplex import simplex_posteriors

Floats = NDArray[np.float64]

LEAST_TAG_PROBABILITY = 1e-3


@dataclass(frozen=True)
class LogLinearEmissions:
    """weights [W, K] theta of each tag, log_normaliser [K] log Z of each tag over the vocabulary it was fitted to."""

    weights: Floats
    log_normaliser: Floats

    def log_scores(self, features: sparse.csr_array) -> Floats:
        """log p(word | tag) [n, K] of words with features [n, W]; unlisted words are scored by the same normaliser."""
        return np.asarray(features @ self.weights - self.log_normaliser)


def mean_parameters(features: sparse.csr_array, word_probability: Floats, posteriors: Floats) -> Floats:
    """mu_h = E[phi(X) | h] [W, K], composed from p(h | x): sum_x phi(x) p_x gamma_xh / sum_x p_x gamma_xh.

    features [V, W], word_probability [V], posteriors [V, K]. A mixture of feature vectors, so always inside the
    marginal polytope, where per-feature programs (Eq. 3.25) need not be. Raises InputError for a tag without mass.
    """
    joint = word_probability[:, None] * posteriors
    mass = joint.sum(axis=0)
    if not (mass > 0.0).all():
        raise InputError(
            f"posteriors, column {int(np.argmin(mass))}: found no word with this tag, expected at least one"
        )
    return np.asarray(features.T @ (joint / mass))


def literal_mean_parameters(
    features: sparse.csr_array,
    moments: ContextMoments,
    label_contexts: Floats,
    labelled: Floats | None = None,
    lam: float = 0.0,
) -> Floats:
    """mu [W, K] by one quadratic program a feature, the thesis's way (Eqs. 3.21 to 3.25, with Eq. 3.27 for lam > 0).

    features [V, W] >= 0; label_contexts R [K, 2C]; labelled [V, K] counts of labels. Contexts are weighed by their
    inverse frequency, as for words. Where the thesis is silent: p(h) of Eq. 3.24 is kept from falling below 1e-3, and
    means above a feature's largest value, which no distribution has, are cut to it.
    Raises InputError for negative features, for which gamma >= 0 does not hold.
    """
    if features.nnz and features.data.min() < 0.0:
        raise InputError(f"features: found the value {features.data.min()}, expected none below zero (Eq. 3.23)")
    overall = moments.context_probability
    scaled = label_contexts * np.divide(1.0, overall, out=np.zeros_like(overall), where=overall > 0)
    hessian = scaled @ label_contexts.T
    totals = features.T @ np.asarray(moments.counts.sum(axis=1)).ravel() / 2
    linear = features.T @ (moments.counts @ scaled.T) / np.maximum(totals, 1.0)[:, None]
    label_counts = np.zeros(linear.shape) if labelled is None else features.T @ labelled
    times = label_counts.sum(axis=1, keepdims=True)
    frequency = np.divide(label_counts, times, out=np.zeros_like(label_counts), where=times > 0)
    gamma = simplex_posteriors(hessian, linear, frequency, times.ravel() > 0, lam).gamma
    tags = simplex_posteriors(hessian, (scaled @ overall)[None], None, np.zeros(1, np.bool_), 0.0).gamma[0]
    tags = np.maximum(tags, LEAST_TAG_PROBABILITY)
    expectation = features.T @ moments.word_probability
    largest = features.max(axis=0).toarray().ravel()
    return np.asarray(np.minimum(gamma * expectation[:, None] / (tags / tags.sum()), largest[:, None]))


def fit_emissions(
    features: sparse.csr_array,
    mu: Floats,
    penalty: float,
    start: Floats | None = None,
    iterations: int = 50,
    tolerance: float = 2e-3,
) -> LogLinearEmissions:
    """Weights of all tags at once: max sum_h theta_h' mu_h - log Z_h - penalty / 2 ||theta_h||^2 (Eq. 3.26).

    The thesis prints plus and an unsquared norm, by which the maximum is unbounded and the gradient undefined at zero.
    features [V, W], mu [W, K], penalty > 0, start [W, K] or zero. L-BFGS on weights scaled by s, the root of
    their curvature (the features' variances near the start and the end), which takes a fraction of the steps; ends
    when no entry of the gradient exceeds tolerance * s, or after `iterations` steps.
    Raises InputError on bad shapes or values, PredplanError where L-BFGS stops for another reason.
    """
    from scipy.optimize import minimize  # slow to import, and tagging needs none of it

    _check(features, mu, penalty, start)
    scale = np.sqrt(_curvature(features, mu) + penalty)

    def loss(scaled: Floats) -> tuple[float, Floats]:
        value, gradient = objective(scaled.reshape(mu.shape) / scale, features, mu, penalty)
        return value, (gradient / scale).ravel()

    first = np.zeros(mu.size) if start is None else (start * scale).ravel()
    options = {"maxiter": iterations, "maxfun": 2 * iterations, "ftol": 0.0, "gtol": tolerance, "maxcor": 10}
    found = minimize(loss, first, jac=True, method="L-BFGS-B", options=options)
    out_of_steps = 1
    steepest = float(np.abs(found.jac).max(initial=0.0))
    if found.status != out_of_steps and not steepest <= tolerance:
        raise PredplanError(
            f"log-linear weights: L-BFGS stopped after {found.nit} steps ({found.message}) with a scaled gradient of "
            f"{steepest:.1e}, expected at most {tolerance:.0e}"
        )
    weights = found.x.reshape(mu.shape) / scale
    return LogLinearEmissions(weights, np.asarray(logsumexp(features @ weights, axis=0)))


def objective(weights: Floats, features: sparse.csr_array, mu: Floats, penalty: float) -> tuple[float, Floats]:
    """What fit_emissions minimises, and its gradient E[phi] - mu + penalty theta [W, K]."""
    scores = features @ weights
    top = scores.max(axis=0)
    scores -= top
    np.exp(scores, out=scores)
    total = scores.sum(axis=0)
    expectation = (features.T @ scores) / total
    value = (top + np.log(total)).sum() - (weights * mu).sum() + penalty / 2 * (weights**2).sum()
    return float(value), expectation - mu + penalty * weights


def _curvature(features: sparse.csr_array, mu: Floats) -> Floats:
    """Variance of each feature [W, K]: under the uniform distribution, which zero weights give, and about the means."""
    words = features.shape[0]
    mean = np.asarray(features.mean(axis=0)).reshape(-1, 1)
    square = np.asarray((features**2).sum(axis=0)).reshape(-1, 1) / words
    largest = abs(features).max(axis=0).toarray().reshape(-1, 1)
    return np.asarray(square - mean**2 + np.abs(mu) * np.maximum(largest - np.abs(mu), 0.0))


def _check(features: sparse.csr_array, mu: Floats, penalty: float, start: Floats | None) -> None:
    words, width = features.shape
    if not words:
        raise InputError("features: found no words, expected a vocabulary")
    if mu.ndim != 2 or len(mu) != width:
        raise InputError(f"mean parameters: found shape {mu.shape}, expected ({width}, K)")
    if start is not None and start.shape != mu.shape:
        raise InputError(f"start: found shape {start.shape}, expected {mu.shape}")
    if not (np.isfinite(mu).all() and (start is None or np.isfinite(start).all())):
        raise InputError("mean parameters or start: found a value that is not finite, expected finite numbers")
    if not 0.0 < penalty < np.inf:
        raise InputError(f"penalty: found {penalty}, expected a number above zero")
