"""An implant in a bed as it was milled: height, gap and rock against what was built."""

from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.evaluation.milling_metrics import seated
from rona_core.planning.implants.implant import Implant
from rona_core.planning.implants.solids import Stack, cylinder

RADIUS_MM, DEPTH_MM = 6.0, 3.0
DISC = Implant("disc", Stack((cylinder(2.0 * RADIUS_MM, 0.0, DEPTH_MM),)))


def bed(floor, radius=6.3, middle=(0.0, 0.0)):
    """Return bone with a round bed in it, whose floor has heights by x and y."""
    axis = np.arange(-9.0, 9.01, 0.2)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    inside = np.hypot(x - middle[0], y - middle[1]) <= radius
    return SimpleNamespace(x_mm=axis, y_mm=axis, top_mm=np.where(inside, floor(x, y), 0.0))


def test_on_a_flat_floor_it_sits_where_the_floor_is_and_does_not_rock():
    found = seated(DISC, bed(lambda x, y: np.full(x.shape, -3.3)))
    assert found.high_mm == pytest.approx(-0.3)
    assert found.gap_mean_mm == pytest.approx(0.0, abs=1e-9)
    assert found.rock_mm == pytest.approx(0.0, abs=1e-6)
    assert found.aside_mm < 0.35


def test_it_gives_way_to_a_bed_beside_its_place():
    found = seated(DISC, bed(lambda x, y: np.full(x.shape, -3.0), middle=(0.5, 0.0)))
    assert found.high_mm == pytest.approx(0.0, abs=1e-9)
    assert 0.15 <= found.aside_mm <= 0.8


def test_in_a_bed_that_is_too_narrow_it_stands_on_the_rim():
    found = seated(DISC, bed(lambda x, y: np.full(x.shape, -3.3), radius=5.0))
    assert found.high_mm == pytest.approx(DEPTH_MM)


def test_on_a_ridge_through_the_middle_it_rocks_by_what_the_ridge_is_high():
    found = seated(DISC, bed(lambda x, y: -3.3 + 0.2 * (np.abs(x) < 0.15)))
    # from one side to the other: the edge goes down by the height of the ridge
    assert found.high_mm == pytest.approx(-0.1)
    assert 0.15 <= found.rock_mm <= 0.45
