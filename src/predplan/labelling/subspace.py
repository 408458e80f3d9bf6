"""Leading right singular vectors of a tall sparse matrix, by subspace iteration (Halko, Martinsson and Tropp 2011).

Both products of a step are taken in one pass over the rows, so nothing as tall as the matrix is stored.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from predplan.labelling.active_set import Integers, compiled_sums

Floats = NDArray[np.float64]
MORE_VECTORS = 10
STEPS = 4  # 2, 4 and 7 differ by less than 0.2 points of accuracy on tweets
PARTS = 2


@dataclass(frozen=True)
class Scaled:
    """The matrix diag(rows) counts diag(columns), of which only the factors are kept: rows [n], columns [m]."""

    counts: sparse.csr_array
    rows: Floats
    columns: Floats


def right_singular_vectors(matrix: Scaled, dimension: int, rng: np.random.Generator) -> Floats:
    """The leading right singular vectors [columns, dimension] of a matrix, by falling singular value."""
    shape = matrix.counts.shape
    basis = rng.standard_normal((shape[1], min(dimension + MORE_VECTORS, *shape)))
    for _ in range(STEPS + 1):
        basis = _orthonormal(gram_product(matrix, basis))
    _, rotation = np.linalg.eigh(basis.T @ gram_product(matrix, basis))
    return np.asarray(basis @ rotation[:, ::-1][:, :dimension])


def gram_product(matrix: Scaled, basis: Floats) -> Floats:
    """matrix' (matrix basis) [columns, n]; the same bits whatever the number of cores."""
    counts, weights, scale = matrix.counts, matrix.rows**2, matrix.columns[:, None]
    dense = np.ascontiguousarray(scale * basis)
    cuts = np.searchsorted(counts.indptr, np.linspace(0, counts.nnz, PARTS + 1)[1:-1])
    borders = [0, *cuts.tolist(), counts.shape[0]]

    def part(number: int) -> Floats:
        first, last = borders[number], borders[number + 1]
        return np.asarray(_add_rows(counts.indptr, counts.indices, counts.data, weights, dense, first, last))

    with ThreadPoolExecutor(PARTS) as pool:
        return np.asarray(scale * sum(pool.map(part, range(PARTS))))


def _orthonormal(vectors: Floats) -> Floats:
    """The same span; directions that are missing come back as zeros."""
    squares, rotation = np.linalg.eigh(vectors.T @ vectors)
    present = squares > 1e-12 * squares[-1]
    scale = np.where(present, 1.0 / np.sqrt(np.where(present, squares, 1.0)), 0.0)
    return np.asarray(vectors @ (rotation * scale))


@compiled_sums
def _add_rows(
    indptr: Integers, indices: Integers, data: Floats, weights: Floats, basis: Floats, first: int, last: int
) -> Floats:
    """counts' diag(weights) (counts basis) of the rows first to last."""
    size = basis.shape[1]
    total, row = np.zeros_like(basis), np.empty(size)
    for place in range(first, last):
        row[:] = 0.0
        for entry in range(indptr[place], indptr[place + 1]):
            value, vector = data[entry], basis[indices[entry]]
            for column in range(size):
                row[column] += value * vector[column]
        for column in range(size):
            row[column] *= weights[place]
        for entry in range(indptr[place], indptr[place + 1]):
            value, vector = data[entry], total[indices[entry]]
            for column in range(size):
                vector[column] += value * row[column]
    return total
