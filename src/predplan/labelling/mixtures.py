"""The other loss of Arora et al. (2013): a multinomial mixture a word, fitted by maximum likelihood (KL loss).

Word w was seen n_wc times with context c. Its contexts are drawn from the mixture gamma_w' R of the rows of R, so

    max_gamma  sum_c n_wc log (gamma' R)_c  +  sum_h alpha_wh log gamma_h    on the simplex,

where alpha >= 0 are pseudo-counts of the labels. The problem is concave. Each word gets a few steps of EM, then
Newton steps: the quadratic model of the objective is maximised on the simplex by the active set of active_set.py
and followed as far as the objective rises enough.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predplan.errors import InputError, PredplanError
from predplan.labelling.active_set import Floats, Integers, compiled, compiled_sums, descend

EM_STEPS = 2
LEAST_FRACTION = 0.1
LEAST_RISE = 1e-4
ROUNDING = 1e-14
HALVINGS = 30


@dataclass(frozen=True)
class MixtureSolution:
    """gamma [V, K] on the simplex; residual [V], see fit_mixtures, no unit; iterations [V]: EM and Newton steps."""

    gamma: Floats
    residual: Floats
    iterations: Integers


def fit_mixtures(
    indptr: Integers,
    indices: Integers,
    data: Floats,
    R: Floats,
    alpha: Floats,
    weight: Floats,
    tolerance: float = 1e-6,
    iteration_limit: int = 200,
    threads: int = 1,
) -> MixtureSolution:
    """Label posteriors gamma [V, K] of every word under the KL loss.

    indptr [V + 1], indices [N], data [N]: the context counts n in compressed rows (occurrences, >= 0);
    R [K, C]: context distribution of each label, each row summing to one over each group of contexts and
    smoothed, that is positive wherever a count is; alpha [V, K]: label pseudo-counts, >= 0; weight [V]: factor
    on the word's counts (below one caps the sample size of a frequent word).
    A word with neither counts nor pseudo-counts gets the uniform distribution.

    With g the gradient and n the sum of the word's weighted counts and pseudo-counts, gamma' g = n, and
    (max_h g_h - n) / n, the residual, bounds the distance of the objective from its maximum, in units of n.
    Every row depends on its own data only, so the result is the same for any number of threads.
    Raises InputError on bad input, PredplanError where the residual exceeds tolerance after iteration_limit steps.
    """
    words = len(indptr) - 1
    _check_counts(indptr, indices, data, R.shape[1])
    _check_rows(R, indices[data > 0.0])
    for name, array, shape in (("alpha", alpha, (words, len(R))), ("weight", weight, (words,))):
        if array.shape != shape:
            raise InputError(f"{name}: found shape {array.shape}, expected {shape}")
        if not (np.isfinite(array) & (array >= 0.0)).all():
            raise InputError(f"{name}: found a value negative or not finite, expected numbers >= 0")
    gamma, residual = np.empty((words, len(R))), np.empty(words)
    iterations = np.empty(words, np.int64)
    columns = np.ascontiguousarray(R.T, np.float64)
    counts = (indptr.astype(np.int64), indices.astype(np.int32, copy=False), data.astype(np.float64, copy=False))
    prior, factor = np.ascontiguousarray(alpha, np.float64), weight.astype(np.float64)

    def fit(first: int, last: int) -> None:
        limits = (tolerance, iteration_limit)
        _fit_rows(*counts, columns, prior, factor, *limits, first, last, gamma, residual, iterations)

    cuts = np.searchsorted(counts[0], np.linspace(0, counts[0][-1], 4 * threads + 1)[1:-1])
    edges = [0, *cuts.tolist(), words]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(fit, edges[:-1], edges[1:]))
    if not (residual <= tolerance).all():
        word = int(np.argmax(np.where(np.isnan(residual), np.inf, residual)))
        raise PredplanError(
            f"mixture of word {word}: residual {residual[word]:.1e} after {iterations[word]} steps, "
            f"expected at most {tolerance:.0e}"
        )
    return MixtureSolution(gamma, residual, iterations)


@compiled
def _fit_rows(
    indptr: Integers,
    indices: NDArray[np.int32],
    data: Floats,
    columns: Floats,
    alpha: Floats,
    weight: Floats,
    tolerance: float,
    iteration_limit: int,
    first: int,
    last: int,
    gamma: Floats,
    residual: Floats,
    iterations: Integers,
) -> None:
    """Fill rows first..last of gamma, residual and iterations; columns [C, K] is R'."""
    states = columns.shape[1]
    longest = 0
    for w in range(first, last):
        longest = max(longest, indptr[w + 1] - indptr[w])
    held = np.empty(states * longest)
    counts = np.empty(longest)
    for w in range(first, last):
        size = 0
        for entry in range(indptr[w], indptr[w + 1]):
            counts[size] = data[entry] * weight[w]
            size += counts[size] > 0.0
        likelihoods = held[: states * size].reshape(states, size)
        at = 0
        for entry in range(indptr[w], indptr[w + 1]):
            if data[entry] * weight[w] > 0.0:
                for h in range(states):
                    likelihoods[h, at] = columns[indices[entry], h]
                at += 1
        iterations[w], residual[w] = _fit_row(
            counts[:size], likelihoods, alpha[w], tolerance, iteration_limit, gamma[w]
        )


