"""Least squares on the simplex, one word at a time (Eqs. 3.14, 3.23 with gamma >= 0, and 3.27).

Every word w has the same small quadratic program

    min_gamma  gamma' H gamma - 2 b_w' gamma    subject to  1' gamma = 1,  gamma >= 0

with one Hessian H [K, K] for all words. Two solvers: an exact active set compiled for small K, and PIQP.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import piqp
from numpy.typing import NDArray

from predplan.errors import InputError, PredplanError
from predplan.labelling.active_set import EPSILON, Floats, complementarities, minimise_rows

Booleans = NDArray[np.bool_]
Solver = Literal["active_set", "piqp"]

ACTIVE_SET_RESIDUAL = 1e-10
PIQP_RESIDUAL = 1e-9
PIQP_TOLERANCE = 1e-11


@dataclass(frozen=True)
class SimplexSolution:
    """gamma [V, K]: label posteriors, rows on the simplex; residual [V]: see kkt_residuals, no unit."""

    gamma: Floats
    residual: Floats


def simplex_posteriors(
    RRt: Floats,
    QR: Floats,
    labelled: Floats | None,
    seen: Booleans,
    lam: float,
    solver: Solver = "active_set",
) -> SimplexSolution:
    """Label posteriors of every word by Eq. 3.27 with gamma >= 0.

    min (1 - lam) ||q_w - gamma' R||^2 + lam ||gamma - gamma'_w||^2 for words seen labelled, and lam = 0 for
    all others, for which the printed equation has no gamma'_w. At lam = 1 a seen word keeps gamma'_w exactly.

    RRt [K, K] is R R'; QR [V, K] is Q R'; labelled [V, K] holds gamma'_w (rows of unseen words are ignored);
    seen [V] marks the words seen labelled; lam in [0, 1].
    Raises InputError on non-finite values, wrong shapes, lam outside [0, 1] or a seen row off the simplex.
    """
    _check_program(RRt, QR)
    if not 0.0 <= lam <= 1.0:
        raise InputError(f"lam: found {lam}, expected a number in [0, 1]")
    if seen.shape != (len(QR),):
        raise InputError(f"seen: found shape {seen.shape}, expected ({len(QR)},)")
    if solver not in ("active_set", "piqp"):
        raise InputError(f"solver: found {solver!r}, expected 'active_set' or 'piqp'")
    solve = solve_active_set if solver == "active_set" else solve_piqp
    seen = seen.astype(np.bool_)
    if lam == 0.0 or not seen.any():
        return solve(RRt, QR)
    target = _labelled_rows(labelled, seen, QR.shape)
    gamma, residual = np.empty(QR.shape), np.zeros(len(QR))
    unlabelled = solve(RRt, QR[~seen])
    gamma[~seen], residual[~seen] = unlabelled.gamma, unlabelled.residual
    if lam == 1.0:
        gamma[seen] = target
    else:
        hessian = (1.0 - lam) * RRt + lam * np.eye(len(RRt))
        regularised = solve(hessian, (1.0 - lam) * QR[seen] + lam * target)
        gamma[seen], residual[seen] = regularised.gamma, regularised.residual
    return SimplexSolution(gamma, residual)


def kkt_residuals(H: Floats, B: Floats, gamma: Floats) -> Floats:
    """How far each row is from optimal. H [K, K], B [V, K], gamma [V, K] -> [V], no unit.

    With g = H gamma - b (half the gradient), the multiplier of the sum is min g and those of gamma >= 0 are
    s = g - min g, so stationarity and s >= 0 hold by construction. What is left is complementarity,
    s' gamma, which also bounds half the distance of the objective from its minimum; it is divided by
    max_h H_hh + max_h |b_h| of the centred program, so that neither units nor what all rows of R share count.
    The residual is the largest of that, |1' gamma - 1| and max_h -gamma_h.
    """
    _check_program(H, B)
    if gamma.shape != B.shape:
        raise InputError(f"gamma: found shape {gamma.shape}, expected {B.shape}")
    return complementarities(*_centred(H, B), np.ascontiguousarray(gamma, np.float64))


def solve_active_set(H: Floats, B: Floats) -> SimplexSolution:
    """Exact solution of every row's program. H [K, K] symmetric positive semidefinite, B [V, K].

    Starts from the positive part of the minimiser without gamma >= 0, which one pseudo-inverse gives for all
    rows. A singular H is safe: the Cholesky factors carry a ridge of 16 K eps max_h (H_hh, eps |b_h|), and as
    each solve gives a step from the present point, not the point, repeating it removes the ridge's effect.
    Rows that the bounded number of steps leaves above a residual of 1e-10 are given to PIQP.
    Raises InputError on bad input, PredplanError where a residual stays above 1e-10.
    """
    _check_program(H, B)
    gamma = np.empty(B.shape)
    centred, linear = _centred(H, B)
    inverse = np.linalg.pinv(centred, rcond=1e-12, hermitian=True)
    minimise_rows(centred, linear, np.ascontiguousarray(inverse), gamma)
    residual = complementarities(centred, linear, gamma)
    hard = np.flatnonzero(~(residual <= ACTIVE_SET_RESIDUAL))
    if len(hard):
        again = solve_piqp(H, B[hard])
        gamma[hard], residual[hard] = again.gamma, again.residual
    _check_residuals(residual, ACTIVE_SET_RESIDUAL, "active set")
    return SimplexSolution(gamma, residual)


def solve_piqp(H: Floats, B: Floats) -> SimplexSolution:
    """Every row's program by PIQP: one set-up, then a new linear term a row. H [K, K], B [V, K].

    PIQP's own scaling is off, as `update` repeats it from where the row before left it, so that a solution would
    depend on the rows before; the program is divided by its largest curvature instead.
    Raises InputError on bad input, PredplanError where PIQP's status is not solved or a residual exceeds 1e-9.
    """
    _check_program(H, B)
    states = len(H)
    centred, linear = _centred(H, B)
    scale = max(float(np.diag(centred).max()), EPSILON * float(np.abs(linear).max(initial=0.0))) or 1.0
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = PIQP_TOLERANCE
    solver.settings.eps_rel = PIQP_TOLERANCE
    solver.settings.eps_duality_gap_abs = PIQP_TOLERANCE
    solver.settings.eps_duality_gap_rel = PIQP_TOLERANCE
    solver.settings.preconditioner_iter = 0
    hessian = np.asfortranarray(2.0 * centred / scale)
    ones = np.ones((1, states), order="F")
    solver.setup(hessian, np.zeros(states), ones, np.ones(1), x_l=np.zeros(states), x_u=np.full(states, np.inf))
    gamma = np.empty(B.shape)
    for word, c in enumerate(-2.0 * linear / scale):
        solver.update(c=c)
        status = solver.solve()
        if status != piqp.PIQP_SOLVED:
            raise PredplanError(f"quadratic program of word {word}: PIQP ended with {status.name}, expected solved")
        gamma[word] = solver.result.x
    np.maximum(gamma, 0.0, out=gamma)
    gamma /= gamma.sum(axis=1, keepdims=True)
    residual = complementarities(centred, linear, gamma)
    _check_residuals(residual, PIQP_RESIDUAL, "PIQP")
    return SimplexSolution(gamma, residual)


def _centred(H: Floats, B: Floats) -> tuple[Floats, Floats]:
    """The same program on 1' gamma = 1 for R less its mean row, whose minimiser without signs is 1/K + H^+ b.

    What all rows of R share cancels in the differences, so near-equal rows do not cost accuracy twice. Negative
    eigenvalues, which only the rounding of H can leave, are set to zero.
    """
    middle = H.mean(axis=1)
    values, vectors = np.linalg.eigh(H - middle - middle[:, None] + middle.mean())
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    linear = B - middle
    return root @ root.T, np.ascontiguousarray(linear - linear.mean(axis=1, keepdims=True), np.float64)


def _labelled_rows(labelled: Floats | None, seen: Booleans, shape: tuple[int, ...]) -> Floats:
    if labelled is None:
        raise InputError("labelled: found none, expected posteriors of the words seen labelled, as lam > 0")
    if labelled.shape != shape:
        raise InputError(f"labelled: found shape {labelled.shape}, expected {shape}")
    rows = labelled[seen]
    off = ~((rows >= 0.0).all(axis=1) & (np.abs(rows.sum(axis=1) - 1.0) <= 1e-9))
    if off.any():
        word = int(np.flatnonzero(seen)[off][0])
        raise InputError(f"labelled, row {word}: found {labelled[word]}, expected probabilities that sum to one")
    return rows


def _check_program(H: Floats, B: Floats) -> None:
    if H.ndim != 2 or H.shape[0] != H.shape[1] or not len(H):
        raise InputError(f"Hessian: found shape {H.shape}, expected [K, K] with K >= 1")
    if B.ndim != 2 or B.shape[1] != len(H):
        raise InputError(f"linear terms: found shape {B.shape}, expected [V, {len(H)}]")
    if not np.isfinite(H).all():
        raise InputError("Hessian: found a value that is not finite, expected finite numbers")
    if not np.isfinite(B).all():
        word = int(np.flatnonzero(~np.isfinite(B).all(axis=1))[0])
        raise InputError(f"linear terms, row {word}: found a value that is not finite, expected finite numbers")
    largest = float(np.abs(H).max())
    if np.abs(H - H.T).max() > 1e-12 * largest or np.linalg.eigvalsh(H)[0] < -1e-10 * largest:
        raise InputError("Hessian: found one not symmetric positive semidefinite, expected R R' or the like")


def _check_residuals(residual: Floats, bound: float, solver: str) -> None:
    if not (residual <= bound).all():
        word = int(np.argmax(np.where(np.isnan(residual), np.inf, residual)))
        raise PredplanError(
            f"quadratic program of word {word}: {solver} left a KKT residual of {residual[word]:.1e}, "
            f"expected at most {bound:.0e}"
        )
