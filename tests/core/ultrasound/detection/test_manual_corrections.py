"""Boundaries set by hand: what counts, what goes with them, and nothing else changes."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.ultrasound.detection.detect import NO_FRONT, NO_INNER, OK, REMOVED, UNSURE, Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdit, BoundaryEdits, corrected
from rona_core.ultrasound.probe.probe_model import probe_model

N = 12
PROBE = probe_model("2.25MHz")


@pytest.fixture(scope="module")
def found() -> Detection:
    rng = np.random.default_rng(5)
    outer = PROBE.line_delay_us + rng.uniform(-0.3, 0.6, N)
    lag = rng.uniform(2.0, 7.0, N)
    flag = np.array([OK, UNSURE, NO_FRONT] * (N // 3))
    return Detection(
        outer_us=outer, inner_us=outer + lag, outer_ok=flag != NO_FRONT, inner_ok=flag == OK,
        outer_quality=np.ones(N), inner_quality=rng.uniform(0.3, 0.95, N), flag=flag,
        standoff_mm=rng.uniform(-0.2, 0.2, N), thickness_mm=lag * 2.65 / 2,
        outer_sigma_mm=np.full(N, 0.01), thickness_sigma_mm=np.full(N, 0.1),
        inner_sigma_us=np.full(N, 0.08), alternative_us=outer, alternative_quality=np.zeros(N),
        probe="2.25MHz", excitation="chirp", method="subtract", sound_speed_mm_per_us=2.65,
    )  # fmt: skip


def edits(*changes: BoundaryEdit) -> BoundaryEdits:
    made = BoundaryEdits()
    for change in changes:
        made = made.put(change)
    return made


def test_without_edits_of_this_pass_a_detection_is_itself(found):
    other = edits(BoundaryEdit("second", 3, "inner", 20.0))
    assert corrected(found, BoundaryEdits(), "first", PROBE) is found
    assert corrected(found, other, "first", PROBE) is found
    assert corrected(found, edits(BoundaryEdit("first", N, "inner", 20.0)), "first", PROBE) is found


@settings(max_examples=25)
@given(number=st.integers(0, N // 3 - 1), lag=st.floats(1.0, 8.0))
def test_an_inner_boundary_by_hand_counts_and_leaves_the_others_alone(found, number, lag):
    i = 3 * number + 1  # unsure before
    at_us = float(found.outer_us[i] + lag)
    after = corrected(found, edits(BoundaryEdit("first", i, "inner", at_us)), "first", PROBE)
    assert after.inner_us[i] == at_us
    assert (after.flag[i], after.inner_ok[i], after.inner_quality[i]) == (OK, True, 1.0)
    assert after.thickness_mm[i] == pytest.approx(lag * 2.65 / 2)
    assert after.inner_sigma_us[i] == pytest.approx(0.25 / PROBE.centre_mhz)
    rest = np.arange(N) != i
    for field in fields(Detection):
        value = getattr(after, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable or value is getattr(found, field.name)
            np.testing.assert_array_equal(value[rest], getattr(found, field.name)[rest])


@settings(max_examples=25)
@given(shift=st.floats(0.01, 0.5))
def test_an_outer_boundary_that_comes_later_lies_deeper_and_leaves_less_bone(found, shift):
    base = PROBE.line_delay_us - 0.6  # pressed: there the line alone is in the way
    first, later = (
        corrected(found, edits(BoundaryEdit("first", 0, "outer", t)), "first", PROBE)
        for t in (base, base + shift)
    )
    deeper = later.standoff_mm[0] - first.standoff_mm[0]
    assert deeper == pytest.approx(shift * PROBE.line.speed_mm_per_us / 2)
    thinner = first.thickness_mm[0] - later.thickness_mm[0]
    assert thinner == pytest.approx(shift * 2.65 / 2)
    assert later.inner_us[0] == found.inner_us[0]


def test_what_is_taken_away_does_not_count_and_takes_the_inner_one_along(found):
    inner = corrected(found, edits(BoundaryEdit("first", 0, "inner", None)), "first", PROBE)
    assert (inner.flag[0], inner.inner_ok[0], inner.outer_ok[0]) == (REMOVED, False, True)
    outer = corrected(found, edits(BoundaryEdit("first", 0, "outer", None)), "first", PROBE)
    assert (outer.flag[0], outer.inner_ok[0], outer.outer_ok[0]) == (REMOVED, False, False)
    both = edits(BoundaryEdit("first", 0, "outer", None), BoundaryEdit("first", 0, "inner", 25.0))
    assert not corrected(found, both, "first", PROBE).inner_ok[0]


def test_a_front_by_hand_makes_an_inner_boundary_possible(found):
    i = 2
    assert found.flag[i] == NO_FRONT
    front = BoundaryEdit("first", i, "outer", PROBE.line_delay_us)
    half = corrected(found, edits(front), "first", PROBE)
    assert (half.outer_ok[i], half.inner_ok[i], half.flag[i]) == (True, False, NO_INNER)
    whole = edits(front, BoundaryEdit("first", i, "inner", PROBE.line_delay_us + 4.0))
    after = corrected(found, whole, "first", PROBE)
    assert (after.outer_ok[i], after.inner_ok[i], after.flag[i]) == (True, True, OK)
    assert after.thickness_mm[i] == pytest.approx(5.3)


def test_there_is_one_edit_for_each_boundary_and_the_order_does_not_matter():
    a, b = BoundaryEdit("first", 4, "inner", 20.0), BoundaryEdit("first", 2, "outer", 16.0)
    assert edits(a, b) == edits(b, a)
    assert len(edits(a, replace(a, time_us=21.0))) == 1
    assert edits(a, b).marks("first", N).nonzero()[0].tolist() == [2, 4]
    assert edits(a, b).of("first", "outer") == edits(b)
    assert edits(a, b).without("first", 4) == edits(b)
    assert len(edits(a, b).without("first")) == 0
    assert edits(a, b).without("second") == edits(a, b)
