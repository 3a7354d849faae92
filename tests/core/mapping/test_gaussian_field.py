import numpy as np
import pytest

from rona_core.mapping.fitting.gaussian_field import field_root, overlap_reach

AT = np.arange(0.0, 12.0, 0.5)


def test_a_root_gives_the_covariance_back():
    root = field_root(AT, 2.0)
    expected = np.exp(-0.5 * ((AT[:, None] - AT) / 2.0) ** 2)
    assert root @ root.T == pytest.approx(expected, abs=1e-9)


def test_without_a_reach_every_place_is_by_itself():
    assert np.array_equal(field_root(AT, 0.0), np.eye(len(AT)))


def test_a_reach_stands_for_the_overlap_of_two_faces():
    """Over all shifts the share of one disc that another covers, against that of the Gaussian."""
    width = 6.35
    x = np.arange(-1.2 * width, 1.2 * width, 0.1)
    away = np.hypot(x[:, None], x)
    half = np.minimum(away / width, 1.0)
    share = 2.0 / np.pi * (np.arccos(half) - half * np.sqrt(1.0 - half**2))
    alike = np.exp(-0.5 * (away / overlap_reach(width)) ** 2)
    assert alike.sum() == pytest.approx(share.sum(), rel=0.01)
    assert np.abs(alike - share).max() < 0.12
