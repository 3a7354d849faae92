import numpy as np
import pytest

from rona_core.mapping.fitting.gaussian_field import field_root

AT = np.arange(0.0, 12.0, 0.5)


def test_a_root_gives_the_covariance_back():
    root = field_root(AT, 2.0)
    expected = np.exp(-0.5 * ((AT[:, None] - AT) / 2.0) ** 2)
    assert root @ root.T == pytest.approx(expected, abs=1e-9)


def test_without_a_reach_every_place_is_by_itself():
    assert np.array_equal(field_root(AT, 0.0), np.eye(len(AT)))
