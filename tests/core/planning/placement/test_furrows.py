import numpy as np
import pytest
from scipy.stats import norm

from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.build_maps import LEAST_THICKNESS_MM
from rona_core.planning.placement.furrows import HALF_WIDTH_MM, MEAN_MM, SIGMA_MM, with_furrows

AT = np.arange(-20.0, 21.0)
U, V = np.meshgrid(AT, AT, indexing="ij")
OUTER, THICKNESS_MM, DRAWS = np.zeros_like(U), 5.0, 1500
MIDDLE = int(np.flatnonzero(AT == 0.0)[0])
ROW = np.column_stack((AT, np.zeros_like(AT), np.zeros_like(AT)))  # A-scans along v = 0


def scanned(heard):
    """Return maps of a plate whose A-scans lie along one row of the grid."""
    everywhere, heard = np.ones(U.shape, dtype=bool), np.asarray(heard)
    outer, inner = (
        BoundaryMap(Pose.identity(), AT, AT, height, everywhere)
        for height in (OUTER, OUTER - THICKNESS_MM)
    )
    below = ROW - (0.0, 0.0, THICKNESS_MM)
    return Maps(ROW, below, np.ones_like(heard), heard, outer, inner, outer, None)


def furrows(maps, draws=DRAWS, thickness=THICKNESS_MM):
    outer = np.repeat(OUTER[None], draws, axis=0)
    return with_furrows(maps, outer, outer - thickness) + thickness


def test_where_every_ascan_heard_the_inner_boundary_nothing_changes():
    assert np.all(furrows(scanned(AT < 99.0), draws=3) == 0.0)


def test_one_place_in_four_that_was_not_heard_has_a_furrow_some_deeper_than_a_millimetre():
    depth = furrows(scanned(AT != 0.0))[:, MIDDLE, MIDDLE]
    assert depth.min() == 0.0
    for least_mm in (0.0, 0.5, 1.0):
        expected = norm.sf(least_mm, MEAN_MM, SIGMA_MM)
        error = np.sqrt(expected * (1.0 - expected) / DRAWS)
        assert np.mean(depth > least_mm) == pytest.approx(expected, abs=4.0 * error)


def test_a_furrow_is_a_gaussian_across_and_leaves_what_is_far_alone():
    depth = furrows(scanned(AT != 0.0), draws=400)
    across = np.sqrt(np.mean(depth[:, MIDDLE, :] ** 2, axis=0))
    expected = np.exp(-0.5 * (AT / HALF_WIDTH_MM) ** 2)
    assert across[MIDDLE - 1 : MIDDLE + 2] / across[MIDDLE] == pytest.approx(
        expected[MIDDLE - 1 : MIDDLE + 2], rel=0.1
    )
    assert depth[:, np.hypot(U, V) > 6.0 * HALF_WIDTH_MM].max() < 1e-6


def test_ascans_side_by_side_tell_of_one_furrow():
    depth = furrows(scanned(np.abs(AT) > 19.0))[:, :, MIDDLE]
    near = np.corrcoef(depth[:, MIDDLE], depth[:, MIDDLE + 1])[0, 1]
    far = np.corrcoef(depth[:, MIDDLE - 19], depth[:, MIDDLE + 19])[0, 1]
    assert near > 0.9
    assert far < 0.4


def test_a_furrow_never_goes_through_the_bone():
    thickness = LEAST_THICKNESS_MM + 0.1
    depth = furrows(scanned(AT != 0.0), thickness=thickness)
    assert depth.max() == pytest.approx(0.1)


def test_the_same_seed_gives_the_same_furrows():
    maps = scanned(AT != 0.0)
    outer = np.repeat(OUTER[None], 3, axis=0)
    first, again, other = (with_furrows(maps, outer, outer - 5.0, seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
