"""The depth put right: what is raised keeps the limit, and layers without work are left out."""

import numpy as np
import pytest

from rona_core.planning.milling.burr import Burr
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.planning.rehearsal.milled_floor import ceiling_mm, raised_path


def path(depths, tools):
    """Return a path that comes down, cuts two places and goes up again, layer by layer."""
    n, down = 4 * len(depths), np.array((0.0, np.sin(0.2), -np.cos(0.2)))
    axes, radii = np.tile(down, (n, 1)), np.repeat(np.array((2.5, 1.0))[list(tools)], 4)
    heights = np.concatenate([(2.0, depth, depth, 2.0) for depth in depths])
    bottoms = np.column_stack((np.tile((0.0, 0.0, 1.0, 1.0), len(depths)), np.zeros(n), heights))
    return MillingPath(
        bottoms + radii[:, None] * (axes + (0.0, 0.0, 1.0)),
        axes,
        np.tile((Move.RETRACT, Move.CUT, Move.CUT, Move.RETRACT), len(depths)),
        np.repeat(np.arange(len(depths)), 4),
        np.repeat(tools, 4),
        (Burr(5.0, 2.5), Burr(2.0, 1.0)),
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


def test_below_the_ceiling_nothing_is_left_and_above_it_all_stays():
    planned = path((-1.0, -2.0, -3.0, -2.5), (0, 0, 0, 1))
    left, rows = raised_path(planned, 0, -2.2, 0.5)
    assert left.bottoms_bed()[:, 2].min() == pytest.approx(-2.2)
    assert np.unique(left.layers).tolist() == [1, 2, 3]
    np.testing.assert_array_equal(left.tips_bed[:, :2], planned.tips_bed[rows, :2])
    stays = planned.bottoms_bed()[rows, 2] >= -2.2
    np.testing.assert_array_equal(left.tips_bed[stays], planned.tips_bed[rows[stays]])
    np.testing.assert_array_equal(left.axes_bed, planned.axes_bed[rows])


def test_a_layer_is_raised_and_those_that_would_cut_nothing_are_left_out():
    left, rows = raised_path(path((-1.0, -2.0, -3.0, -2.0, -3.0), (0, 0, 0, 1, 1)), 0, -1.6, 0.5)
    assert np.unique(left.layers).tolist() == [1, 3]  # the rim is cut once, too
    assert left.bottoms_bed()[:, 2] == pytest.approx([2.0, -1.6, -1.6, 2.0] * 2)
    assert rows.tolist() == [4, 5, 6, 7, 12, 13, 14, 15]


def test_what_is_milled_already_is_not_milled_again():
    assert raised_path(path((-1.0, -2.0, -3.0), (0, 0, 0)), 1, -1.2, 0.5) is None


def test_above_the_bone_nothing_is_milled():
    assert raised_path(path((-1.0, -2.0), (0, 0)), -1, 0.6, 0.5) is None
    assert raised_path(path((-1.0, -2.0), (0, 0)), -1, 0.4, 0.5) is not None
