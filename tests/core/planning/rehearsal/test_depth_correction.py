"""The depth put right: what is raised keeps the limit, and layers without work are left out."""

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_core.planning.rehearsal.depth_correction import ceiling_mm, corrected_way
from rona_core.planning.rehearsal.site import BurrWay


def way(depths, radii):
    """Return a way of three places a layer."""
    n = 3 * len(depths)
    return BurrWay(
        Pose.identity(),
        np.column_stack((np.tile((0.0, 1.0, 2.0), len(depths)), np.zeros(n), np.repeat(depths, 3))),
        np.repeat(np.asarray(radii, dtype=np.float64), 3),
        np.zeros((n, 6)),
        np.arange(n, dtype=np.float64),
        np.ones(n),
        np.repeat(np.arange(len(depths)), 3),
    )


def test_enough_bone_changes_nothing():
    random = np.random.default_rng(0)
    bottoms = np.array(((0.0, 0.0, -3.0), (1.0, 0.0, -3.0)))
    assert ceiling_mm(bottoms, random.normal(3.0, 0.2, (2, 200)), 1.0, 2.33) == -np.inf


@pytest.mark.parametrize("mean", [-0.5, 0.2, 1.2])
def test_at_the_ceiling_the_limit_holds_as_surely_as_was_asked(mean):
    random = np.random.default_rng(1)
    bottoms = np.column_stack((np.zeros((5, 2)), np.linspace(-3.5, -3.0, 5)))
    drawn = mean + random.normal(0.0, 0.3, (5, 20_000))
    high = ceiling_mm(bottoms, drawn, 1.0, 2.326)
    lifted = np.maximum(high - bottoms[:, 2], 0.0)
    kept = ((drawn + lifted[:, None]).min(axis=0) >= 1.0).mean()
    assert kept == pytest.approx(0.99, abs=0.006)


def test_as_planned_all_of_the_way_is_told():
    planned = way((-1.0, -2.0, -3.0, -2.5), (2.5, 2.5, 2.5, 1.0))
    commanded, rows = corrected_way(planned, 0, -np.inf)
    assert rows.tolist() == list(range(12))
    np.testing.assert_array_equal(commanded.bottoms_bed, planned.bottoms_bed)


def test_a_layer_is_raised_and_those_that_would_cut_nothing_are_left_out():
    planned = way((-1.0, -2.0, -3.0, -2.0, -3.0), (2.5, 2.5, 2.5, 1.0, 1.0))
    commanded, rows = corrected_way(planned, 0, -1.6)
    assert np.unique(commanded.layers).tolist() == [0, 1, 3]  # the rim is cut once, too
    assert commanded.bottoms_bed[:, 2].tolist() == [-1.0] * 3 + [-1.6] * 6
    assert rows.tolist() == [0, 1, 2, 3, 4, 5, 9, 10, 11]


def test_what_is_milled_already_is_not_milled_again():
    commanded, _ = corrected_way(way((-1.0, -2.0, -3.0), (2.5, 2.5, 2.5)), 1, -1.2)
    assert np.unique(commanded.layers).tolist() == [0, 1]
    assert commanded.bottoms_bed[:, 2].min() == -2.0
