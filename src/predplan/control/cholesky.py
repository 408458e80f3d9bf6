"""Cholesky's factors of small matrices, in compiled loops over copies."""

import numpy as np
from numba import njit

from predplan.control.tasks import FloatArray


@njit(cache=True, error_model="numpy")
def factor(matrix: FloatArray) -> None:
    """Put L with matrix = L L' into the lower triangle. A matrix that is not positive definite gives NaN."""
    for j in range(len(matrix)):
        for k in range(j + 1):
            value = matrix[j, k]
            for m in range(k):
                value -= matrix[j, m] * matrix[k, m]
            matrix[j, k] = np.sqrt(value) if j == k else value / matrix[k, k]


@njit(cache=True, error_model="numpy")
def solve(lower: FloatArray, right: FloatArray) -> None:
    """Put (L L')⁻¹ right in place of right [n]; only L's lower triangle is read."""
    n = len(lower)
    for k in range(n):
        value = right[k]
        for m in range(k):
            value -= right[m] * lower[k, m]
        right[k] = value / lower[k, k]
    for k in range(n - 1, -1, -1):
        value = right[k]
        for m in range(k + 1, n):
            value -= right[m] * lower[m, k]
        right[k] = value / lower[k, k]
