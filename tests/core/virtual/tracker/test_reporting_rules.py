"""The order in which a tracker decides, rule by rule."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.devices.samples import WITH_POSE
from rona_core.devices.trackers import GEOMETRIES, MarkerGeometry
from rona_core.geometry.pose import Pose
from rona_core.virtual.tracker.reporting_rules import MAX_3D_ERROR_MM, report_tool

BODY, LINE = GEOMETRIES["toolmarker"], GEOMETRIES["pointer5d"]
POSE = Pose(Rotation.from_rotvec((2.9, 0.3, -0.2)).as_matrix(), np.array((40.0, -30.0, 1850.0)))


def flags(count, *off):
    result = np.ones(count, dtype=bool)
    result[list(off)] = False
    return result


def decided(geometry, *, facing=(), inside=(), clear=(), shift=None, swapped=None):
    count = len(geometry.positions_marker)
    measured = POSE @ geometry.positions_marker
    if shift is not None:
        measured = measured + np.asarray(shift, dtype=float)
    seen = report_tool(
        geometry,
        measured[None],
        facing=flags(count, *facing)[None],
        inside=flags(count, *inside)[None],
        clear=flags(count, *clear)[None],
        swapped=None if swapped is None else np.array([swapped]),
    )
    pose = seen.Ts_tracker_marker[0] if seen.seen[0] else None
    return SimpleNamespace(status=seen.statuses[0], pose=pose, rms_error_mm=seen.rms_error_mm[0])


def test_all_markers_give_the_pose():
    seen = decided(BODY)
    assert seen.status == "ok"
    np.testing.assert_allclose(seen.pose.matrix(), POSE.matrix(), atol=1e-9)


@pytest.mark.parametrize(
    ("off", "status"),
    [
        ({"facing": range(4), "inside": range(4), "clear": range(4)}, "out_of_view"),
        ({"facing": (0,), "inside": range(4), "clear": range(4)}, "out_of_volume"),
        ({"clear": range(4)}, "missing"),
        ({"facing": (0, 1), "clear": (2, 3)}, "missing"),
        ({"facing": (0, 1)}, "too_few_markers"),
        ({"inside": (0, 1)}, "too_few_markers"),
        ({"clear": (0, 1)}, "too_few_markers"),
        ({"facing": (0,), "inside": (1,), "clear": (2,)}, "too_few_markers"),
        ({"inside": (3,)}, "partially_out_of_volume"),
        ({"facing": (3,)}, "ok"),
        ({"clear": (3,)}, "ok"),
        ({"facing": (3,), "inside": (3,)}, "ok"),  # what is turned away is not asked for its place
    ],
)
def test_the_first_rule_that_is_broken_names_the_status(off, status):
    seen = decided(BODY, **off)
    assert seen.status == status
    assert (seen.pose is not None) == (status in WITH_POSE)
    if seen.pose is not None:
        np.testing.assert_allclose(seen.pose.matrix(), POSE.matrix(), atol=1e-9)


def test_a_marker_that_is_far_off_is_left_out():
    shift = np.zeros((4, 3))
    shift[2] = (0.0, 4.0 * MAX_3D_ERROR_MM, 0.0)
    seen = decided(BODY, shift=shift)
    assert seen.status == "ok"
    np.testing.assert_allclose(seen.pose.matrix(), POSE.matrix(), atol=1e-9)
    assert seen.rms_error_mm < 1e-9


def test_a_small_misfit_is_kept_in_the_average():
    shift = np.zeros((4, 3))
    shift[2] = (0.0, MAX_3D_ERROR_MM, 0.0)  # the fit shares it among the four
    seen = decided(BODY, shift=shift)
    assert seen.status == "ok"
    assert 0.3 < seen.rms_error_mm < MAX_3D_ERROR_MM


def test_with_the_least_number_of_markers_none_may_be_far_off():
    shift = np.zeros((4, 3))
    shift[2] = (30.0, 30.0, 0.0)
    assert decided(BODY, clear=(0,), shift=shift).status == "bad_fit"


def test_markers_too_close_together_or_in_a_line_do_not_count():
    def body(positions):
        return MarkerGeometry("t", 6, np.array(positions, float), np.zeros(3), np.zeros(3))

    assert decided(body([[0, 0, 0], [5, 0, 0], [0, 5, 0]])).status == "low_spread"
    assert decided(body([[0, 0, 0], [50, 0, 0], [100, 3, 0]])).status == "low_spread"
    assert decided(body([[0, 0, 0], [50, 0, 0], [100, 40, 0]])).status == "ok"
    near = MarkerGeometry("t", 5, np.array([[0, 0, 0], [0, 0, 6.0]]), np.zeros(3), np.zeros(3))
    assert decided(near).status == "low_spread"


@pytest.mark.parametrize("pair", [(0, 1), (1, 0), (2, 0), (1, 2)])
def test_two_markers_taken_for_each_other_turn_the_line_round_and_fit(pair):
    seen = decided(LINE, swapped=pair)
    assert seen.status == "ok"
    assert seen.rms_error_mm < 1e-9  # nothing in the fit tells that it is wrong
    pose = seen.pose
    z = np.array((0.0, 0.0, 1.0))
    np.testing.assert_allclose(pose.rotate(z), -POSE.rotate(z), atol=1e-9)
    np.testing.assert_allclose(
        (pose @ LINE.positions_marker)[list(pair)],
        (POSE @ LINE.positions_marker)[list(pair[::-1])],
        atol=1e-9,
    )


def test_a_swap_takes_the_two_markers_that_are_seen():
    seen = decided(LINE, clear=(1,), swapped=(0, 1))
    np.testing.assert_allclose(
        seen.pose @ LINE.positions_marker[[0, 2]],
        (POSE @ LINE.positions_marker)[[2, 0]],
        atol=1e-9,
    )