@compiled
def _fit_row(
    n: Floats, likelihoods: Floats, alpha: Floats, tolerance: float, iteration_limit: int, x: Floats
) -> tuple[int, float]:
    """Fill x [K]; n [c] positive counts, likelihoods [K, c] the columns of R they fall in -> steps, residual."""
    states, size = likelihoods.shape
    total = n.sum() + alpha.sum()
    x[:] = 1.0 / states
    if total == 0.0:
        return 0, 0.0
    if size == 0:
        for h in range(states):
            x[h] = alpha[h] / total
        return 0, 0.0
    fitted, ratio, change = np.empty(size), np.empty(size), np.empty(size)
    gradient, target, lower = np.empty(states), np.empty(states), np.empty(states)
    hessian, factor = np.empty((states, states)), np.empty((states, states))
    step, slope, free = np.empty(states), np.empty(states), np.empty(states, np.int64)
    residual = np.inf
    for iteration in range(iteration_limit + 1):
        _mix(x, likelihoods, fitted)
        for c in range(size):
            ratio[c] = n[c] / fitted[c]
        for h in range(states):
            gradient[h] = _dot(likelihoods[h], ratio)
            if alpha[h] > 0.0:
                gradient[h] += alpha[h] / x[h]
        residual = max(gradient.max() / total - 1.0, 0.0)
        if residual <= tolerance or iteration == iteration_limit:
            return iteration, residual
        length = 0.0
        if iteration >= EM_STEPS:
            _curvature(likelihoods, ratio, fitted, alpha, x, hessian, change)
            _newton_target(
                hessian, gradient, alpha, x, 1e-3 * tolerance * total, target, lower, factor, step, slope, free
            )
            rise = 0.0
            for h in range(states):
                target[h] -= x[h]
                rise += gradient[h] * target[h]
            _mix(target, likelihoods, change)
            length = _step_length(n, fitted, change, alpha, x, target, rise, total)
        for h in range(states):
            x[h] = max(x[h] + length * target[h], 0.0) if length > 0.0 else x[h] * gradient[h] / total
        x /= x.sum()
    return iteration_limit, residual


