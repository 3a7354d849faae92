"""Timing of the scan: blended corners, the speed profile, and what its samples amount to."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from benchmarks.reference.trajectory_figures import timing_figures
from rona_core.errors import InvalidInputError
from rona_core.geometry.path5d import Path5D
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import JointLimits
from rona_core.robot.redundancy.margins import joint_path
from rona_core.robot.trajectory.scan_timing import ScanSettings, sample_path, time_scan
from rona_core.robot.trajectory.time_parameterization import (
    GRID_MM,
    NARROWEST_MM,
    TURN_RAD,
    SpeedLimits,
    blend_corners,
    parameterize_time,
)
from rona_core.robot.trajectory.trajectory import SAMPLE_S, Trajectory
from rona_core.robot.verification.verifier import verify_scan
from tests.helpers.roll_search import search_rolls
from tests.scenes.patch_scenes import dense_path

RX90 = robot_model("rx90")


def joint_limits(speed, acceleration):
    ends = np.full(6, 10.0)
    return JointLimits(-ends, ends, np.full(6, speed), np.full(6, acceleration))


WIDE = joint_limits(10.0, 100.0)


@pytest.fixture(scope="module")
def followed():
    """A path with square corners, its joint path, branch and roll."""
    path = dense_path("S5", lines=4, per_line=5, half_mm=25.0)
    search = search_rolls(path, RX90, working_set=(12, 0.0, 360.0))
    verdict = search.verdicts[search.chosen]
    roll_rad = float(np.deg2rad(verdict.roll_deg))
    return path, joint_path(path, RX90, roll_rad, verdict.branch), verdict.branch, roll_rad


def probe(qs):
    return RX90.forward(qs) @ RX90.T_flange_probe


@pytest.mark.parametrize("deviation_mm", [0.02, 0.1, 0.2])
def test_blending_stays_within_the_deviation_and_keeps_the_ends(followed, deviation_mm):
    path, qs, _, _ = followed
    way = path.arc_length_mm()
    rounded = blend_corners(way, qs, RX90, deviation_mm)
    assert rounded.deviation_mm <= deviation_mm
    assert rounded.turn_rad <= TURN_RAD
    np.testing.assert_array_equal(rounded.qs_rad[[0, -1]], qs[[0, -1]])
    assert (np.diff(rounded.way_mm) > 0).all()
    # measured again, between the knots as well
    fine = np.linspace(0, way[-1], 7001)
    real = np.stack([np.interp(fine, rounded.way_mm, q) for q in rounded.qs_rad.T], axis=1)
    meant = np.stack([np.interp(fine, way, q) for q in qs.T], axis=1)
    off = np.linalg.norm(probe(real).translations - probe(meant).translations, axis=1)
    assert off.max() <= 1.03 * deviation_mm
    # what may deviate is used where there is a corner
    assert rounded.deviation_mm >= 0.6 * deviation_mm


def test_blending_is_the_mean_under_a_triangle(followed):
    """One corner between two straight joint moves: off by slope change * width / 6 at its top."""
    way = np.linspace(0.0, 40.0, 41)
    rates = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 1e-4))  # about the tool's own flange: small motions
    start = followed[1][0]
    qs = start + rates * np.abs(way - 20.0)[:, None]
    rounded = blend_corners(way, qs, RX90, 0.2)
    top = float(np.interp(20.0, rounded.way_mm, rounded.qs_rad[:, 5])) - start[5]
    assert top == pytest.approx(2e-4 * 6.0 / 6.0, rel=1e-9)  # the widest window, half 6 mm
    left = float(np.interp(8.0, rounded.way_mm, rounded.qs_rad[:, 5])) - start[5]
    assert left == pytest.approx(12e-4, rel=1e-9)  # straight parts stay


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), angle=st.floats(-2.0, 2.0))
def test_blending_does_not_care_where_joint_one_stands(seed, angle):
    rng = np.random.default_rng(seed)
    way = np.cumsum(rng.uniform(0.3, 1.5, 60))
    qs = RX90.home_rad + np.cumsum(rng.normal(0, 2e-3, (60, 6)), axis=0)
    turned = qs + np.array((angle, 0, 0, 0, 0, 0))
    a, b = blend_corners(way, qs, RX90, 0.2), blend_corners(way + 5.0, turned, RX90, 0.2)
    assert a.deviation_mm <= 0.2
    assert a.deviation_mm == pytest.approx(b.deviation_mm, abs=1e-6)
    assert len(a.way_mm) == len(b.way_mm)
    np.testing.assert_allclose(b.qs_rad[:, 1:], a.qs_rad[:, 1:], atol=1e-8)
    np.testing.assert_allclose(b.qs_rad[:, 0] - angle, a.qs_rad[:, 0], atol=1e-8)


def test_a_window_too_narrow_changes_nothing(followed):
    path, qs, _, _ = followed
    rounded = blend_corners(path.arc_length_mm(), qs, RX90, 1e-4)
    assert rounded.deviation_mm <= 1e-4
    assert NARROWEST_MM > 0
    with pytest.raises(InvalidInputError, match="must grow"):
        blend_corners(np.zeros(3), np.zeros((3, 6)), RX90, 0.2)


def test_a_straight_way_takes_the_time_of_the_closed_form():
    """Trapezoid with rounded ends: length / speed + speed / acceleration + acceleration / jerk."""
    way = np.linspace(0, 200, 201)
    qs = way[:, None] * np.full(6, 1e-5)
    points = way[:, None] * np.array((1.0, 0, 0))
    for speed in (2.0, 20.0, 60.0):
        timed = parameterize_time(way, qs, points, SpeedLimits(speed, 250.0, 2500.0), WIDE)
        reached = min(0.9 * 0.6 * 250.0, np.sqrt(speed * 2500.0))
        expected = 200 / speed + speed / reached + reached / 2500.0
        assert timed.duration_s == pytest.approx(expected, rel=1e-3)
        times = np.linspace(0, timed.duration_s, 20001)
        ways, h = timed.way_at(times), times[1]
        assert ways[[0, -1]] == pytest.approx([0.0, 200.0], abs=1e-9)
        speeds = np.diff(ways) / h
        assert speeds.max() == pytest.approx(speed, rel=1e-6)
        gains = np.diff(speeds) / h
        assert np.abs(gains).max() <= reached * 1.001
        coarse = np.diff(gains[:: max(1, round(0.005 / h))]) / 0.005
        assert np.abs(coarse).max() <= 2500.0 * 1.05


def test_the_way_over_time_keeps_speed_and_acceleration():
    way = np.linspace(0, 50, 51)
    qs = np.sin(way[:, None] / np.array((5.0, 7.0, 9.0, 11.0, 13.0, 15.0))) * 0.2
    points = np.column_stack((way, np.sin(way / 3.0), 0 * way))
    timed = parameterize_time(way, qs, points, SpeedLimits(30.0, 250.0, 2500.0), WIDE)
    times = np.linspace(0.0, timed.duration_s, 5001)
    ways = timed.way_at(times)
    assert ways[[0, -1]] == pytest.approx([0.0, 50.0], abs=1e-9)
    speeds = np.diff(ways) / times[1]
    assert speeds.min() >= -1e-9
    assert speeds.max() <= 30.0 * (1.0 + 1e-6)
    assert np.abs(np.diff(speeds) / times[1]).max() <= 250.0 * 1.001


@pytest.mark.parametrize(("before", "slow", "after"), [(10.0, 20.0, 10.0), (2.0, 0.04, 2.0)])
def test_a_slower_stretch_is_nowhere_passed_faster_wherever_it_begins_in_the_grid(
    before, slow, after
):
    """One that is as long as the way before and after, and one that lies between two cells."""
    for shift in np.linspace(0.0, GRID_MM, 11):
        way = np.cumsum((0.0, 20.0 + shift, slow, 20.0))
        feeds = np.array((before, before, 1.0, after))
        qs, points = way[:, None] * np.full(6, 1e-5), way[:, None] * np.array((1.0, 0, 0))
        limits = SpeedLimits(before, 250.0, 2500.0)
        timed = parameterize_time(way, qs, points, limits, WIDE, feeds)
        times = np.linspace(0.0, timed.duration_s, 5001)
        least_s = np.interp(
            timed.way_at(times), way, np.concatenate(([0.0], np.cumsum(np.diff(way) / feeds[1:])))
        )
        assert (np.diff(least_s) / times[1]).max() <= 1.001


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_no_sample_is_faster_than_its_feed_and_all_of_them_are_on_the_path(seed):
    """Random corners 2 mm apart and random feeds, as of a burr; limits of the joints are wide."""
    rng = np.random.default_rng(seed)
    corners = RX90.home_rad + np.cumsum(rng.normal(0.0, 1.5e-3, (25, 6)), axis=0)
    qs = np.stack([np.interp(np.arange(193) / 8.0, np.arange(25), q) for q in corners.T], axis=1)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(probe(qs).translations, axis=0), axis=1)))
    path = blend_corners(way, qs, RX90, 0.04)
    feeds = rng.uniform(1.0, 8.0, 25)[(np.arange(len(path.way_mm)) * 25) // len(path.way_mm)]
    limits = SpeedLimits(float(feeds.max()), 250.0, 2500.0)
    ways, driven = sample_path(path.way_mm, path.qs_rad, path.points_base, limits, RX90, feeds)
    assert (np.diff(ways) >= 0.0).all()
    np.testing.assert_array_equal(ways[[0, -1]], path.way_mm[[0, -1]])
    on_path = CubicSpline(path.way_mm, path.qs_rad, bc_type="natural")(ways)
    np.testing.assert_allclose(driven, on_path, rtol=0.0, atol=1e-12)
    moved = np.linalg.norm(np.diff(probe(driven).translations, axis=0), axis=1)
    passed = np.append(0.0, np.cumsum(np.diff(path.way_mm) / feeds[1:]))
    pace = np.diff(np.interp(ways, path.way_mm, passed)) / np.maximum(np.diff(ways), 1e-9)
    share = np.maximum(moved, np.diff(ways)) * pace / SAMPLE_S
    assert share.max() <= 1.0
    assert share.max() > 0.8, "little slower than needed"


def test_slow_joints_hold_the_scan_back():
    way = np.linspace(0, 100, 101)
    qs = np.zeros((101, 6))
    qs[:, 3] = 0.02 * way  # 20 mm/s would be 0.4 rad/s
    points = way[:, None] * np.array((1.0, 0, 0))
    limits = SpeedLimits(20.0, 250.0, 2500.0)
    timed = parameterize_time(way, qs, points, limits, joint_limits(0.2, 100.0))
    times = np.linspace(0.0, timed.duration_s, 2001)
    speeds = np.diff(timed.way_at(times)) / times[1]
    assert speeds.max() == pytest.approx(0.9 * 0.2 / 0.02)


@pytest.mark.parametrize("speed", [5.0, 20.0, 50.0, 100.0])
def test_no_sampled_limit_is_exceeded_and_the_verifier_agrees(followed, speed):
    path, qs, _, roll_rad = followed
    asked = ScanSettings(scan_speed_mm_per_s=speed)
    trajectory = time_scan(path, qs, RX90, asked)
    figures = timing_figures(trajectory, path, RX90, speed)
    assert figures.joint_speed_share <= 1.0 + 1e-6
    assert figures.joint_acceleration_share <= 1.0 + 1e-6
    assert figures.path_acceleration_mm_per_s2 <= 250.0 * (1.0 + 1e-6)
    assert figures.path_jerk_mm_per_s3 <= 2500.0 * (1.0 + 1e-6)
    assert 0.0 < figures.deviation_mm <= 0.21
    assert figures.scan_duration_s >= figures.ideal_duration_s
    assert verify_scan(RX90, trajectory, path, roll_rad, speed, obstacles=NOTHING_AROUND).certified


def test_weak_joints_are_not_overdriven_either(followed):
    """With a hundredth of the accelerations it is the joints that decide."""
    path, qs, _, roll_rad = followed
    limits = RX90.limits
    weak = replace(
        RX90,
        limits=JointLimits(
            limits.lower_rad,
            limits.upper_rad,
            limits.speed_rad_per_s / 60.0,
            limits.acceleration_rad_per_s2 / 60.0,
        ),
    )
    trajectory = time_scan(path, qs, weak, ScanSettings())
    figures = timing_figures(trajectory, path, weak, 20.0)
    assert 0.5 < figures.joint_speed_share <= 1.0 + 1e-6
    assert 0.5 < figures.joint_acceleration_share <= 1.0 + 1e-6
    assert verify_scan(weak, trajectory, path, roll_rad, 20.0, obstacles=NOTHING_AROUND).certified


def test_wider_corners_are_faster_and_most_of_the_path_is_at_scan_speed(followed):
    path, qs, _, _ = followed
    durations = []
    for deviation_mm in (0.05, 0.1, 0.2):
        asked = ScanSettings(corner_deviation_mm=deviation_mm)
        figures = timing_figures(
            time_scan(path, qs, RX90, asked), path, RX90, asked.scan_speed_mm_per_s
        )
        assert figures.deviation_mm <= deviation_mm + 0.01
        durations.append(figures.scan_duration_s)
    assert durations[0] > durations[1] > durations[2]
    assert figures.steady_share > 0.85
    slow = ScanSettings(scan_speed_mm_per_s=5.0)
    calm = timing_figures(time_scan(path, qs, RX90, slow), path, RX90, 5.0)
    assert calm.steady_share > 0.99


def test_the_smoothest_path_is_driven_at_scan_speed_throughout(followed):
    """A straight line: everything but the start and the stop."""
    path, _, branch, roll_rad = followed
    line = Path5D(
        path.points_base[0] + np.linspace(0, 40, 41)[:, None] * np.array((0.0, 0.6, 0.8)),
        np.repeat(path.axes_base[:1], 41, axis=0),
    )
    qs = joint_path(line, RX90, roll_rad, branch)
    trajectory = time_scan(line, qs, RX90, ScanSettings())
    figures = timing_figures(trajectory, line, RX90, 20.0)
    ramps_mm = 20.0 * (20.0 / 135.0 + 135.0 / 2500.0)
    assert figures.steady_share == pytest.approx(1.0 - ramps_mm / 40.0, abs=0.03)
    assert figures.deviation_mm < 0.01


def test_nonsense_is_refused_by_name(followed):
    path, qs, _, _ = followed
    with pytest.raises(InvalidInputError, match="corner_deviation_mm must be"):
        ScanSettings(corner_deviation_mm=0.4)
    with pytest.raises(InvalidInputError, match="qs_rad must have shape"):
        time_scan(path, qs[:-1], RX90, ScanSettings())
    still = Path5D(np.repeat(path.points_base[:1], 3, axis=0), path.axes_base[[0, 0, 0]])
    with pytest.raises(InvalidInputError, match="two places"):
        time_scan(still, qs[[0, 0, 0]], RX90, ScanSettings())
    resting = Trajectory(np.arange(3.0), qs[:3], 1.0, 0.0, np.zeros(3))
    with pytest.raises(InvalidInputError, match="no scan"):
        timing_figures(resting, path, RX90, 20.0)
