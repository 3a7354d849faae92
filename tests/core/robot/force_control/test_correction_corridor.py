"""The certified motion with room along the tool axis."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

from rona_core.devices.settings import ContactSettings
from rona_core.errors import NotReachableError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import Capsule, Obstacle, Obstacles
from rona_core.robot.force_control.correction_corridor import (
    band_is_safe,
    correction_corridor,
    straight_line,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import JointLimits
from rona_core.robot.planning.plan_motion import plan_scan
from tests.scenes.patch_scenes import dense_path

RX90 = robot_model("rx90")
SETTINGS = ContactSettings()


@pytest.fixture(scope="module")
def trajectory():
    plan = plan_scan(dense_path("S0", lines=3, per_line=4), RX90)
    assert plan.may_move
    return plan.trajectory


@pytest.fixture(scope="module")
def band(trajectory):
    return correction_corridor(RX90, trajectory, SETTINGS)


def test_the_middle_of_the_band_is_the_certified_motion(trajectory, band):
    assert band.travel_mm == SETTINGS.travel_mm
    middle = int(np.flatnonzero(band.travels_mm == 0.0)[0])
    np.testing.assert_array_equal(band.qs_rad[:, middle], trajectory.qs_rad)
    assert band.certificate.certified
    assert any("joint limits" in check.name for check in band.certificate.checks)


def test_every_level_moves_the_probe_along_its_axis_and_nothing_else(trajectory, band):
    at = np.flatnonzero(band.guided)[::7]
    nominal = RX90.forward(trajectory.qs_rad[at]) @ RX90.T_flange_probe
    for level, travel in enumerate(band.travels_mm):
        moved = RX90.forward(band.qs_rad[at, level]) @ RX90.T_flange_probe
        wanted = nominal.translations + travel * nominal.rotations[:, :, 2]
        np.testing.assert_allclose(moved.translations, wanted, atol=1e-6)
        np.testing.assert_allclose(moved.rotations, nominal.rotations, atol=1e-9)


def test_between_the_levels_it_is_as_exact(trajectory, band):
    at = np.flatnonzero(band.guided)[::31]
    nominal = RX90.forward(trajectory.qs_rad[at]) @ RX90.T_flange_probe
    for travel in (-4.3, -1.1, 0.4, 3.7):
        qs = BarycentricInterpolator(band.travels_mm, band.qs_rad[at], axis=1)(travel)
        moved = RX90.forward(qs) @ RX90.T_flange_probe
        wanted = nominal.translations + travel * nominal.rotations[:, :, 2]
        np.testing.assert_allclose(moved.translations, wanted, atol=1e-4)


def test_only_the_path_and_its_straight_lines_may_be_corrected(trajectory, band):
    times = trajectory.times_s
    on_path = (times >= trajectory.scan_start_s) & (times <= trajectory.scan_end_s)
    assert band.guided[on_path].all()
    assert not band.guided[0]
    assert not band.guided[-1]
    probes = RX90.forward(trajectory.qs_rad) @ RX90.T_flange_probe
    np.testing.assert_array_equal(straight_line(trajectory, probes), band.guided)
    first = np.flatnonzero(band.guided)[0]
    start = np.flatnonzero(on_path)[0]
    away = probes.translations[first] - probes.translations[start]
    assert np.linalg.norm(away) == pytest.approx(30.0, abs=1.0)
    free = ~band.guided
    np.testing.assert_array_equal(np.ptp(band.qs_rad[free], axis=1), 0.0)


def with_lower_limit(joint, value_rad):
    limits = RX90.limits
    upper = np.array(limits.upper_rad)
    upper[joint] = value_rad
    return replace(
        RX90,
        limits=JointLimits(
            limits.lower_rad, upper, limits.speed_rad_per_s, limits.acceleration_rad_per_s2
        ),
    )


def test_a_joint_limit_inside_the_band_narrows_it_and_then_refuses(trajectory, band):
    sheet = band.qs_rad[band.guided]
    reach = sheet.max(axis=0)  # (m, 6) at each correction
    spans = reach.max(axis=0) - reach[len(reach) // 2]
    joint = int(np.argmax(spans))
    full, middle = reach[:, joint].max(), reach[len(reach) // 2, joint]
    tight = with_lower_limit(joint, middle + 0.75 * (full - middle))
    narrower = correction_corridor(tight, trajectory, SETTINGS)
    assert 3.0 <= narrower.travel_mm < SETTINGS.travel_mm
    refused = band_is_safe(tight, trajectory, SETTINGS.travel_mm)
    assert not refused.certificate.certified
    assert "joint limits" in refused.certificate.failures()[0].name
    with pytest.raises(NotReachableError, match="joint limits"):
        correction_corridor(with_lower_limit(joint, middle + 1e-6), trajectory, SETTINGS)


def ball_ahead(trajectory, least_mm, margin_mm=5.0, touch_mm=0.0):
    """A ball ahead of the probe in the middle of the scan, ``least_mm`` away at the nearest."""
    middle_s = 0.5 * (trajectory.scan_start_s + trajectory.scan_end_s)
    sample = int(np.searchsorted(trajectory.times_s, middle_s))
    face = RX90.forward(trajectory.qs_rad[[sample]])[0] @ RX90.T_flange_probe
    ahead_mm = 60.0
    for _ in range(5):
        pose = Pose.from_translation(face @ np.array((0.0, 0.0, ahead_mm)))
        thing = Obstacle("ball", Capsule(20.0, 0.0), pose, margin_mm, touch_mm=touch_mm)
        world = CollisionWorld(RX90, Obstacles((thing,)))
        with_ball = [i for i, pair in enumerate(world.pairs) if pair.second == "ball"]
        ahead_mm += least_mm - world.distances_mm(trajectory.qs_rad[::4])[:, with_ball].min()
    return world


def test_what_stands_in_the_band_narrows_it_and_then_refuses_by_name(trajectory):
    """The motion keeps its distance; a correction towards the ball does not."""
    for least_mm, width_mm in ((11.0, 5.0), (9.2, 4.0)):
        world = ball_ahead(trajectory, least_mm)
        assert world.clear(trajectory.qs_rad).all()
        band = correction_corridor(RX90, trajectory, SETTINGS, world)
        assert band.travel_mm == width_mm
        assert band.certificate.obstacles == world.obstacles.digest()
        for level in range(len(band.travels_mm)):
            assert world.clear(band.qs_rad[:, level]).all()
    world = ball_ahead(trajectory, 7.0)
    assert world.clear(trajectory.qs_rad).all()
    refused = band_is_safe(RX90, trajectory, 5.0, world).certificate
    (check,) = refused.failures()
    assert check.name == "clearance in the band"
    assert check.limit == 5.0
    assert check.value < 5.0
    assert "probe and ball are" in check.sentence
    assert check.index in np.flatnonzero(band.guided)
    with pytest.raises(NotReachableError, match=r"±3 mm.*probe and ball are \d\.\d mm apart"):
        correction_corridor(RX90, trajectory, SETTINGS, world)
    assert correction_corridor(RX90, trajectory, SETTINGS).travel_mm == SETTINGS.travel_mm


def test_the_delay_line_may_be_pressed_in_as_far_as_the_head_allows(trajectory):
    for touch_mm, holds in ((6.0, True), (4.0, False)):
        world = ball_ahead(trajectory, 0.0, margin_mm=0.0, touch_mm=touch_mm)
        certificate = band_is_safe(RX90, trajectory, 5.0, world).certificate
        assert certificate.certified == holds, touch_mm
        if not holds:
            assert "delay line and ball" in certificate.failures()[0].sentence
