"""Leading singular vectors against a full decomposition."""

import numpy as np
from scipy import sparse

from predplan.labelling.subspace import Scaled, gram_product, right_singular_vectors


def matrix(rows: int, columns: int, rank: int) -> sparse.csr_array:
    rng = np.random.default_rng(0)
    left, right = rng.standard_normal((rows, rank)), rng.standard_normal((rank, columns))
    return sparse.csr_array((left * 0.5 ** np.arange(rank)) @ right)


def unscaled(counts: sparse.csr_array) -> Scaled:
    return Scaled(counts, np.ones(counts.shape[0]), np.ones(counts.shape[1]))


def test_spans_the_leading_singular_vectors_by_falling_value() -> None:
    tall = matrix(200, 40, 30)
    found = right_singular_vectors(unscaled(tall), 4, np.random.default_rng(1))
    _, values, right = np.linalg.svd(tall.toarray())
    np.testing.assert_allclose(found.T @ found, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(np.abs(np.diag(right[:4] @ found)), 1.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(tall @ found, axis=0), values[:4], rtol=1e-6)


def test_directions_that_are_missing_are_zero() -> None:
    for shape, rank, dimension in (((50, 20), 2, 6), ((3, 20), 3, 10), ((20, 3), 3, 10)):
        low = matrix(*shape, rank)
        found = right_singular_vectors(unscaled(low), dimension, np.random.default_rng(1))
        assert np.isfinite(found).all()
        np.testing.assert_allclose(found @ (found.T @ low.T.toarray()), low.T.toarray(), atol=1e-8)


def test_gram_product_is_two_products() -> None:
    rng = np.random.default_rng(2)
    tall, basis, rows, columns = matrix(60, 9, 5), rng.standard_normal((9, 3)), rng.random(60), rng.random(9)
    scaled = rows[:, None] * tall.toarray() * columns
    np.testing.assert_allclose(gram_product(Scaled(tall, rows, columns), basis), scaled.T @ (scaled @ basis))
