"""The robot's calibration motion about its tool tip."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Capsule, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.calibration_motion import (
    ALONG_X,
    ALONG_Y,
    PIVOT,
    ToolMotionSettings,
    plan_tool_motion,
)

RX90 = robot_model("rx90")
TRACKER_BASE = np.array((2220.0, 540.0, 1280.0))  # in front, to the left and above


@pytest.fixture(scope="module")
def motion():
    return plan_tool_motion(RX90)


@pytest.fixture(scope="module")
def tips(motion):
    return RX90.forward(motion.qs_rad) @ RX90.T_flange_tip


def dwell_rows(motion):
    gap = motion.times_s[1]
    starts = np.round(motion.dwell_start_s / gap).astype(int)
    ends = np.round(motion.dwell_end_s / gap).astype(int)
    return list(zip(starts, ends, strict=True))


def test_it_may_pivot_alone():
    motion = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=6, n_translate=0, dwell_s=0.2))
    assert motion.phases.tolist() == [0] * 6
    tips = RX90.forward(motion.qs_rad) @ RX90.T_flange_tip
    inside = (motion.times_s >= motion.dwell_start_s[0]) & (
        motion.times_s <= motion.dwell_end_s[-1]
    )
    away = tips.translations[inside] - motion.T_base_tip_center.translation
    assert np.linalg.norm(away, axis=1).max() < 0.05
    with pytest.raises(InvalidInputError, match="n_translate"):
        ToolMotionSettings(n_translate=1)


def test_it_is_certified_and_goes_from_home_to_home(motion):
    assert motion.certificate.certifies(motion, RX90, NOTHING_AROUND)
    np.testing.assert_array_equal(motion.qs_rad[0], RX90.home_rad)
    np.testing.assert_allclose(motion.qs_rad[-1], RX90.home_rad, atol=1e-12)
    assert np.abs(np.diff(motion.qs_rad, axis=0)).max() < np.deg2rad(2)


def test_the_robot_stands_still_at_every_dwell(motion):
    assert (motion.phases == np.repeat((PIVOT, ALONG_X, ALONG_Y), (30, 10, 10))).all()
    np.testing.assert_allclose(motion.dwell_end_s - motion.dwell_start_s, 0.5, atol=1e-9)
    assert (motion.dwell_start_s[1:] > motion.dwell_end_s[:-1]).all()
    for start, end in dwell_rows(motion):
        np.testing.assert_allclose(
            motion.qs_rad[start : end + 1],
            motion.qs_rad[[start]].repeat(end - start + 1, 0),
            atol=0,
        )


def test_the_tip_stays_in_its_place_all_through_the_pivot(motion, tips):
    rows = dwell_rows(motion)
    pivot = slice(rows[0][0], rows[29][1] + 1)
    away = tips.translations[pivot] - motion.T_base_tip_center.translation
    assert np.linalg.norm(away, axis=1).max() < 0.02
    axes = tips.rotations[[start for start, _ in rows[:30]]][:, :, 2]
    tilts = np.rad2deg(np.arccos(np.clip(-axes[:, 2], -1, 1)))
    assert tilts.max() == pytest.approx(20.0, abs=0.1)
    assert np.linalg.norm(axes[:, :2].mean(axis=0)) < 0.05  # to all sides alike
    spread = np.linalg.svd(axes - axes.mean(axis=0))[1] / np.sqrt(30)
    assert spread[1] > 0.12


@pytest.mark.parametrize(("phase", "axis"), [(ALONG_X, 0), (ALONG_Y, 1)])
def test_the_shifts_run_along_the_tool_axes_at_constant_orientation(motion, tips, phase, axis):
    rows = [row for row, p in zip(dwell_rows(motion), motion.phases, strict=True) if p == phase]
    along = slice(rows[0][0], rows[-1][1] + 1)
    center = motion.T_base_tip_center
    in_tool = (tips.translations[along] - center.translation) @ center.rotation
    others = [i for i in range(3) if i != axis]
    assert np.abs(in_tool[:, others]).max() < 0.02
    assert np.ptp(in_tool[:, axis]) == pytest.approx(100.0, abs=1e-6)
    turned = np.abs(tips.rotations[along] - center.rotation)
    assert turned.max() < 5e-4


def test_the_marker_plate_faces_the_tracker_all_the_time(motion):
    rows = dwell_rows(motion)
    markers = RX90.forward(motion.qs_rad[rows[0][0] : rows[-1][1]]) @ RX90.T_flange_toolmarker
    sight = TRACKER_BASE - markers.translations
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    cosines = np.einsum("ij,ij->i", sight, markers.rotations[:, :, 2])
    assert cosines.min() > np.cos(np.deg2rad(30.0))


def test_other_places_and_directions_work_too():
    motion = plan_tool_motion(
        RX90,
        ToolMotionSettings(n_pivot=6, n_translate=3, dwell_s=0.2),
        tip_base=(600.0, 60.0, 500.0),
        facing_base=(0.5, 0.8, 0.0),
    )
    assert motion.certificate.certifies(motion, RX90, NOTHING_AROUND)
    assert len(motion.phases) == 12
    np.testing.assert_allclose(motion.T_base_tip_center.translation, (600, 60, 500))


def test_what_cannot_be_done_is_refused_by_name():
    with pytest.raises(NotReachableError, match="choose another place"):
        plan_tool_motion(RX90, tip_base=(1500.0, 0.0, 500.0))
    with pytest.raises(InvalidInputError, match="cone_deg"):
        plan_tool_motion(RX90, ToolMotionSettings(cone_deg=0.0))
    with pytest.raises(InvalidInputError, match="n_pivot"):
        plan_tool_motion(RX90, ToolMotionSettings(n_pivot=1))
    with pytest.raises(InvalidInputError, match="must not be vertical"):
        plan_tool_motion(RX90, facing_base=(0.0, 0.0, 1.0))


def ball(center, radius=12.0):
    pose = Pose.from_translation(center)
    return Obstacles((Obstacle("ball", Capsule(radius, 0.0), pose, 5.0),))


def test_from_one_dwell_to_the_next_it_goes_around_what_is_in_the_way():
    plain = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2))
    rows = dwell_rows(plain)
    leg = plain.qs_rad[rows[4][1] : rows[5][0]]  # the shift along tool x, through the middle
    places = (RX90.forward(leg) @ RX90.T_flange_tip).translations
    around = ball(places[len(places) // 4] - (0.0, 0.0, 15.0))
    clear = CollisionWorld(RX90, around).clear
    stops = [start for start, _ in rows]
    assert clear(plain.qs_rad[stops]).all()
    assert not clear(leg).all()
    motion = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2), obstacles=around)
    assert motion.certificate.certifies(motion, RX90, around)
    assert clear(motion.qs_rad).all()
    found = [start for start, _ in dwell_rows(motion)]
    np.testing.assert_array_equal(motion.qs_rad[found], plain.qs_rad[stops])
    np.testing.assert_array_equal(motion.phases, plain.phases)


def test_a_dwell_at_which_something_stands_is_refused_by_name():
    plain = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2))
    start, _ = dwell_rows(plain)[5]
    tip = (RX90.forward(plain.qs_rad[[start]]) @ RX90.T_flange_tip).translations[0]
    with pytest.raises(NotReachableError, match=r"place 6 of 8.*ball are -?\d+ mm apart"):
        plan_tool_motion(
            RX90,
            ToolMotionSettings(n_pivot=4, n_translate=2),
            obstacles=ball(tip - (0.0, 0.0, 10.0)),
        )
