"""Banded Cholesky against the dense one."""

import numpy as np
import pytest

from rona_core.mapping.fitting.banded_cholesky import BandedMatrix, FewBands


def banded(count, width, seed=0):
    """A positive definite matrix of count times width rows, as bands and dense."""
    rng = np.random.default_rng(seed)
    bands = np.asfortranarray(rng.normal(size=(width + 1, count * width)))
    bands[0] += 6.0 * width
    dense = np.diag(bands[0])
    for depth in range(1, min(width + 1, count * width)):
        below = np.diag(bands[depth, :-depth], -depth)
        dense += below + below.T
    return BandedMatrix(bands), dense


@pytest.mark.parametrize(("count", "width"), [(1, 5), (2, 3), (7, 4)])
def test_all_that_follows_is_that_of_the_dense_matrix(count, width):
    matrix, dense = banded(count, width)
    rng = np.random.default_rng(1)
    right = rng.normal(size=(count * width, 3))
    factor = matrix.cholesky()
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), atol=1e-12)
    np.testing.assert_allclose(
        factor.solve(right[:, 0]), np.linalg.solve(dense, right[:, 0]), atol=1e-12
    )
    assert factor.log_determinant() == pytest.approx(np.linalg.slogdet(dense)[1])
    np.testing.assert_allclose(factor.variances(), np.diag(np.linalg.inv(dense)), atol=1e-14)
    root = factor.spread(np.eye(count * width))
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(dense), atol=1e-14)
    assert matrix.energy(right[:, 1]) == pytest.approx(right[:, 1] @ dense @ right[:, 1])


def test_sums_and_multiples_are_those_of_the_matrices():
    (one, dense_one), (two, dense_two) = banded(3, 4, 1), banded(3, 4, 2)
    all_of_it = FewBands(tuple(range(5)), np.ascontiguousarray(two.bands))
    np.testing.assert_array_equal(all_of_it.filled().bands, two.bands)
    both = one.plus(0.5, all_of_it, np.zeros_like(one.bands)).cholesky(overwrite=True)
    right = np.ones(12)
    wanted = np.linalg.solve(dense_one + 0.5 * dense_two, right)
    np.testing.assert_allclose(both.solve(right), wanted, atol=1e-13)


def test_what_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        BandedMatrix(-banded(3, 4)[0].bands).cholesky()
