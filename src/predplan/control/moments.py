"""Mean and covariance of windows, some of whose observations are missing.

Losses do not depend on what was lost, so the likelihood of what is left says all there is to say; where windows have
gaps, its maximum over Gaussians is found by expectation maximisation (Dempster, Laird and Rubin 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from predplan.control.tasks import BoolArray, FloatArray
from predplan.errors import InputError

TINY = 1e-300
"""Keeps the covariance of what never changes regular."""


@dataclass(frozen=True)
class Moments:
    """Of vectors of d numbers."""

    mean: FloatArray  # [d]
    covariance: FloatArray  # [d, d]
    count: int  # of vectors

    def mapped(self, linear: FloatArray) -> Moments:
        """Of linear [e, d] times the vectors."""
        return Moments(linear @ self.mean, linear @ self.covariance @ linear.T, self.count)


def second_moments(
    vectors: FloatArray, iterations: int = 100, jitter: float = 1e-9, known: Moments | None = None
) -> Moments:
    """Maximum likelihood moments of vectors [m, d], of which numbers that are not finite are missing.

    iterations: at most so many of expectation maximisation, where something is missing, or until the variance of each
    number given all others changes by less than a hundredth (what is nearly foretold converges last); jitter: added to
    variances, relative to each, where conditional means are taken; known: moments to begin at, of similar vectors.
    Raises InputError for fewer than 2 vectors.
    """
    if len(vectors) < 2:
        raise InputError(f"windows: found {len(vectors)}, expected at least 2; explore more or take a shorter past")
    missing = ~np.isfinite(vectors)
    filled = np.where(missing, 0.0, vectors)
    if not missing.any():
        return _sample_moments(filled, np.zeros((vectors.shape[1],) * 2))
    if known is None and missing.all(axis=0).any():
        raise InputError("windows: some observation is missing in all of them")
    moments = _of_what_is_there(filled, missing) if known is None else known
    precision: FloatArray = np.diag(np.full(vectors.shape[1], np.inf)).astype(np.float64)
    for _ in range(iterations):
        before = np.diag(precision)
        jittered = moments.covariance + np.diag(jitter * np.diag(moments.covariance) + TINY)
        precision = np.asarray(np.linalg.inv(jittered), np.float64)
        if np.max(np.abs(np.diag(precision) / before - 1)) < 1e-2:
            break
        uncertainty = np.zeros(precision.shape)
        _fill(filled, missing, moments.mean, precision, uncertainty)
        moments = _sample_moments(filled, uncertainty / len(filled))
    return moments


def ridge(moments: Moments, inputs: slice | FloatArray, outputs: slice | FloatArray, lam: float) -> FloatArray:
    """Coefficients [e, d_in] of outputs on inputs, both centred: Cov_yx (Cov_xx + lam diag Cov_xx)⁻¹.

    lam has no unit: it is relative to each input's variance.
    """
    both = moments.covariance
    xx, yx = both[inputs][:, inputs], both[outputs][:, inputs]
    return solve_right(yx, xx, lam)


def solve_right(yx: FloatArray, xx: FloatArray, lam: float) -> FloatArray:
    """yx (xx + lam diag xx)⁻¹ [e, d] of yx [e, d] and xx [d, d], in one scale; inputs without variance get 0."""
    scale = np.sqrt(np.diag(xx))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    matrix = xx * np.outer(inverse, inverse) + np.diag(lam + (scale <= 0.0))
    values, vectors = np.linalg.eigh(matrix)
    kept = values > 1e-13 * values[-1]
    turned = (yx * inverse) @ vectors[:, kept]
    solution: FloatArray = (turned / values[kept]) @ vectors[:, kept].T * inverse
    return solution


def _of_what_is_there(filled: FloatArray, missing: BoolArray) -> Moments:
    mean: FloatArray = filled.sum(axis=0) / (~missing).sum(axis=0)
    centred = np.where(missing, mean, filled)
    # Means alone would make what is missing look certain: variances are those of what is there.
    spread = np.diag(((centred - mean) ** 2).sum(axis=0) * (1 / (~missing).sum(axis=0) - 1 / len(filled)))
    return _sample_moments(centred, spread)


def _sample_moments(filled: FloatArray, uncertainty: FloatArray) -> Moments:
    mean = filled.mean(axis=0)
    centred = filled - mean
    return Moments(mean, centred.T @ centred / len(filled) + uncertainty, len(filled))


@njit(cache=True, error_model="numpy")
def _fill(
    vectors: FloatArray, missing: BoolArray, mean: FloatArray, precision: FloatArray, uncertainty: FloatArray
) -> None:
    """Put conditional means where numbers are missing, and add up conditional covariances.

    With precision L and missing part M: the covariance is L_MM⁻¹, the mean μ_M - L_MM⁻¹ L_MS (z_S - μ_S).
    """
    d = vectors.shape[1]
    index, right = np.empty(d, np.int64), np.empty(d)
    for i in range(len(vectors)):
        k = 0
        for j in range(d):
            if missing[i, j]:
                index[k] = j
                k += 1
        if k == 0:
            continue
        block = np.empty((k, k))
        for a in range(k):
            total = 0.0
            for j in range(d):
                if not missing[i, j]:
                    total += precision[index[a], j] * (vectors[i, j] - mean[j])
            right[a] = total
            for b in range(k):
                block[a, b] = precision[index[a], index[b]]
        inverse = np.linalg.inv(block)
        for a in range(k):
            total = 0.0
            for b in range(k):
                total += inverse[a, b] * right[b]
                uncertainty[index[a], index[b]] += inverse[a, b]
            vectors[i, index[a]] = mean[index[a]] - total
