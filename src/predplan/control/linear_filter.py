"""The linear filter, compiled: a Kalman filter in innovation form.

With all observations seen, a stationary process is

    q' = A q + B a + c + K e,    o = C q + D a + d + e,    e ~ N(0, S),

and q, the steady-state filter's own mean, is known exactly. Any filter that has seen less has a covariance P of the
difference. As the innovation form has the second moments of the process, whatever noise there is behind it, the best
linear filter is the Kalman filter of this very system, whose noises K e and e are fully correlated:

    S_t = C P C' + S,    K_t = (A P C' + K S) S_t⁻¹,    P' = (A - K_t C) P (A - K_t C)' + (K - K_t) S (K - K_t)'.

Where o is missing K_t = 0 and P grows; after it K_t is larger than K; and with all seen P goes to 0 and K_t to K. No
noise covariances of the unknown system need to be told apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from predplan.control import cholesky
from predplan.control.filtering import FilterState
from predplan.control.tasks import BoolArray, FloatArray, IntArray
from predplan.control.trajectories import Trajectories

SETTLED = 1e-11
"""Share of P in the innovations' covariance below which P counts as 0: it moves predictions by less than 1e-10."""


@dataclass(frozen=True)
class LinearFilter:
    """The linear filter's parameters, of standardised observations (o - shift) / scale."""

    A: FloatArray  # [p, p]
    B: FloatArray  # [p, A]
    c: FloatArray  # [p]
    K: FloatArray  # [p, O]
    C: FloatArray  # [O, p]
    D: FloatArray  # [O, A]
    d: FloatArray  # [O]
    S: FloatArray  # [O, O] covariance of innovations
    initial_mean: FloatArray  # [p] of q_0
    initial_covariance: FloatArray  # [p, p]
    limit: float  # |q| is clipped here
    shift: FloatArray  # [O] m, rad
    scale: FloatArray  # [O] m, rad

    @property
    def state_size(self) -> int:
        """p."""
        return len(self.A)

    @property
    def observation_size(self) -> int:
        """O."""
        return len(self.C)

    def initial(self, copies: int) -> FilterState:
        """q_0 and its covariance, before o_0."""
        return FilterState(
            self.initial_mean[None].repeat(copies, axis=0),
            self.initial_covariance[None].repeat(copies, axis=0),
            np.zeros(copies, np.int64),
        )

    def update(self, state: FilterState, action: FloatArray, observation: FloatArray) -> FilterState:
        """One step of the Kalman filter."""
        mean, covariance, skipped = state.mean.copy(), state.covariance.copy(), state.skipped.copy()
        scaled = np.ascontiguousarray((observation - self.shift) / self.scale)
        _update_rows(self.arrays(), mean, covariance, skipped, np.ascontiguousarray(action, np.float64), scaled)
        return FilterState(mean, covariance, skipped)

    def predict(self, state: FilterState, action: FloatArray) -> FloatArray:
        """C q + D a + d, in the task's units."""
        scaled = state.mean @ self.C.T + action @ self.D.T + self.d
        predicted: FloatArray = scaled * self.scale + self.shift
        return predicted

    def arrays(self) -> tuple[FloatArray, ...]:
        """Parameters as compiled code takes them."""
        return self._arrays

    @cached_property
    def _arrays(self) -> tuple[FloatArray, ...]:
        bound = np.array([self.limit])
        arrays = (self.A, self.B, self.c, self.K, self.C, self.D, self.d, self.S, bound)
        return tuple(np.ascontiguousarray(one, np.float64) for one in arrays)


def turned(model: LinearFilter, T: FloatArray) -> LinearFilter:
    """The same filter, its states T q, T [p, p] regular; its limit is as it was, of the old states' size."""
    back = np.linalg.inv(T)
    return replace(
        model,
        A=T @ model.A @ back,
        B=T @ model.B,
        c=T @ model.c,
        K=T @ model.K,
        C=model.C @ back,
        initial_mean=T @ model.initial_mean,
        initial_covariance=T @ model.initial_covariance @ T.T,
    )


def radius(model: LinearFilter) -> float:
    """Spectral radius of A - K C: errors of the state die away below 1. Infinite, if a number is not finite."""
    closed = model.A - model.K @ model.C
    return float(np.abs(np.linalg.eigvals(closed)).max()) if np.isfinite(closed).all() else np.inf


def gains(model: LinearFilter, trajectories: Trajectories) -> FloatArray:
    """K_t [n, p, O] of each row, 0 where nothing was seen: they depend on what was seen, not on what it was.

    With them a filter of trajectories is linear in their observations, and can be differentiated as such.
    """
    result = np.zeros((len(trajectories.observation), *model.K.shape))
    covariance = np.tile(model.initial_covariance, (len(trajectories.lengths), 1, 1))
    _gain_rows(model.arrays(), covariance, trajectories.seen, trajectories.first, result)
    return result


