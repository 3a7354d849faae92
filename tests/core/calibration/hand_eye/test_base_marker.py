"""A tracker that was moved: found again by the base marker, with an honest word about the cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.reference_markers import (
    MIN_FRAMES,
    SeenBase,
    detect_tracker_movement,
    mean_base,
    point_sigmas_mm,
    update_registration,
)
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.devices.settings import DeviceSettings, TrackerPlace, TrackerSettings
from rona_core.devices.trackers import FIELD_MM, GEOMETRIES
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import deviate
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.tracker import observe, white_numbers
from tests.helpers.sphere_world import ShiftError, SphereSpecimen

seeds = st.integers(0, 2**32 - 1)
NONE = np.zeros((6, 6))
PLACES = (TrackerPlace((60.0, -40.0, 20.0), 1.5), TrackerPlace((-60.0, 80.0, 40.0), -1.0))
HEAD = np.array(((600.0, 60.0, 400.0), (640.0, 20.0, 380.0)))


def scene_of(seed, profile="polaris"):
    devices = DeviceSettings(tracker=TrackerSettings(profile=profile))
    return VirtualScene(
        seed, SphereSpecimen(), devices, robot_error=ShiftError(), T_tip_toolmarker=Pose.identity()
    )


def seen_from(scene, place, ordinal, n=40):
    """The mean of the base marker as this scene's tracker sees it from a place."""
    truth = scene.tracker_at(place).inv() @ scene.T_base_basemarker
    geometry, tracker = GEOMETRIES["basemarker"], scene.settings.tracker
    white = white_numbers(scene.seed, "tracker", ordinal, np.arange(n))["basemarker"]
    seen = observe(geometry, truth.repeated(n), white, tracker, scene.seed)
    return mean_base(seen.Ts_tracker_marker)


def pose_of(rng, spread_mm=2000.0):
    return Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-spread_mm, spread_mm, 3))


@settings(max_examples=20)
@given(seeds)
def test_the_test_of_a_move_does_not_care_where_the_tracker_has_its_axes(seed):
    rng = np.random.default_rng(seed)
    pose, turn = pose_of(rng), Rotation.random(rng=rng).as_matrix()
    step = deviate(pose, np.concatenate((rng.normal(0, 1e-4, 3), rng.normal(0, 0.05, 3))))
    spread = np.diag(rng.uniform(1e-9, 1e-8, 6))
    both = np.kron(np.eye(2), turn)
    there = Pose(turn, np.zeros(3))
    plain = detect_tracker_movement(SeenBase(pose, spread, 20), SeenBase(step, spread, 20))
    turned = detect_tracker_movement(
        SeenBase(there @ pose, both @ spread @ both.T, 20),
        SeenBase(there @ step, both @ spread @ both.T, 20),
    )
    assert turned.chi2 == pytest.approx(plain.chi2, rel=1e-6)
    assert turned.shift_mm == pytest.approx(plain.shift_mm, rel=1e-6)


@settings(max_examples=20)
@given(seeds)
def test_without_noise_the_tracker_is_found_again_exactly(seed):
    rng = np.random.default_rng(seed)
    T_base_tracker, T_base_basemarker, T_base_tracker_new = (pose_of(rng) for _ in range(3))
    then = SeenBase(T_base_tracker.inv() @ T_base_basemarker, NONE, 20)
    now = SeenBase(T_base_tracker_new.inv() @ T_base_basemarker, NONE, 20)
    carried = update_registration(T_base_tracker, NONE, then, now, TrackerErrorField(0.0))
    np.testing.assert_allclose(
        carried.T_base_tracker.matrix(), T_base_tracker_new.matrix(), atol=1e-8
    )
    assert point_sigmas_mm(carried.T_base_tracker, carried.covariance, HEAD) == pytest.approx(
        0.0, abs=1e-9
    )


@settings(max_examples=20)
@given(seeds)
def test_the_registration_is_as_good_at_every_place_as_before_if_the_base_marker_is_exact(seed):
    rng = np.random.default_rng(seed)
    T_base_tracker, T_base_basemarker, T_base_tracker_new = (pose_of(rng) for _ in range(3))
    root = rng.normal(size=(6, 6)) * np.repeat((1e-4, 0.1), 3)[:, None]
    then = SeenBase(T_base_tracker.inv() @ T_base_basemarker, NONE, 20)
    now = SeenBase(T_base_tracker_new.inv() @ T_base_basemarker, NONE, 20)
    carried = update_registration(T_base_tracker, root @ root.T, then, now, TrackerErrorField(0.0))
    before = point_sigmas_mm(T_base_tracker, root @ root.T, HEAD)
    np.testing.assert_allclose(
        point_sigmas_mm(carried.T_base_tracker, carried.covariance, HEAD), before, rtol=1e-6
    )


