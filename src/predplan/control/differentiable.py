"""The linear filter as a function that torch can differentiate, its recursion and the adjoint of it compiled.

    e = o - C q - D a - d,    q' = clip(A q + B a + c + K_t e)

A recursion in torch costs a dispatch for each operation of each row, forward and backward, which is hundreds of times
the arithmetic. Here both run in one compiled loop, and what the loop leaves is a product of matrices for each
parameter. With g the loss's derivative by q' (before clipping) and h = K_t' g by e, going back in time,

    dL/dq = A' g - C' h,    dL/dA = g q',  dL/dB = g a',  dL/dc = g,  dL/dK_t = g e',  dL/dC = -h q',  dL/dD = -h a'.

In `DifferentiableFilter` gains are constants of a model (`linear_filter.gains`), and the derivative by K is that of
K_t = constant + K; refinement has gains that are differentiable themselves (`riccati`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor

from predplan.control.linear_filter import LinearFilter
from predplan.control.tasks import BoolArray, FloatArray

LEARNED = ("A", "B", "c", "K", "C", "D", "d", "initial_mean")
"""What gradients reach."""


class DifferentiableFilter(torch.nn.Module):
    """A linear filter of which the states and predictions are functions of its parameters."""

    C: Tensor
    D: Tensor
    d: Tensor
    shift: Tensor
    scale: Tensor

    def __init__(self, model: LinearFilter) -> None:
        super().__init__()
        for name in LEARNED:
            values = np.array(getattr(model, name), np.float64)
            self.register_parameter(name, torch.nn.Parameter(torch.from_numpy(values)))
        self.register_buffer("shift", torch.from_numpy(np.array(model.shift, np.float64)))
        self.register_buffer("scale", torch.from_numpy(np.array(model.scale, np.float64)))
        self.limit = model.limit

    def forward(
        self, start: Tensor, action: Tensor, observation: Tensor, gain: Tensor, reset: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Filter T rows of n trajectories side by side: states before and after each row, and its prediction.

        start [n, p] is the state before row 0. action [T, n, A]; observation [T, n, O] in the task's units, not finite
        where missing; gain [T, n, p, O] of `linear_filter.gains`, 0 where missing; before a row of reset [T, n] the
        state is initial_mean. -> before [T, n, p], after [T, n, p], prediction [T, n, O] in the task's units. Nothing
        is skipped here: parameters that do not keep states finite give a loss that is not.
        """
        scaled = (observation.double() - self.shift) / self.scale
        before, after = filter_rows(
            {name: getattr(self, name) for name in LEARNED},
            (start.double(), action.double(), scaled, gain.double(), reset),
            self.limit,
        )
        expected = before @ self.C.T + action.double() @ self.D.T + self.d
        return before, after, expected * self.scale + self.shift

    def to_model(self, model: LinearFilter) -> LinearFilter:
        """The model with these parameters.

        Its S and initial_covariance are kept: no gradient here reaches them, and gains depend on their ratio, not on
        their size. Who has moved the parameters far learns them anew from data (`refinement`, `innovation.fit_start`).
        """
        learned = {name: getattr(self, name).detach().numpy().copy() for name in LEARNED}
        return replace(model, **learned)


def filter_rows(
    learned: dict[str, Tensor], given: tuple[Tensor, Tensor, Tensor, Tensor, Tensor], limit: float
) -> tuple[Tensor, Tensor]:
    """States before and after each row [T, n, p], of parameters by the names of LEARNED.

    given: as of `DifferentiableFilter.forward`, observations standardised. Gradients reach K_t where gain wants them,
    and K where K does.
    """
    both: tuple[Tensor, Tensor] = _Recursion.apply(  # type: ignore[no-untyped-call]
        *(learned[name] for name in LEARNED), *given, limit
    )
    return both


