"""Measured markers against a tool file: a mismatch is named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.devices.marker_check import check_markers
from rona_core.devices.markers import GEOMETRIES
from rona_core.errors import InvalidInputError

seeds = st.integers(0, 2**32 - 1)
BODY = GEOMETRIES["toolmarker"].positions_marker


@settings(max_examples=30)
@given(seeds, st.sampled_from(sorted(GEOMETRIES)))
def test_the_right_tool_fits_wherever_it_is(seed, tool):
    rng = np.random.default_rng(seed)
    model = GEOMETRIES[tool].positions_marker
    moved = model @ Rotation.random(rng=rng).as_matrix().T + rng.uniform(-2000, 2000, 3)
    check = check_markers(model, moved + rng.normal(0, 0.1, model.shape))
    assert check.fits
    assert check.reason == ""
    exact = check_markers(model, moved)
    np.testing.assert_allclose(exact.measured_mm, exact.expected_mm, atol=1e-9)
    pairs = [np.linalg.norm(model[i] - model[j]) for i, j in exact.pairs]
    np.testing.assert_allclose(exact.expected_mm, pairs)


def test_a_bent_marker_is_named_with_its_distance():
    bent = BODY.copy()
    bent[2] += (6.0, 5.0, 0.0)
    check = check_markers(BODY, bent)
    assert not check.fits
    assert "only marker C is out of place" in check.reason
    assert "mm apart, the tool file says" in check.reason


@pytest.mark.parametrize("order", [(1, 0, 2, 3), (3, 2, 1, 0), (2, 3, 1, 0)])
def test_another_order_is_found_and_can_be_undone(order):
    shuffled = BODY[list(order)]
    check = check_markers(BODY, shuffled)
    assert not check.fits
    named = check.reason.split("in the order ")[1].split()
    back = shuffled[["ABCD".index(letter) for letter in named]]
    assert check_markers(BODY, back).fits


@pytest.mark.parametrize(("scale", "unit"), [(1000.0, "metres"), (25.4, "inches")])
def test_another_unit_is_named(scale, unit):
    assert unit in check_markers(BODY, BODY / scale).reason


def test_another_tool_is_another_tool():
    check = check_markers(BODY, GEOMETRIES["pointer6d"].positions_marker)
    assert not check.fits
    assert "another tool" in check.reason
    worst = np.argmax(np.abs(check.measured_mm - check.expected_mm))
    i, j = check.pairs[worst]
    assert f"markers {'ABCD'[i]} and {'ABCD'[j]}" in check.reason


def test_numbers_that_differ_are_refused():
    with pytest.raises(InvalidInputError, match="4 markers, 3 were measured"):
        check_markers(BODY, BODY[:3])
