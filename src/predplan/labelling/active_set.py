"""The compiled active set: min x' H x - 2 b' x on the simplex, for small dense H shared by many b.

Here and in other compiled code loops stand for operations on whole arrays: those bring checks of shapes with them whose
messages take Numba seconds to compile.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

EPSILON = float(np.finfo(np.float64).eps)
STOP_GAP = 1e-13

P = ParamSpec("P")
T = TypeVar("T")


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile with Numba, cached on disk, releasing the interpreter lock."""
    njit = cast(Callable[..., Any], numba.njit)
    return cast(Callable[P, T], njit(cache=True, nogil=True, error_model="numpy")(function))


def compiled_sums(function: Callable[P, T]) -> Callable[P, T]:
    """As compiled, with leave to reorder sums so that they use vector instructions."""
    njit = cast(Callable[..., Any], numba.njit)
    return cast(
        Callable[P, T], njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})(function)
    )


@compiled
def minimise_rows(H: Floats, B: Floats, inverse: Floats, gamma: Floats) -> None:
    """Fill gamma [V, K] row by row; no row's arithmetic depends on another row.

    H [K, K] and B [V, K] are centred, inverse [K, K] is the pseudo-inverse of H.
    """
    words, states = B.shape
    largest = 0.0
    for h in range(states):
        largest = max(largest, H[h, h])
    factor = np.empty((states, states))
    step = np.empty(states)
    gradient = np.empty(states)
    free = np.empty(states, np.int64)
    for w in range(words):
        x = gamma[w]
        x[:] = 1.0 / states
        magnitude = 0.0
        for j in range(states):
            magnitude = max(magnitude, abs(B[w, j]))
            for i in range(states):
                x[i] += inverse[j, i] * B[w, j]
        total = 0.0
        for i in range(states):
            x[i] = max(x[i], 0.0)
            total += x[i]
        for i in range(states):
            x[i] = x[i] / total if total > 0.0 else 1.0 / states
        descend(H, B[w], x, STOP_GAP * (largest + magnitude), factor, step, gradient, free)


@compiled
def descend(
    H: Floats,
    b: Floats,
    x: Floats,
    stop_gap: float,
    factor: Floats,
    step: Floats,
    gradient: Floats,
    free: Integers,
) -> bool:
    """Move x [K], a point of the simplex, to the minimiser of x' H x - 2 b' x; True when the gap closed.

    Primal active set. On the free coordinates the sum is eliminated through the largest one (the pivot). The
    opening takes whole Newton steps and drops every coordinate they make negative, until none is. From then
    on a step is cut at the first coordinate to reach zero, which leaves, and after an uncut step the
    coordinate of least gradient enters; each set is left with a lower objective, so none returns, and the
    bound on iterations guards against rounding. factor [K, K], step, gradient and free [K] are work space.
    """
    states = len(b)
    count = 0
    largest = 0.0
    for h in range(states):
        largest = max(largest, H[h, h], EPSILON * abs(b[h]))
        if x[h] > 0.0:
            free[count] = h
            count += 1
    ridge = 16.0 * states * EPSILON * largest
    opening = True
    uncut = False
    closed = False
    for _ in range(20 + 10 * states):
        for i in range(states):
            gradient[i] = -b[i]
        for f in range(count):
            j = free[f]
            for i in range(states):
                gradient[i] += H[j, i] * x[j]
        least = 0
        at_pivot = 0
        gap = 0.0
        for i in range(1, states):
            if gradient[i] < gradient[least]:
                least = i
        for f in range(count):
            gap += x[free[f]] * (gradient[free[f]] - gradient[least])
            if x[free[f]] > x[free[at_pivot]]:
                at_pivot = f
        if gap <= stop_gap:
            closed = True
            break
        if (uncut or count == 1) and x[least] == 0.0:
            free[count] = least
            count += 1
        count -= 1
        pivot = free[at_pivot]
        free[at_pivot] = free[count]
        free[count] = pivot
        _reduced_step(H, gradient, free, count, ridge, factor, step)
        count += 1
        length = 1.0
        blocking = -1
        for f in range(count):
            if step[f] < 0.0 and x[free[f]] < -step[f] * length:
                length = -x[free[f]] / step[f]
                blocking = f
        if opening and blocking >= 0:
            length = 1.0
        kept = 0
        total = 0.0
        for f in range(count):
            i = free[f]
            x[i] = x[i] + length * step[f]
            if x[i] > 0.0 and (opening or f != blocking):
                total += x[i]
                free[kept] = i
                kept += 1
            else:
                x[i] = 0.0
        count = kept
        for f in range(count):
            x[free[f]] /= total
        uncut = blocking < 0
        opening = opening and not uncut
    return closed


@compiled
def _reduced_step(
    H: Floats, gradient: Floats, free: Integers, count: int, ridge: float, factor: Floats, step: Floats
) -> None:
    """Newton step of sum zero over free[:count] and the pivot free[count], by Cholesky; fills step[: count + 1]."""
    pivot = free[count]
    for f in range(count):
        i = free[f]
        rise = H[i, pivot] - H[pivot, pivot]
        total = gradient[pivot] - gradient[i]
        for k in range(f):
            j = free[k]
            entry = H[i, j] - H[pivot, j] - rise
            for c in range(k):
                entry -= factor[f, c] * factor[k, c]
            entry *= factor[k, k]
            factor[f, k] = entry
            total -= entry * step[k]
        diagonal = H[i, i] - H[pivot, i] - rise + ridge
        for c in range(f):
            diagonal -= factor[f, c] * factor[f, c]
        factor[f, f] = 1.0 / np.sqrt(max(diagonal, ridge))
        step[f] = total * factor[f, f]
    step[count] = 0.0
    for f in range(count - 1, -1, -1):
        step[f] *= factor[f, f]
        for k in range(f):
            step[k] -= factor[f, k] * step[f]
        step[count] -= step[f]


@compiled
def complementarities(H: Floats, B: Floats, gamma: Floats) -> Floats:
    """The residual of simplex.kkt_residuals for a centred program."""
    words, states = B.shape
    curvature = 0.0
    for h in range(states):
        curvature = max(curvature, H[h, h])
    gradient = np.empty(states)
    residual = np.empty(words)
    for w in range(words):
        for i in range(states):
            gradient[i] = -B[w, i]
        for j in range(states):
            for i in range(states):
                gradient[i] += H[j, i] * gamma[w, j]
        least = gradient[0]
        for i in range(1, states):
            least = min(least, gradient[i])
        scale = curvature
        complementarity = 0.0
        total = 0.0
        negative = 0.0
        for i in range(states):
            scale = max(scale, curvature + abs(B[w, i]))
            complementarity += abs(gamma[w, i] * (gradient[i] - least))
            total += gamma[w, i]
            negative = max(negative, -gamma[w, i])
        if scale > 0.0:
            complementarity /= scale
        residual[w] = np.nan if np.isnan(total) else max(complementarity, abs(total - 1.0), negative)
    return residual