@compiled
def _newton_target(
    hessian: Floats,
    gradient: Floats,
    alpha: Floats,
    x: Floats,
    stop_gap: float,
    target: Floats,
    lower: Floats,
    factor: Floats,
    step: Floats,
    slope: Floats,
    free: Integers,
) -> None:
    """Fill target [K], the maximiser of the quadratic model at x on the simplex; overwrites hessian [K, K].

    As hessian x = gradient, the model is -(t' hessian t - 4 gradient' t) / 2. Where alpha > 0 the logarithm keeps
    gamma off zero: the target stays above a tenth of x, by the substitution t = lower + scale s, s on the simplex.
    """
    states = len(x)
    scale = 1.0
    for h in range(states):
        lower[h] = LEAST_FRACTION * x[h] if alpha[h] > 0.0 else 0.0
        scale -= lower[h]
    linear = np.empty(states)
    for h in range(states):
        pull = 0.0
        for i in range(states):
            pull += hessian[h, i] * lower[i]
        linear[h] = scale * (2.0 * gradient[h] - pull)
        target[h] = (x[h] - lower[h]) / scale
    hessian *= scale * scale
    descend(hessian, linear, target, stop_gap, factor, step, slope, free)
    for h in range(states):
        target[h] = lower[h] + scale * target[h]


@compiled
def _step_length(
    n: Floats,
    fitted: Floats,
    change: Floats,
    alpha: Floats,
    x: Floats,
    direction: Floats,
    slope: float,
    total: float,
) -> float:
    """The first of 1, 1/2, 1/4, ... at which the objective has risen by 1e-4 of the slope; 0 where none has.

    A fall within the objective's rounding, 1e-14 of total, is let pass: the gap still narrows there.
    """
    length = 1.0
    for _ in range(HALVINGS):
        rise = 0.0
        for c in range(len(n)):
            rise += n[c] * np.log1p(length * change[c] / fitted[c])
        for h in range(len(x)):
            if alpha[h] > 0.0:
                rise += alpha[h] * np.log1p(length * direction[h] / x[h])
        enough = LEAST_RISE * length * slope - ROUNDING * total
        if rise >= enough and slope >= enough:
            return length
        length *= 0.5
    return 0.0


@compiled
def _mix(x: Floats, likelihoods: Floats, mixed: Floats) -> None:
    mixed[:] = 0.0
    for h in range(len(x)):
        if x[h] != 0.0:
            for c in range(len(mixed)):
                mixed[c] += x[h] * likelihoods[h, c]


@compiled
def _curvature(
    likelihoods: Floats, ratio: Floats, fitted: Floats, alpha: Floats, x: Floats, hessian: Floats, scaled: Floats
) -> None:
    """Fill hessian [K, K], minus the objective's second derivatives; scaled [c] is work space."""
    for i in range(len(x)):
        for c in range(len(ratio)):
            scaled[c] = ratio[c] / fitted[c] * likelihoods[i, c]
        for j in range(i + 1):
            hessian[i, j] = hessian[j, i] = _dot(likelihoods[j], scaled)
        if alpha[i] > 0.0:
            hessian[i, i] += alpha[i] / (x[i] * x[i])


@compiled_sums
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


def _check_counts(indptr: Integers, indices: Integers, data: Floats, contexts: int) -> None:
    if len(indptr) < 1 or indptr[0] != 0 or (np.diff(indptr) < 0).any() or indptr[-1] != len(indices):
        raise InputError(f"indptr: expected to rise from 0 to {len(indices)}, the number of counts")
    if data.shape != indices.shape:
        raise InputError(f"counts: found {len(data)} values for {len(indices)} contexts, expected as many")
    if len(indices) and not (indices.min() >= 0 and indices.max() < contexts):
        raise InputError(f"contexts: found {indices.min()} to {indices.max()}, expected 0 to {contexts - 1}")
    if not (np.isfinite(data) & (data >= 0.0)).all():
        raise InputError("counts: found a value negative or not finite, expected numbers >= 0")


def _check_rows(R: Floats, used: Integers) -> None:
    if not (np.isfinite(R) & (R >= 0.0)).all():
        row = int(np.flatnonzero(~(np.isfinite(R) & (R >= 0.0)).all(axis=1))[0])
        raise InputError(f"R, row {row}: found a value negative or not finite, expected probabilities")
    counted = np.bincount(used, minlength=R.shape[1]) > 0
    empty = (R == 0.0) & counted
    if empty.any():
        row, context = np.argwhere(empty)[0]
        raise InputError(f"R, row {row}: found 0 at context {context}, which has counts; expected R smoothed positive")
