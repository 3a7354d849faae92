"""Head motion by its marker: exact without noise, no false alarm, honest, refused where hidden."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.reference_markers import (
    FALSE_ALARM,
    HeadReference,
    head_motion,
    head_reference,
)
from rona_core.devices.samples import ToolTrack
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Pose, Poses

T_BASE_TRACKER = Pose.from_rotvec((0.4, -1.1, 0.7), (1500.0, 300.0, 900.0))
REST = Pose.from_rotvec((2.0, 0.3, -0.5), (40.0, -30.0, 1800.0))  # of the marker, in the tracker
POINT = T_BASE_TRACKER @ (REST @ np.array((60.0, -80.0, 30.0)))  # of the head
NOISE = np.array((2e-4, 2e-4, 1e-4, 0.01, 0.01, 0.03))  # rad and mm, of a frame


def track(turns, shifts, times_s, noise=None):
    """The marker on a head that turns (n, 3) about it and shifts (n, 3), in ``base``."""
    center = T_BASE_TRACKER @ REST.translation
    rotations = Rotation.from_rotvec(turns).as_matrix()
    moved = Poses(rotations, center + shifts - rotations @ center)
    seen = T_BASE_TRACKER.inv() @ (moved @ (T_BASE_TRACKER @ REST))
    if noise is not None:
        off = noise.normal(0.0, NOISE, (len(seen), 6))
        turned = Rotation.from_rotvec(off[:, :3]).as_matrix() @ seen.rotations
        seen = Poses(turned, seen.translations + off[:, 3:])
    n = len(times_s)
    return ToolTrack("headmarker", np.arange(n), times_s, seen, np.zeros(n), n)


def still(n, step_s, noise=None):
    return track(np.zeros((n, 3)), np.zeros((n, 3)), step_s * np.arange(n), noise)


def motion_of(reference, seen):
    return head_motion(reference, seen, T_BASE_TRACKER, (seen.times_s[0], seen.times_s[-1]))


def test_a_steady_motion_is_found_and_taken_back_exactly():
    times = np.arange(0.0, 30.0, 0.5)
    turns = np.outer(times, (1e-4, -2e-4, 5e-5))
    shifts = np.outer(times, (0.01, 0.0, -0.02)) + (0.2, 0.1, 0.0)
    found = motion_of(head_reference(still(100, 1 / 60)), track(turns, shifts, times))
    assert found.moved
    inner = slice(4, -4)  # at the ends the window is one-sided
    np.testing.assert_allclose(found.shifts_mm[inner], shifts[inner], atol=1e-9)
    np.testing.assert_allclose(found.turns_rad[inner], turns[inner], atol=1e-9)
    # a point of the head is carried along, and led back
    center = T_BASE_TRACKER @ REST.translation
    rotations = Rotation.from_rotvec(turns).as_matrix()
    carried = Poses(rotations, center + shifts - rotations @ center) @ POINT
    back = found.back(times) @ carried
    np.testing.assert_allclose(back[inner], np.tile(POINT, (len(times), 1))[inner], atol=1e-5)
    mean = (carried - POINT).mean(axis=0)
    np.testing.assert_allclose(found.shift_at(POINT), mean, atol=2e-3)


def test_the_same_whatever_frame_the_tracker_has():
    """Law: another tracker pose with all that it sees moved along changes nothing in ``base``."""
    times = np.arange(0.0, 20.0, 0.5)
    shifts = np.outer(np.sin(times), (0.1, -0.2, 0.3))
    plain = motion_of(head_reference(still(60, 0.1)), track(np.zeros((40, 3)), shifts, times))
    other = Pose.from_rotvec((0.1, 0.2, -0.3), (100.0, 0.0, -50.0))

    def seen(held):
        return ToolTrack(
            held.tool,
            held.frame_numbers,
            held.times_s,
            other.inv() @ held.Ts_tracker_marker,
            held.rms_error_mm,
            held.n_frames,
        )

    moved = head_motion(
        head_reference(seen(still(60, 0.1))),
        seen(track(np.zeros((40, 3)), shifts, times)),
        T_BASE_TRACKER @ other,
        (times[0], times[-1]),
    )
    np.testing.assert_allclose(moved.shifts_mm, plain.shifts_mm, atol=1e-9)
    np.testing.assert_allclose(moved.shift_at(POINT), plain.shift_at(POINT), atol=1e-9)


def test_a_registration_that_is_off_hardly_counts():
    times = np.arange(0.0, 20.0, 0.5)
    shifts = np.tile((0.3, 0.0, 0.0), (40, 1))
    seen = track(np.zeros((40, 3)), shifts, times)
    off = T_BASE_TRACKER @ Pose.from_rotvec((0.01, 0.0, 0.0), (2.0, -1.0, 1.0))
    found = head_motion(head_reference(still(60, 0.1)), seen, off, (times[0], times[-1]))
    assert np.linalg.norm(found.shift_at(POINT) - shifts[0]) < 0.005


def test_noise_alone_is_no_motion_and_the_predicted_error_is_about_the_true_one():
    noise = np.random.default_rng(3)
    squares, alarms = [], 0
    for _ in range(200):
        reference = head_reference(still(600, 1 / 60, noise))
        found = motion_of(reference, still(50, 0.5, noise))
        alarms += found.moved
        squares.append((found.shift_at(POINT) / found.sigma_at(POINT)) ** 2)
    assert alarms <= 2  # 1 in 1000 expected
    assert FALSE_ALARM == 1e-3
    assert 0.8 < np.mean(squares) < 1.25


def test_a_twentieth_of_a_millimetre_is_seen():
    noise = np.random.default_rng(4)
    reference = head_reference(still(600, 1 / 60, noise))
    shifts = np.tile((0.03, 0.03, 0.03), (50, 1))
    seen = track(np.zeros((50, 3)), shifts, 0.5 * np.arange(50), noise)
    assert motion_of(reference, seen).moved


def test_a_tracker_without_noise_that_sees_no_motion_is_believed():
    assert not motion_of(head_reference(still(100, 1 / 60)), still(40, 0.5)).moved


def test_a_hidden_marker_is_refused_by_name():
    reference = head_reference(still(100, 1 / 60))
    with pytest.raises(DegenerateGeometryError, match="seen in 9 of 9 frames, 10 are the least"):
        motion_of(reference, still(9, 0.5))
    with pytest.raises(DegenerateGeometryError, match="seen in 4 of 4 frames"):
        head_reference(still(4, 0.5))
    with pytest.raises(DegenerateGeometryError, match="hidden for 12 s, 5 are allowed"):
        head_motion(reference, still(20, 0.5), T_BASE_TRACKER, (0.0, 21.5))
    assert isinstance(reference, HeadReference)
