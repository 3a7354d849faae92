from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import FIRST_PLACE, DeviceSettings, TrackerSettings
from rona_core.evaluation.navigation_metrics import (
    burr_figures,
    pointer_figures,
    registration_tre_mm,
    surface_figures,
    tool_figures,
    true_markers,
    true_tips_base,
)
from rona_core.evaluation.truth import LANDMARKS, Truth, rms
from rona_core.geometry.pose import Pose, Poses
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.operator.operator import VirtualOperator
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.tracker import VirtualTracker
from rona_core.virtual.world.world import NOMINAL
from tests.helpers.sphere_world import ScriptedWorld, ShiftError, SphereSpecimen

seeds = st.integers(0, 2**32 - 1)


def truth_of(seed=0, pointer="pointer6d", profile="polaris", offset=(0.0, 0.0, 0.0), **specimen):
    settings_ = DeviceSettings(pointer=pointer, tracker=TrackerSettings(profile=profile))
    mounting = Pose.from_rotvec((0.3, -1.0, 0.5), (10.0, 20.0, -150.0))
    scene = VirtualScene(
        seed,
        SphereSpecimen(**specimen),
        settings_,
        robot_error=ShiftError(offset),
        T_tip_toolmarker=mounting,
    )
    return Truth(scene)


def record(truth, ordinal, duration_s=2.0):
    """Capture of a drawn path: the track of the pointer, and its true tips."""
    scene = truth.scene
    operator = VirtualOperator(scene)
    operator.begin(scene, scene.settings, ordinal)
    operator.draw(spacing_mm=6.0, duration_s=duration_s)
    motion = operator.motion()
    T_tracker_base = scene.T_base_tracker.inv()

    def true_pose(tool, time_s):
        if tool != motion.pointer:
            return None
        return T_tracker_base @ motion.Ts_base_pointermarker(np.array([time_s]))[0]

    tracker = VirtualTracker(CaptureClock(), ScriptedWorld(true_pose), scene.seed)
    tracker.begin(scene.settings.tracker, ordinal)
    frames = [tracker.frame(k) for k in range(int(duration_s * 60))]
    track = ToolTrack.from_frames(motion.pointer, frames)
    capture = SimpleNamespace(ordinal=ordinal, marker=track, tracker_place=FIRST_PLACE)
    return capture, motion.tip_base(track.times_s)


def cloud_of(points, times):
    return SimpleNamespace(points_base=points, times_s=times)


@settings(max_examples=15)
@given(seeds)
def test_the_tip_errors_are_the_distances_they_were_given(seed):
    rng = np.random.default_rng(seed)
    truth = truth_of(seed)
    off, tool_off = rng.normal(size=3), rng.normal(size=3)
    calibration = SimpleNamespace(
        pointer="pointer6d", dof=6, tip_pointermarker=truth.scene.tips["pointer6d"] + off
    )
    figures = pointer_figures(calibration, truth)
    assert figures["pointer_tip_error_mm"] == pytest.approx(np.linalg.norm(off))
    T_toolmarker_tip = truth.scene.T_tip_toolmarker.inv()
    registration = SimpleNamespace(
        T_toolmarker_tip=Pose(T_toolmarker_tip.rotation, T_toolmarker_tip.translation + tool_off),
        T_base_tracker=truth.scene.T_base_tracker,
    )
    figures = tool_figures(registration, truth)
    assert figures["tool_tip_error_mm"] == pytest.approx(np.linalg.norm(tool_off))
    assert figures["tracker_registration_tre_mm"] == pytest.approx(0.0, abs=1e-9)
    held = replace(NOMINAL, seed=seed, spindle_mm=0.4)
    truth.scene.world = held
    burr = SimpleNamespace(offset_tip=held.spindle_off_tip + off)
    assert burr_figures(burr, truth)["burr_tip_error_mm"] == pytest.approx(np.linalg.norm(off))


def test_of_a_5d_pointer_only_the_error_along_its_line_counts():
    truth = truth_of(pointer="pointer5d")
    tip = truth.scene.tips["pointer5d"] + (3.0, 4.0, -0.25)
    calibration = SimpleNamespace(pointer="pointer5d", dof=5, tip_pointermarker=tip)
    assert pointer_figures(calibration, truth)["pointer_tip_error_mm"] == pytest.approx(0.25)


def test_a_shifted_registration_is_off_by_its_shift_and_a_turned_one_by_its_lever():
    truth = truth_of()
    true = truth.scene.T_base_tracker
    points = np.array([(0.0, 0, 0), (300.0, 0, 0), (0, 400.0, 0)])
    shifted = Pose.from_translation((0.3, 0.0, 0.4)) @ true
    assert registration_tre_mm(shifted, true, points) == pytest.approx(0.5)
    angle = 1e-3
    turned = Pose.from_rotvec((0, 0, angle)) @ true
    expected = 2 * np.sin(angle / 2) * np.sqrt((300**2 + 400**2) / 3)
    assert registration_tre_mm(turned, true, points) == pytest.approx(expected, rel=1e-9)


