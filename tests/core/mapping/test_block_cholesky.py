"""Block-tridiagonal Cholesky against the dense one."""

import numpy as np
import pytest

from rona_core.mapping.fitting.block_cholesky import BlockTridiagonal


def blocks(count, size, seed=0):
    """A positive definite matrix, as blocks and dense."""
    rng = np.random.default_rng(seed)
    below = rng.normal(size=(count - 1, size, size))
    diagonal = rng.normal(size=(count, size, size))
    diagonal = diagonal + diagonal.transpose(0, 2, 1) + 12.0 * size * np.eye(size)
    dense = np.zeros((count * size, count * size))
    for k in range(count):
        here = slice(k * size, (k + 1) * size)
        dense[here, here] = diagonal[k]
        if k:
            before = slice((k - 1) * size, k * size)
            dense[here, before], dense[before, here] = below[k - 1], below[k - 1].T
    return BlockTridiagonal(diagonal, below), dense


@pytest.mark.parametrize(("count", "size"), [(1, 5), (2, 3), (7, 4)])
def test_all_that_follows_is_that_of_the_dense_matrix(count, size):
    matrix, dense = blocks(count, size)
    rng = np.random.default_rng(1)
    right = rng.normal(size=(count * size, 3))
    factor = matrix.cholesky()
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), atol=1e-12)
    np.testing.assert_allclose(
        factor.solve(right[:, 0]), np.linalg.solve(dense, right[:, 0]), atol=1e-12
    )
    assert factor.log_determinant() == pytest.approx(np.linalg.slogdet(dense)[1])
    np.testing.assert_allclose(factor.variances(), np.diag(np.linalg.inv(dense)), atol=1e-14)
    root = factor.spread(np.eye(count * size))
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(dense), atol=1e-14)
    assert matrix.energy(right[:, 1]) == pytest.approx(right[:, 1] @ dense @ right[:, 1])


def test_sums_and_multiples_are_those_of_the_matrices():
    (one, dense_one), (two, dense_two) = blocks(3, 4, 1), blocks(3, 4, 2)
    both = (one + two * 0.5).cholesky()
    right = np.ones(12)
    wanted = np.linalg.solve(dense_one + 0.5 * dense_two, right)
    np.testing.assert_allclose(both.solve(right), wanted, atol=1e-13)


def test_what_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        (blocks(3, 4)[0] * -1.0).cholesky()
