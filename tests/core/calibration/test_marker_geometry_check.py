from itertools import permutations

import numpy as np
import pytest

from rona_core.calibration.tracking_error.marker_geometry_check import check_marker_geometry, letter
from rona_core.errors import InvalidInputError
from tests.helpers.pivots import GEOMETRY, marker_sweep

MARKERS = marker_sweep(np.random.default_rng(0), 6, n=60)[0]


def test_the_right_geometry_fits_and_every_distance_is_listed():
    found = check_marker_geometry(MARKERS, GEOMETRY[6])
    assert found.complaints == ()
    assert found.order is None
    assert [d.markers for d in found.distances] == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    for d in found.distances:
        assert d.measured_mm == pytest.approx(d.stated_mm, abs=5.0 * d.sigma_mm)
        assert 0.0 < d.sigma_mm < 0.1
    assert found.scale == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("order", [p for p in permutations(range(4)) if p != (0, 1, 2, 3)])
def test_markers_in_another_order_are_told_and_the_order_found(order):
    stated = GEOMETRY[6][list(order)]
    found = check_marker_geometry(MARKERS, stated)
    np.testing.assert_allclose(stated[list(found.order)], GEOMETRY[6])
    assert "another order" in found.complaints[0]


@pytest.mark.parametrize("factor", [25.4, 1.03, 0.1])
def test_a_wrong_unit_is_told_with_its_factor(factor):
    found = check_marker_geometry(MARKERS, GEOMETRY[6] / factor)
    assert found.scale == pytest.approx(factor, rel=1e-3)
    assert f"{found.scale:.3f} times" in found.complaints[0]


@pytest.mark.parametrize("row", range(4))
def test_a_marker_out_of_place_is_named(row):
    stated = GEOMETRY[6].copy()
    stated[row] += (2.5, -2.5, 1.0)
    (complaint,) = check_marker_geometry(MARKERS, stated).complaints
    assert f"marker {letter(row)} is not where the geometry has it" in complaint


def test_one_wrong_distance_is_named_with_both_lengths():
    markers = marker_sweep(np.random.default_rng(0), 5, n=60)[0]
    stated = GEOMETRY[5] + [[0, 0, 0], [0, 0, 0], [0, 0, 4.0]]
    (complaint,) = check_marker_geometry(markers, stated).complaints
    assert "B and C are 70.0 mm apart, 74.0 mm in the geometry" in complaint
    assert "marker C" in complaint


def test_hidden_markers_do_not_count():
    hidden = np.array(MARKERS)
    seen = np.ones((60, 4), dtype=bool)
    hidden[10:, 2], seen[10:, 2] = np.nan, False
    hidden[:, 3], seen[:, 3] = np.nan, False
    found = check_marker_geometry(hidden, GEOMETRY[6], seen)
    assert [d.markers for d in found.distances] == [(0, 1), (0, 2), (1, 2)]
    assert found.complaints == ()
    nothing = check_marker_geometry(hidden, GEOMETRY[6], np.zeros((60, 4), dtype=bool))
    assert (nothing.distances, nothing.complaints) == ((), ())


def test_arrays_that_do_not_belong_together_are_refused():
    with pytest.raises(InvalidInputError, match=r"\(n, 3, 3\)"):
        check_marker_geometry(MARKERS, GEOMETRY[5])
    with pytest.raises(InvalidInputError, match="seen"):
        check_marker_geometry(MARKERS, GEOMETRY[6], np.ones((60, 3), dtype=bool))
    with pytest.raises(InvalidInputError, match="finite"):
        check_marker_geometry(np.full((5, 4, 3), np.nan), GEOMETRY[6])