def test_the_five_landmarks_lie_on_the_bone_around_the_region():
    truth = truth_of(7)
    landmarks = truth.landmarks_base()
    assert list(landmarks) == list(LANDMARKS)
    points = np.array(list(landmarks.values()))
    np.testing.assert_allclose(truth.signed_distance_mm(points), 0.0, atol=1e-9)
    np.testing.assert_allclose(points[0], truth.scene.region_base()[0], atol=1e-9)
    assert (np.linalg.norm(points[1:] - points[0], axis=1) > 10.0).all()


@settings(max_examples=10)
@given(seeds, st.floats(-2.0, 2.0))
def test_a_cloud_that_floats_above_the_bone_is_off_by_that_much(seed, height_mm):
    truth = truth_of(seed)
    rng = np.random.default_rng(seed)
    n = rng.normal(size=(50, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    specimen = truth.scene.specimen
    points = truth.scene.T_base_skull @ (specimen.center + (specimen.radius_mm + height_mm) * n)
    figures = surface_figures(cloud_of(points, np.arange(50.0)), [], truth)
    assert figures["surface_points"] == 50
    assert figures["surface_rms_mm"] == pytest.approx(abs(height_mm), abs=1e-9)
    assert figures["surface_tip_3d_rms_mm"] is None


def test_a_cap_shifted_along_z_has_the_closed_form_rms():
    truth = truth_of(3)
    specimen, T_base_skull = truth.scene.specimen, truth.scene.T_base_skull
    rng = np.random.default_rng(0)
    n = rng.normal(size=(400, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    radius, shift = specimen.radius_mm, 0.3
    points = T_base_skull @ (specimen.center + radius * n)
    moved = points + np.array((0.0, 0.0, shift))
    cosine = T_base_skull.rotate(n)[:, 2]
    exact = np.sqrt(radius**2 + 2 * radius * shift * cosine + shift**2) - radius
    figures = surface_figures(cloud_of(moved, np.arange(400.0)), [], truth)
    assert figures["surface_rms_mm"] == pytest.approx(np.sqrt((exact**2).mean()), abs=1e-9)


@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
@pytest.mark.parametrize("profile", ["ideal", "polaris", "white035"])
def test_the_true_tip_is_recovered_from_what_was_measured(pointer, profile):
    truth = truth_of(4, pointer, profile)
    capture, tips = record(truth, ordinal=6)
    rows = np.arange(0, len(tips), 7)
    found = true_tips_base(truth.scene, capture.marker, 6, rows)
    np.testing.assert_allclose(found, tips[rows], atol=1e-6)


def test_a_wrong_frame_number_does_not_recover_the_truth():
    truth = truth_of(4)
    capture, tips = record(truth, ordinal=6)
    wrong = true_tips_base(truth.scene, capture.marker, 7, np.array([3]))
    assert np.linalg.norm(wrong - tips[3]) > 0.01


def test_a_marker_at_the_edge_of_view_is_left_as_measured():
    pose = Pose(np.eye(3), np.array((0.0, 0.0, 1900.0)))  # faces away
    track = ToolTrack(
        "pointer6d", np.zeros(1, int), np.zeros(1), Poses.stack([pose]), np.array([0.1]), 1
    )
    found = true_markers(track, np.array([0]), TrackerSettings(), 0, 0)
    np.testing.assert_array_equal(found[0].matrix(), pose.matrix())


def test_the_3d_error_pairs_points_with_captures_by_their_times():
    truth = truth_of(2)
    first, first_tips = record(truth, 3)
    second, second_tips = record(truth, 4, duration_s=1.5)
    off = np.array((0.1, -0.2, 0.2))  # 0.3 long
    keep = np.arange(len(first_tips)) % 3 != 1  # some points were dropped
    points = np.concatenate((first_tips[keep], second_tips)) + off
    times = np.concatenate((first.marker.times_s[keep], second.marker.times_s))
    figures = surface_figures(cloud_of(points, times), [first, second], truth)
    assert figures["surface_tip_3d_rms_mm"] == pytest.approx(0.3, abs=1e-6)


def test_what_the_tracker_adds_is_what_the_3d_error_shows():
    truth = truth_of(2)
    capture, tips = record(truth, 3)
    tip = truth.scene.tips["pointer6d"]
    measured = truth.scene.T_base_tracker @ (capture.marker.Ts_tracker_marker @ tip)
    figures = surface_figures(cloud_of(measured, capture.marker.times_s), [capture], truth)
    assert figures["surface_tip_3d_rms_mm"] == pytest.approx(rms(measured - tips), abs=1e-6)
    assert 0.05 < figures["surface_tip_3d_rms_mm"] < 1.0


def test_an_empty_cloud_has_no_errors():
    figures = surface_figures(cloud_of(np.zeros((0, 3)), np.zeros(0)), [], truth_of())
    assert figures == {
        "surface_points": 0,
        "surface_rms_mm": None,
        "surface_tip_3d_rms_mm": None,
    }


def test_the_root_mean_square_of_vectors_counts_their_lengths():
    assert rms(np.array([(3.0, 4.0, 0.0), (0.0, 0.0, 5.0)])) == pytest.approx(5.0)
    assert rms(np.array([1.0, -7.0])) == pytest.approx(5.0)
    assert rms(np.zeros(0)) is None
