"""The floor as it should be: volumes against closed forms, and where a probe can stand."""

import numpy as np
import pytest

from rona_core.planning.rehearsal.milled_floor import CommandedFloor


def test_a_ball_takes_its_cap_and_nothing_twice():
    floor = CommandedFloor(6.0)
    place = np.array((0.1, -0.2, -1.0))
    cap = np.pi * 1.0**2 * (3.0 * 2.5 - 1.0) / 3.0
    assert floor.cut(place, 2.5) == pytest.approx(cap, rel=0.03)
    assert floor.cut(place, 2.5) == 0.0
    assert floor.top_mm.min() == pytest.approx(-1.0, abs=0.01)


def test_a_face_stands_where_the_floor_is_flat_round_it():
    floor = CommandedFloor(9.0)
    x, y = floor.cells().T
    bed = (np.hypot(x, y) <= 7.0).reshape(floor.top_mm.shape)
    floor.top_mm[bed] = -2.0
    places = floor.flat_places(3.5, 1.5, 0.1)
    middle = places[places[:, 2] < -1.0]
    assert len(middle) >= 9
    assert np.hypot(*middle[:, :2].T).max() <= 3.5 + 0.25
    np.testing.assert_allclose(middle[:, 2], -2.0)


def test_a_bed_that_is_narrower_than_the_face_has_no_place_for_it():
    floor = CommandedFloor(9.0)
    x, y = floor.cells().T
    floor.top_mm[(np.hypot(x, y) <= 3.0).reshape(floor.top_mm.shape)] = -2.0
    places = floor.flat_places(3.5, 1.5, 0.1)
    assert not (places[:, 2] < -1.0).any()