@pytest.mark.slow
def test_the_predicted_cost_is_that_of_a_simulation():
    rng = np.random.default_rng(4)
    scene = scene_of(1)
    T_base_tracker = scene.tracker_at(TrackerPlace())
    marker = scene.T_base_basemarker
    then, now = (scene.tracker_at(place).inv() @ marker for place in (TrackerPlace(), PLACES[0]))
    roots = [rng.normal(size=(6, 6)) * np.repeat((2e-5, 0.02), 3)[:, None] for _ in range(2)]
    first, second = (
        SeenBase(pose, root @ root.T, 20) for pose, root in zip((then, now), roots, strict=True)
    )
    carried = update_registration(T_base_tracker, NONE, first, second, TrackerErrorField(0.0))
    head_tracker = carried.T_base_tracker.inv() @ HEAD
    off = []
    for _ in range(1500):
        drawn = (
            SeenBase(deviate(pose, root @ rng.normal(size=6)), NONE, 20)
            for pose, root in zip((then, now), roots, strict=True)
        )
        found = update_registration(
            T_base_tracker, NONE, *drawn, TrackerErrorField(0.0)
        ).T_base_tracker
        off.append(found @ head_tracker - HEAD)
    measured = np.sqrt((np.array(off) ** 2).sum(axis=2).mean(axis=0))
    np.testing.assert_allclose(carried.added_sigma_mm(HEAD), measured, rtol=0.06)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("profile", ["polaris", "white035", "vega"])
def test_the_predicted_cost_is_honest(profile, place):
    measured, predicted = [], []
    for seed in range(40):
        scene = scene_of(seed, profile)
        first = scene.tracker_at(TrackerPlace())
        then, now = seen_from(scene, TrackerPlace(), 1), seen_from(scene, place, 2)
        assert detect_tracker_movement(then, now).moved
        carried = update_registration(first, NONE, then, now, TrackerErrorField(FIELD_MM[profile]))
        head = HEAD[:1]
        off = carried.T_base_tracker @ (scene.tracker_at(place).inv() @ head) - head
        measured.append(float(np.linalg.norm(off)))
        predicted.append(float(carried.added_sigma_mm(head)[0]))
    ratio = np.sqrt(np.mean(np.square(measured)) / np.mean(np.square(predicted)))
    assert 0.65 <= ratio <= 1.45


@pytest.mark.sweep(1)
@pytest.mark.parametrize("profile", ["ideal", "polaris", "white035"])
def test_a_tracker_at_rest_is_not_said_to_have_moved(profile):
    scenes = [scene_of(seed, profile) for seed in range(12)]
    for scene in scenes:
        then, now = (seen_from(scene, TrackerPlace(), ordinal) for ordinal in (1, 2))
        assert not detect_tracker_movement(then, now).moved


def test_a_small_move_is_seen_and_said_in_numbers():
    scene = scene_of(3)
    then = seen_from(scene, TrackerPlace(), 1)
    now = seen_from(scene, TrackerPlace((0.0, 0.0, 12.0)), 2)
    movement = detect_tracker_movement(then, now)
    assert movement.moved
    assert movement.shift_mm == pytest.approx(12.0, abs=1.0)
    assert movement.turn_deg < 0.1


def test_gross_errors_do_not_count_and_few_frames_are_refused():
    rng = np.random.default_rng(0)
    poses = [Pose.from_translation(rng.normal(0.0, 0.05, 3)) for _ in range(60)]
    clean = mean_base(Poses.stack(poses))
    wild = mean_base(Poses.stack([*poses, Pose.from_translation((40.0, 0.0, 0.0))]))
    np.testing.assert_allclose(
        wild.T_tracker_basemarker.translation, clean.T_tracker_basemarker.translation, atol=0.01
    )
    with pytest.raises(DegenerateGeometryError, match="base marker was seen in 9 frames"):
        mean_base(Poses.stack(poses[: MIN_FRAMES - 1]))