@njit(cache=True, error_model="numpy")
def _update_rows(
    model: tuple[FloatArray, ...],
    mean: FloatArray,
    covariance: FloatArray,
    skipped: IntArray,
    action: FloatArray,
    observation: FloatArray,
) -> None:
    """Update all copies in place: q' = A q + B a + c + K_t (o - C q - D a - d)."""
    A, B, c, K, C, D, d, S, bound = model
    n, p = mean.shape
    o, limit = len(d), bound[0]
    moved, innovation, grown = np.empty(p), np.empty(o), np.empty((p, p))
    for i in range(n):
        q, P = mean[i], covariance[i]
        seen = True
        for j in range(o):
            innovation[j] = observation[i, j] - d[j]
            for k in range(p):
                innovation[j] -= C[j, k] * q[k]
            for k in range(D.shape[1]):
                innovation[j] -= D[j, k] * action[i, k]
            seen = seen and np.isfinite(innovation[j])
        unsure = not _settled(P, S, C)
        gain = _gain(A, K, C, S, P) if seen and unsure else K
        for j in range(p):
            moved[j] = c[j]
            for k in range(p):
                moved[j] += A[j, k] * q[k]
            for k in range(B.shape[1]):
                moved[j] += B[j, k] * action[i, k]
            if seen:
                for k in range(o):
                    moved[j] += gain[j, k] * innovation[k]
        _grow(A, K, C, S, P, gain, seen, unsure, grown)
        square, trace = 0.0, 0.0
        for j in range(p):
            square += moved[j] * moved[j]
            trace += grown[j, j]
        if not (np.isfinite(square) and np.isfinite(trace)):
            skipped[i] += 1
            continue
        # A state is never farther from another than the clipped ball is wide.
        shrink = min(1.0, limit / max(np.sqrt(square), 1e-300))
        fit = min(1.0, 4.0 * limit * limit / max(trace, 1e-300))
        for j in range(p):
            q[j] = shrink * moved[j]
            for k in range(p):
                P[j, k] = fit * grown[j, k]


@njit(cache=True, error_model="numpy")
def _settled(P: FloatArray, S: FloatArray, C: FloatArray) -> bool:
    """Whether P is 0 as far as predictions go."""
    p = len(P)
    trace = 0.0
    for j in range(p):
        trace += P[j, j]
    if trace == 0.0:
        return True
    if trace > 1e-6:
        return False
    least, most = np.inf, 0.0
    for j in range(len(S)):
        least = min(least, S[j, j])
        for k in range(p):
            most = max(most, C[j, k] * C[j, k])
    return bool(trace * max(most, 1.0) < SETTLED * least)


@njit(cache=True, error_model="numpy")
def _gain(A: FloatArray, K: FloatArray, C: FloatArray, S: FloatArray, P: FloatArray) -> FloatArray:
    """K_t = (A P C' + K S) (C P C' + S)⁻¹, by Cholesky's factors."""
    # Sums run along rows, term by term, so that they are vectorised without changing their order.
    p, o = K.shape
    PC, total, right = np.zeros((p, o)), S.copy(), np.zeros((p, o))
    Ct = C.T.copy()
    for j in range(p):
        for m in range(p):
            value = P[j, m]
            for k in range(o):
                PC[j, k] += value * Ct[m, k]
    for j in range(o):
        for m in range(p):
            value = C[j, m]
            for k in range(o):
                total[j, k] += value * PC[m, k]
    for j in range(p):
        for m in range(p):
            value = A[j, m]
            for k in range(o):
                right[j, k] += value * PC[m, k]
        for m in range(o):
            value = K[j, m]
            for k in range(o):
                right[j, k] += value * S[m, k]
    cholesky.factor(total)
    for j in range(p):
        cholesky.solve(total, right[j])
    return right


@njit(cache=True, error_model="numpy")
def _grow(
    A: FloatArray,
    K: FloatArray,
    C: FloatArray,
    S: FloatArray,
    P: FloatArray,
    gain: FloatArray,
    seen: bool,
    unsure: bool,
    grown: FloatArray,
) -> None:
    """Fill grown with P'; with nothing seen K_t is 0."""
    p, o = K.shape
    if seen and not unsure:
        grown[:] = 0.0
        return
    closed, excess = A.copy(), K.copy()
    if seen:
        for j in range(p):
            for m in range(o):
                value = gain[j, m]
                excess[j, m] -= value
                for k in range(p):
                    closed[j, k] -= value * C[m, k]
    grown[:] = np.dot(np.dot(excess, S), excess.T)
    if unsure:
        grown += np.dot(np.dot(closed, P), closed.T)
    for j in range(p):
        for k in range(j):
            grown[k, j] = grown[j, k]


@njit(cache=True, error_model="numpy")
def _gain_rows(
    model: tuple[FloatArray, ...], covariance: FloatArray, seen: BoolArray, first: IntArray, result: FloatArray
) -> None:
    """Put the gains of rows that were seen into result; trajectory e is rows first[e] to first[e + 1]."""
    A, K, C, S, bound = model[0], model[3], model[4], model[7], model[8]
    grown = np.empty(A.shape)
    for e in range(len(first) - 1):
        P = covariance[e]
        for i in range(first[e], first[e + 1]):
            unsure = not _settled(P, S, C)
            gain = _gain(A, K, C, S, P) if seen[i] and unsure else K
            _grow(A, K, C, S, P, gain, seen[i], unsure, grown)
            trace = np.trace(grown)
            P[:] = min(1.0, 4.0 * bound[0] * bound[0] / max(trace, 1e-300)) * grown
            if seen[i]:
                result[i] = gain
