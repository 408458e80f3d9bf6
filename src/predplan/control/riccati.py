"""Gains of the linear filter as a function that torch can differentiate: the covariance recursion and its adjoint.

    S_t = C P C' + S,    K_t = (A P C' + K S) S_t⁻¹,    P' = (A - K_t C) P (A - K_t C)' + (K - K_t) S (K - K_t)'

As K_t is what makes P' least, P' does not change with it to first order, and the adjoint of a step is short. They
depend on what was seen and not on what it was: trajectories that were seen alike share one recursion.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor

from predplan.control.tasks import BoolArray, FloatArray


def differentiable_gains(
    A: Tensor, K: Tensor, C: Tensor, S: Tensor, initial: Tensor, seen: BoolArray
) -> tuple[Tensor, Tensor]:
    """K_t [m, T, p, O], 0 where nothing was seen, and S_t [m, T, O, O], of m ways of being seen [m, T].

    initial [p, p] is the covariance before row 0; A [p, p], K [p, O], C [O, p], S [O, O] as in `linear_filter`.
    """
    both: tuple[Tensor, Tensor] = _Gains.apply(A, K, C, S, initial, seen)  # type: ignore[no-untyped-call]
    return both


class _Gains(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor]:
        *tensors, seen = inputs
        A, K, C, S, initial = (_array(one) for one in tensors)
        (m, rows), (p, o) = seen.shape, K.shape
        P, gain, total = np.empty((m, rows, p, p)), np.zeros((m, rows, p, o)), np.empty((m, rows, o, o))
        _forward((A, K, C, S), initial, seen, P, gain, total)
        ctx.kept = (A, K, C, S), seen, P, gain, total
        return torch.from_numpy(gain), torch.from_numpy(total)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *outer: Tensor) -> tuple[Tensor | None, ...]:
        model, seen, P, gain, total = ctx.kept
        by_gain, by_total = (_array(one) for one in outer)
        found = (*(np.zeros_like(one) for one in model), np.zeros(P.shape[2:]))
        _backward(model, seen, P, gain, total, by_gain, by_total, found)
        return *(torch.from_numpy(one) for one in found), None


def _array(tensor: Tensor) -> NDArray[Any]:
    return np.ascontiguousarray(tensor.detach().numpy())


@njit(cache=True, error_model="numpy")
def _forward(
    model: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    initial: FloatArray,
    seen: BoolArray,
    P: FloatArray,
    gain: FloatArray,
    total: FloatArray,
) -> None:
    """Fill P [m, T, p, p] before each row, K_t and S_t."""
    A, K, C, S = model
    At, Kt, Ct, KS = A.T.copy(), K.T.copy(), C.T.copy(), np.dot(K, S)
    noise = np.dot(KS, Kt)
    for i in range(len(seen)):
        now = initial.copy()
        for t in range(seen.shape[1]):
            P[i, t] = now
            PC, AP = np.dot(now, Ct), np.dot(A, now)
            total[i, t] = np.dot(C, PC) + S
            if seen[i, t]:
                gain[i, t] = np.linalg.solve(total[i, t], (np.dot(A, PC) + KS).T.copy()).T
                closed, excess = A - np.dot(gain[i, t], C), K - gain[i, t]
                now = np.dot(np.dot(closed, now), closed.T.copy()) + np.dot(np.dot(excess, S), excess.T.copy())
            else:
                now = np.dot(AP, At) + noise
            now = 0.5 * (now + now.T)


@njit(cache=True, error_model="numpy")
def _backward(
    model: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    seen: BoolArray,
    P: FloatArray,
    gain: FloatArray,
    total: FloatArray,
    by_gain: FloatArray,
    by_total: FloatArray,
    found: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
) -> None:
    """Add derivatives by A, K, C, S and the initial covariance to found."""
    A, K, C, S = model
    by_A, by_K, by_C, by_S, by_initial = found
    At, Ct, Kt = A.T.copy(), C.T.copy(), K.T.copy()
    for i in range(len(seen)):
        carried = np.zeros(A.shape)  # by P' of the row, symmetric
        for t in range(seen.shape[1] - 1, -1, -1):
            now, K_t = P[i, t], gain[i, t]
            closed, excess = A - np.dot(K_t, C), K - K_t
            # Through P' = closed P closed' + excess S excess', K_t held.
            moved = 2.0 * np.dot(np.dot(carried, closed), now)
            by_A += moved
            by_C -= np.dot(K_t.T.copy(), moved)
            pressed = np.dot(carried, excess)
            by_K += 2.0 * np.dot(pressed, S)
            by_S += np.dot(excess.T.copy(), pressed)
            before = np.dot(np.dot(closed.T.copy(), carried), closed)
            by_t = by_total[i, t].copy()
            if seen[i, t]:
                # Through K_t = (A P C' + K S) S_t⁻¹.
                N = np.linalg.solve(total[i, t], by_gain[i, t].T.copy()).T.copy()
                by_t -= np.dot(K_t.T.copy(), N)
                PC = np.dot(now, Ct)
                by_A += np.dot(N, PC.T.copy())
                by_C += np.dot(N.T.copy(), np.dot(A, now))
                by_K += np.dot(N, S)
                by_S += np.dot(Kt, N)
                before += np.dot(np.dot(At, N), C)
            # Through S_t = C P C' + S.
            by_S += by_t
            by_C += np.dot(np.dot(by_t + by_t.T, C), now)
            before += np.dot(np.dot(Ct, by_t), C)
            carried = 0.5 * (before + before.T)
        by_initial += carried