class _Recursion(torch.autograd.Function):
    """States before and after each row, and their adjoint."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor]:
        *tensors, limit = inputs
        A, B, c, _, C, D, d, mean, start, action, scaled, gain, reset = (_array(one) for one in tensors)
        seen = np.isfinite(scaled).all(axis=2)
        apart = np.where(seen[..., None], scaled - action @ D.T - d, 0.0)
        drive = action @ B.T + c
        before, after, innovation = np.empty_like(drive), np.empty_like(drive), np.zeros_like(apart)
        shrink = np.ones(seen.shape)
        given = (start, drive, apart, gain, seen, reset)
        _forward(A, C, mean, given, limit, before, after, innovation, shrink)
        ctx.kept = (A, C, action, gain, seen, reset, before, after, innovation, shrink)
        return torch.from_numpy(before), torch.from_numpy(after)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *outer: Tensor) -> tuple[Tensor | None, ...]:
        A, C, action, gain, seen, reset, before, after, innovation, shrink = ctx.kept
        by_before, by_after = (_array(one) for one in outer)
        g, h = np.empty_like(before), np.zeros_like(innovation)
        by_mean, by_start = np.zeros(before.shape[2]), np.zeros(before.shape[1:])
        _backward(A, C, (by_before, by_after), gain, seen, reset, after, shrink, g, h, by_mean, by_start)
        by_gain = torch.from_numpy(g[..., :, None] * innovation[..., None, :]) if ctx.needs_input_grad[11] else None
        g, h = g.reshape(-1, g.shape[2]), h.reshape(-1, h.shape[2])
        q, a, e = (one.reshape(-1, one.shape[2]) for one in (before, action, innovation))
        learned = (g.T @ q, g.T @ a, g.sum(axis=0), g.T @ e, -h.T @ q, -h.T @ a, -h.sum(axis=0), by_mean, by_start)
        return *(torch.from_numpy(np.ascontiguousarray(one)) for one in learned), None, None, by_gain, None, None


def _array(tensor: Tensor) -> NDArray[Any]:
    return np.ascontiguousarray(tensor.detach().numpy())


@njit(cache=True, error_model="numpy")
def _forward(
    A: FloatArray,
    C: FloatArray,
    mean: FloatArray,
    given: tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray, BoolArray],
    limit: float,
    before: FloatArray,
    after: FloatArray,
    innovation: FloatArray,
    shrink: FloatArray,
) -> None:
    """Fill before, after [T, n, p], innovations [T, n, O], 0 where nothing was seen, and what clips q' [T, n].

    given: the start [n, p], B a + c, o - D a - d, K_t, and whether rows were seen and are first.
    """
    start, drive, apart, gain, seen, reset = given
    rows, n, p = before.shape
    o = len(C)
    # Sums run along rows of the transposed, so that they are vectorised without changing their order.
    At, Ct = A.T.copy(), C.T.copy()
    for i in range(n):
        q = start[i].copy()
        for t in range(rows):
            if reset[t, i]:
                q[:] = mean
            moved, e, K = after[t, i], innovation[t, i], gain[t, i]
            before[t, i] = q
            moved[:] = drive[t, i]
            for m in range(p):
                value = q[m]
                for j in range(p):
                    moved[j] += At[m, j] * value
            if seen[t, i]:
                e[:] = apart[t, i]
                for m in range(p):
                    value = q[m]
                    for k in range(o):
                        e[k] -= Ct[m, k] * value
                for j in range(p):
                    for k in range(o):
                        moved[j] += K[j, k] * e[k]
            square = 0.0
            for j in range(p):
                square += moved[j] * moved[j]
            shrink[t, i] = min(1.0, limit / max(np.sqrt(square), 1e-300))
            for j in range(p):
                moved[j] *= shrink[t, i]
                q[j] = moved[j]


@njit(cache=True, error_model="numpy")
def _backward(
    A: FloatArray,
    C: FloatArray,
    outer: tuple[FloatArray, FloatArray],
    gain: FloatArray,
    seen: BoolArray,
    reset: BoolArray,
    after: FloatArray,
    shrink: FloatArray,
    g: FloatArray,
    h: FloatArray,
    by_mean: FloatArray,
    by_start: FloatArray,
) -> None:
    """Fill g [T, n, p], h [T, n, O], and the derivatives by initial_mean [p] and the start [n, p].

    outer: the loss's derivatives by before and after, through what comes after this recursion.
    """
    by_before, by_after = outer
    rows, n, p = g.shape
    o = len(C)
    carried = np.empty(p)
    for i in range(n):
        carried[:] = 0.0
        for t in range(rows - 1, -1, -1):
            moved, back, K = g[t, i], h[t, i], gain[t, i]
            for j in range(p):
                moved[j] = carried[j] + by_after[t, i, j]
            if shrink[t, i] < 1.0:
                # The derivative of a projection to a sphere: what points outwards is lost.
                square, outwards = 0.0, 0.0
                for j in range(p):
                    square += after[t, i, j] ** 2
                    outwards += after[t, i, j] * moved[j]
                for j in range(p):
                    moved[j] = shrink[t, i] * (moved[j] - after[t, i, j] * outwards / square)
            carried[:] = by_before[t, i]
            for j in range(p):
                value = moved[j]
                for m in range(p):
                    carried[m] += A[j, m] * value
            if seen[t, i]:
                for j in range(p):
                    for k in range(o):
                        back[k] += K[j, k] * moved[j]
                for k in range(o):
                    value = back[k]
                    for m in range(p):
                        carried[m] -= C[k, m] * value
            if reset[t, i]:
                for j in range(p):
                    by_mean[j] += carried[j]
                carried[:] = 0.0
        by_start[i] = carried
