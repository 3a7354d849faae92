"""What repeats: sensitivities against displaced markers, and lengths that are learned."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.calibration.hand_eye.hand_eye import TOOL_MARKERS
from rona_core.calibration.hand_eye.robot_accuracy import registration_sensitivity
from rona_core.calibration.hand_eye.tool_registration import register_tool
from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.pivot.maximum_likelihood import (
    PivotMotion,
    field_of_pivot,
    tip_sensitivity,
)
from rona_core.calibration.tracking_error import (
    EVEN_WEIGHTS as EVEN,
)
from rona_core.calibration.tracking_error import (
    LENGTHS_MM,
    LearnedField,
    TrackerErrorField,
    fit_matrices,
)
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import deviation_between, rotation_vectors
from rona_core.geometry.rigid_fit import register_points
from tests.core.calibration.hand_eye.test_tool_registration import motion
from tests.helpers.strategies import pivot_poses

PLACE_TRACKER = np.array((40.0, -60.0, 1900.0))
TIPS = {6: np.array((4.0, -160.0, -20.0)), 5: np.array((0.0, 0.0, 290.0))}
POLARIS = TrackerErrorField(total_mm=0.35)


def refitted(Ts_tracker_marker, positions, bias):
    """Return the poses that a tracker fits where each marker is off by ``bias(places)``."""
    found = []
    for pose in Ts_tracker_marker:
        places = pose @ positions
        found.append(register_points(positions, places + bias(places)).T_b_a)
    return Poses.stack(found)


def linear(size, seed=3):
    """Return an error that changes evenly over the volume: (n, 3) places to errors."""
    slope = size * np.random.default_rng(seed).normal(size=(3, 3))
    return lambda places: (places - PLACE_TRACKER) @ slope.T


def pivot(dof, n=120):
    rng = np.random.default_rng(8)
    poses, _ = pivot_poses(rng, TIPS[dof], n=n, half_angle_deg=28.0)
    shift = PLACE_TRACKER - poses.translations.mean(axis=0)
    poses = Poses(poses.rotations, poses.translations + shift)
    positions = GEOMETRIES[f"pointer{dof}d"].positions_marker
    return PivotMotion(poses, positions, dof, TIPS[dof], (poses @ TIPS[dof]).mean(axis=0))


def test_a_fit_follows_its_markers():
    rng = np.random.default_rng(1)
    positions = GEOMETRIES["pointer6d"].positions_marker
    pose = Pose.from_rotvec(rng.normal(size=3), PLACE_TRACKER)
    off = 1e-4 * rng.normal(size=positions.shape)
    (found,) = refitted(Poses.stack([pose]), positions, lambda places: off)
    center = positions.mean(axis=0)
    moved = np.concatenate(
        (
            rotation_vectors((found.rotation @ pose.rotation.T)[None])[0],
            (found @ center) - (pose @ center),
        )
    )
    predicted = np.einsum("mij,mj->i", fit_matrices(pose.rotation[None], positions)[0], off)
    np.testing.assert_allclose(predicted, moved, rtol=1e-3, atol=1e-9)


def test_markers_on_a_line_do_not_turn_about_it():
    positions = GEOMETRIES["pointer5d"].positions_marker
    fits = fit_matrices(np.eye(3)[None], positions)[0]
    assert np.abs(fits[:, 2]).max() < 1e-12
    across = np.einsum("mij,mj->i", fits, np.outer(positions[:, 2], (1e-4, 0.0, 0.0)))
    np.testing.assert_allclose(across[:3], (0.0, 1e-4, 0.0), atol=1e-12)


def test_the_tip_moves_with_its_markers_as_told():
    motion6 = pivot(6)
    found = tip_sensitivity(motion6)
    bias = linear(1e-4)
    seen = refitted(motion6.Ts_tracker_marker, motion6.positions_marker, bias)
    made = calibrate_pointer(
        seen, pointer="p", dof=6, positions_pointermarker=motion6.positions_marker
    )
    predicted = np.einsum("ipl,pl->i", found.tip, bias(found.points_tracker))
    moved = made.tip_pointermarker - TIPS[6]
    assert np.linalg.norm(moved) > 0.005
    # a few poses stand for all: about as far, and about there
    assert np.linalg.norm(predicted - moved) < 0.2 * np.linalg.norm(moved)


@pytest.mark.parametrize("dof", [6, 5])
def test_a_change_of_scale_scales_the_tip_and_leaves_no_residual(dof):
    """Markers and tip cannot both be right: the swing is 0.1 % too wide, and so is the lever."""
    swing = pivot(dof)
    found = tip_sensitivity(swing)
    bias = 1e-3 * (found.points_tracker - swing.pivot_tracker)
    moved = np.einsum("ipl,pl->i", found.tip, bias)
    center = swing.positions_marker.mean(axis=0)
    np.testing.assert_allclose(moved, 1e-3 * (swing.tip_marker - center), atol=2e-3)


def test_a_registration_moves_with_markers_and_robot_as_told():
    rng = np.random.default_rng(4)
    robot, marker, phases, T_base_tracker, _ = motion(rng)
    at = T_base_tracker @ marker.translations.mean(axis=0) - T_base_tracker @ PLACE_TRACKER
    # the tracker is put where its markers are in its volume
    marker = Poses(marker.rotations, marker.translations + T_base_tracker.rotation.T @ -at)
    exact = register_tool(robot, marker, phases)
    moved_by = registration_sensitivity(exact, robot, marker)
    bias = linear(2e-5)
    turns = 1e-5 * rng.normal(size=(len(robot), 3))
    shifts = 2e-3 * rng.normal(size=(len(robot), 3))
    seen = refitted(marker, TOOL_MARKERS, bias)
    # the robot says where it is not: the truth is turned and shifted against it
    told = Poses(
        np.stack([Pose.from_rotvec(-t).rotation for t in turns]) @ robot.rotations,
        robot.translations - shifts,
    )
    made = register_tool(told, seen, phases)
    predicted = np.einsum("kpl,pl->k", moved_by.markers, bias(moved_by.points_tracker))
    errors = np.concatenate((turns, shifts), axis=1)
    predicted += np.einsum("knj,nj->k", moved_by.robot, errors)
    found = np.concatenate(
        (
            deviation_between(exact.T_base_tracker, made.T_base_tracker),
            deviation_between(exact.T_toolmarker_tip, made.T_toolmarker_tip),
        )
    )
    off = np.linalg.norm(predicted[9:] - found[9:]) / np.linalg.norm(found[9:])
    assert off < 0.05
    np.testing.assert_allclose(predicted[:3], found[:3], atol=0.05 * np.abs(found[:3]).max())


def test_one_length_is_the_field_of_that_length():
    i = 3
    field = TrackerErrorField(total_mm=0.35, length_mm=float(LENGTHS_MM[i]))
    rng = np.random.default_rng(2)
    points = PLACE_TRACKER + rng.normal(0.0, 120.0, (7, 3))
    sensitivity = rng.normal(size=(4, 7, 3))
    one = LearnedField(POLARIS, np.eye(len(LENGTHS_MM))[i]).propagate(sensitivity, points)
    flat = sensitivity.reshape(4, 21)
    np.testing.assert_allclose(one, flat @ field.covariance(points) @ flat.T, rtol=1e-9)


def winding(n=120):
    """Return a pivot whose shaft goes round its cone evenly, as a hand does."""
    turn = np.linspace(0.0, 6.0 * np.pi, n)
    tilt = np.deg2rad(28.0) * np.linspace(0.3, 1.0, n)
    leans = tilt[:, None] * np.stack((np.cos(turn), np.zeros(n), np.sin(turn)), axis=1)
    rotations = np.stack([Pose.from_rotvec(lean).rotation for lean in leans])
    poses = Poses(rotations, PLACE_TRACKER - rotations @ TIPS[6])
    return PivotMotion(poses, GEOMETRIES["pointer6d"].positions_marker, 6, TIPS[6], PLACE_TRACKER)


@pytest.mark.parametrize("i", [3, 7])
def test_the_pivot_tells_over_what_length_the_field_changes(i):
    """Fields are drawn: the length they were drawn with is likely, and those far off are not."""
    likely, rng, swing = [], np.random.default_rng(12), winding()
    places = swing.Ts_tracker_marker.map_points(swing.positions_marker)
    truth = TrackerErrorField(total_mm=0.35, length_mm=float(LENGTHS_MM[i]))
    root = np.linalg.cholesky(truth.covariance(places.reshape(-1, 3)) + 1e-9 * np.eye(places.size))
    fits = fit_matrices(swing.Ts_tracker_marker.rotations, swing.positions_marker)
    center = swing.positions_marker.mean(axis=0)
    for _ in range(8):
        errors = (root @ rng.normal(size=places.size)).reshape(places.shape)
        errors += 0.003 * rng.normal(size=places.shape)  # of frames that were averaged
        moved = np.einsum("nmij,nmj->ni", fits, errors)
        turned = np.stack([Pose.from_rotvec(turn).rotation for turn in moved[:, :3]])
        turned = turned @ swing.Ts_tracker_marker.rotations
        centers = swing.Ts_tracker_marker @ center + moved[:, 3:]
        seen = replace(swing, Ts_tracker_marker=Poses(turned, centers - turned @ center))
        likely.append(field_of_pivot(seen, LearnedField(POLARIS)).weights)
    mean = np.mean(likely, axis=0)
    assert mean.sum() == pytest.approx(1.0)
    assert mean[i - 1 : i + 2].sum() > 0.5
    assert mean[: i - 2].sum() + mean[i + 5 :].sum() < 0.1


def test_without_a_field_there_is_nothing_to_learn():
    none = LearnedField(TrackerErrorField(total_mm=0.0))
    found = field_of_pivot(pivot(6), none)
    assert found.weights is EVEN
    moved_by = tip_sensitivity(pivot(6))
    assert np.abs(found.propagate(moved_by.tip, moved_by.points_tracker)).max() == 0.0
