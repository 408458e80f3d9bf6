"""Multinomial logistic regression with squared weights penalised, by L-BFGS: the objective of scikit-learn's, whose
import alone would take longer than most fits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from threadpoolctl import threadpool_limits

from predplan.errors import PredplanError

Floats = NDArray[np.float64]
TOLERANCE = 1e-4
MOST_STEPS = 1000


def fit_logistic(
    inputs: sparse.csr_array, target: Floats, weight: Floats, inverse_penalty: float
) -> tuple[Floats, Floats]:
    """Weights theta [W, K] and bias b [K] that minimise, with p_i = softmax(theta' x_i + b) and n = sum_i weight_i,

        sum_i weight_i / n  sum_k -target_ik log p_ik  +  ||theta||^2 / (2 n inverse_penalty).

    inputs x [n, W]; target [n, K], rows on the simplex; weight [n]. Ends when no entry of the gradient exceeds 1e-4.
    Raises PredplanError where L-BFGS stops for another reason.
    """
    from scipy.optimize import minimize  # slow to import, and tagging needs none of it

    share = (weight / weight.sum())[:, None]
    penalty = 1.0 / (inverse_penalty * weight.sum())
    transposed, shape = inputs.T.tocsr(), (inputs.shape[1] + 1, target.shape[1])

    def loss(flat: Floats) -> tuple[float, Floats]:
        theta, bias = np.split(flat.reshape(shape), [-1])
        scores = inputs @ theta + bias
        scores -= scores.max(axis=1, keepdims=True)
        odds = np.exp(scores)
        totals = odds.sum(axis=1, keepdims=True)
        value = (share * target * (np.log(totals) - scores)).sum() + penalty / 2 * (theta**2).sum()
        slope = share * (odds / totals - target)
        return value, np.vstack([transposed @ slope + penalty * theta, slope.sum(axis=0)]).ravel()

    options = {"maxiter": MOST_STEPS, "maxls": 50, "gtol": TOLERANCE, "ftol": 64 * np.finfo(np.float64).eps}
    with threadpool_limits(1):  # the vectors are short: more threads made it ten times slower
        found = minimize(loss, np.zeros(shape).ravel(), jac=True, method="L-BFGS-B", options=options)
    if not found.success:
        steepest = float(np.abs(found.jac).max())
        raise PredplanError(
            f"word classifier: L-BFGS stopped after {found.nit} steps ({found.message}) with a gradient of "
            f"{steepest:.1e}, expected at most {TOLERANCE:.0e}"
        )
    theta, bias = np.split(found.x.reshape(shape), [-1])
    return theta, bias[0]
