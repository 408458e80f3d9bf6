"""Leading right singular vectors of a tall sparse matrix, by subspace iteration (Halko, Martinsson and Tropp 2011).

Both products of a step are taken in one pass over the rows, so nothing as tall as the matrix is stored.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.labelling.active_set import Integers, compiled_sums

Floats = NDArray[np.float64]
MORE_VECTORS = 10
STEPS = 4  # 2, 4 and 7 differ by less than 0.2 points of accuracy on tweets
PARTS = 2


def right_singular_vectors(matrix: sparse.csr_array, dimension: int, rng: np.random.Generator) -> Floats:
    """The leading right singular vectors [columns, dimension] of matrix [rows, columns], by falling singular value."""
    basis = rng.standard_normal((matrix.shape[1], min(dimension + MORE_VECTORS, *matrix.shape)))
    for _ in range(STEPS + 1):
        basis = _orthonormal(gram_product(matrix, basis))
    _, rotation = np.linalg.eigh(basis.T @ gram_product(matrix, basis))
    return np.asarray(basis @ rotation[:, ::-1][:, :dimension])


def gram_product(matrix: sparse.csr_array, basis: Floats) -> Floats:
    """matrix' (matrix basis) [columns, n]; the same bits whatever the number of cores."""
    dense = np.ascontiguousarray(basis)
    cuts = np.searchsorted(matrix.indptr, np.linspace(0, matrix.nnz, PARTS + 1)[1:-1])
    borders = [0, *cuts.tolist(), matrix.shape[0]]

    def part(number: int) -> Floats:
        return np.asarray(
            _add_rows(matrix.indptr, matrix.indices, matrix.data, dense, borders[number], borders[number + 1])
        )

    with ThreadPoolExecutor(PARTS) as pool:
        return np.asarray(sum(pool.map(part, range(PARTS))))


def _orthonormal(vectors: Floats) -> Floats:
    """The same span; directions that are missing come back as zeros."""
    squares, rotation = np.linalg.eigh(vectors.T @ vectors)
    present = squares > 1e-12 * squares[-1]
    scale = np.where(present, 1.0 / np.sqrt(np.where(present, squares, 1.0)), 0.0)
    return np.asarray(vectors @ (rotation * scale))


@compiled_sums
def _add_rows(indptr: Integers, indices: Integers, data: Floats, basis: Floats, first: int, last: int) -> Floats:
    size = basis.shape[1]
    total, row = np.zeros_like(basis), np.empty(size)
    for place in range(first, last):
        row[:] = 0.0
        for entry in range(indptr[place], indptr[place + 1]):
            value, vector = data[entry], basis[indices[entry]]
            for column in range(size):
                row[column] += value * vector[column]
        for entry in range(indptr[place], indptr[place + 1]):
            value, vector = data[entry], total[indices[entry]]
            for column in range(size):
                vector[column] += value * row[column]
    return total
