"""A step within the bone is no inner boundary, however many A-scans agree on it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.ultrasound.detection.detect import UNSURE, detect, nominal_bone
from rona_core.ultrasound.detection.spatial.detectability import (
    MIN_ECHO_LEVEL,
    detectability,
    possible_steps,
)
from rona_core.ultrasound.detection.spatial.neighbours import scan_links
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.scenes.bone_scenes import hard_bone

BONE, PROBE = nominal_bone(), probe_model("2.25MHz")
SIDE = 5
PLACES = np.stack(np.meshgrid(*[np.arange(float(SIDE))] * 2, [0.0]), axis=-1).reshape(-1, 3)
LINKS = scan_links(PLACES, SIDE**2)
MIDDLE = SIDE**2 // 2
ALL = np.arange(SIDE**2)
UNHEARD_SEED = 18_000_003  # a world in which all A-scans take the step for the inner boundary


def believed(levels, depth_mm, rows=ALL, probe=PROBE):
    lag = 2.0 * np.broadcast_to(depth_mm, len(rows)) / BONE.speed_mm_per_us
    return detectability(np.log(levels), lag, rows, LINKS, probe, BONE)


def test_what_reflects_as_an_inner_boundary_does_is_believed_and_what_a_step_does_is_not():
    np.testing.assert_array_equal(believed(np.full(SIDE**2, 0.7), 2.0), 1.0)
    np.testing.assert_array_equal(believed(np.full(SIDE**2, 0.25), 2.0), 0.0)


@settings(max_examples=25, deadline=None)
@given(level=st.floats(0.1, 1.5), more=st.floats(1.0, 3.0), deeper=st.floats(0.0, 6.0))
def test_louder_or_deeper_is_never_believed_less(level, more, deeper):
    here = believed(np.full(SIDE**2, level), 3.0)
    assert (believed(np.full(SIDE**2, level * more), 3.0) >= here - 1e-12).all()
    assert (believed(np.full(SIDE**2, level), 3.0 + deeper) >= here - 1e-12).all()


def test_where_bone_takes_less_away_less_may_be_missing():
    levels = np.full(SIDE**2, 0.75 * MIN_ECHO_LEVEL)
    low = believed(levels, 4.5, probe=probe_model("1MHz"))
    assert (low < believed(levels, 4.5)).all()


def test_what_is_deeper_than_any_outer_table_is_no_step():
    levels = np.full(SIDE**2, 0.1)
    np.testing.assert_array_equal(believed(levels, 0.5 * PROBE.max_thickness_mm), 1.0)
    np.testing.assert_array_equal(believed(levels, 0.35 * PROBE.max_thickness_mm), 0.0)


def test_those_around_speak_for_one_of_the_same_depth_only():
    levels = np.full(SIDE**2, 0.8)
    levels[MIDDLE] = 0.25
    assert believed(levels, 3.0)[MIDDLE] == 1.0
    depth = np.full(SIDE**2, 8.0)
    depth[MIDDLE] = 3.0
    assert believed(levels, depth)[MIDDLE] == 0.0


def test_those_that_are_not_asked_say_nothing():
    rows = np.array([3, MIDDLE, 20])
    assert believed(np.full(3, 0.25), 3.0, rows).max() == 0.0
    assert believed(np.array([0.8, 0.25, 0.8]), 3.0, rows)[1] > 0.0


@pytest.mark.parametrize("thickness_mm", [3.0, 8.0])
def test_a_step_is_not_kept_where_the_inner_echo_drowns_and_thin_hard_bone_is(thickness_mm):
    scene = hard_bone(thickness_mm, side=10, nominal=False, drawn_seed=UNHEARD_SEED)
    found = detect(ProbeSurvey(scene.track, scene.probe, "pulse", positions_mm=scene.points_skull))
    error = found.thickness_mm - scene.bone_us * found.sound_speed_mm_per_us / 2.0
    if thickness_mm > 5.0:
        assert np.median(error) < -4.0  # it is not heard at all,
        assert not found.inner_ok.any()  # and 71 were kept when only neighbours were asked
        assert (found.flag == UNSURE).mean() > 0.9
    else:
        assert found.inner_ok.mean() > 0.9
        assert np.abs(error[found.inner_ok]).max() < 1.0


@pytest.mark.parametrize(("deep", "shallow"), [(288, 36), (288, 300), (100, 390)])
def test_shallow_boundaries_may_be_steps_where_most_inner_echoes_have_drowned(deep, shallow):
    """A-scans at 6.3 mm and at 2.1, of 1954: bone that is thin there, or its step."""
    thickness = np.full(1954, 2.1)
    thickness[:deep] = 6.3
    sure = np.arange(1954) < deep + shallow
    found = possible_steps(thickness, sure, PROBE)
    np.testing.assert_array_equal(np.flatnonzero(found), np.arange(deep, deep + shallow))


@pytest.mark.parametrize(
    ("deep", "shallow", "shallow_mm"),
    [
        (1100, 36, 2.1),  # most are heard
        (100, 500, 2.1),  # nearly all are thin
        (288, 36, 3.4),  # bone that becomes thinner
        (0, 36, 2.1),  # nothing is known to be deeper
    ],
)
def test_thin_bone_is_believed(deep, shallow, shallow_mm):
    thickness = np.full(1954, shallow_mm)
    thickness[:deep] = 6.3
    sure = np.arange(1954) < deep + shallow
    assert not possible_steps(thickness, sure, PROBE).any()
