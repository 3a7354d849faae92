"""A tip in a seat: it stays there in truth, and the encoders tell what the arm gave way by."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.settings import DeviceSettings, RobotSettings
from rona_core.errors import DeviceError
from rona_core.robot.kinematics.catalog import milling_robot
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.rig import build_scene
from rona_core.virtual.robot import seated_motion
from rona_core.virtual.robot.robot import VirtualRobot
from rona_core.virtual.robot.seated_motion import CHUCK_MM, PLAY_MM, Seated, seated_postures
from rona_core.virtual.true_tool_poses import error_keys
from rona_core.virtual.world.world import NOMINAL
from tests.helpers.sphere_world import SphereSpecimen

RX90 = milling_robot("rx90")
SEED, ORDINAL = 7, 3


@pytest.fixture(scope="module")
def plan():
    return plan_tool_motion(RX90, ToolMotionSettings(cone_deg=25.0, n_pivot=8, n_translate=0))


def scene_of(**world):
    drawn = replace(NOMINAL, seed=SEED, robot_joints=True, **world)
    return build_scene(SEED, SphereSpecimen(), DeviceSettings(), drawn)


def seated_of(plan):
    return Seated(ORDINAL, float(plan.dwell_start_s[0]), float(plan.dwell_end_s[-1]))


def points_of(scene, plan, qs, inside):
    """Return where the true tip of the spindle is (n, 3), the pin's seat in the chuck left out."""
    tips = RX90.forward(qs) @ RX90.T_flange_tip
    keys = error_keys(plan.times_s[inside])
    true = scene.Ts_base_tip_true(tips.select(inside), qs[inside], ORDINAL, keys)
    return true @ scene.world.spindle_off_tip


def test_the_true_tip_stays_where_the_seat_holds_it(plan, monkeypatch):
    monkeypatch.setattr(seated_motion, "CHUCK_MM", 0.0)
    scene, seated = scene_of(spindle_mm=0.6), seated_of(plan)
    qs = seated_postures(scene, RX90, plan.times_s, plan.qs_rad, seated)
    inside = (plan.times_s >= seated.start_s) & (plan.times_s <= seated.end_s)
    held = points_of(scene, plan, qs, inside)
    assert np.linalg.norm(held - held.mean(axis=0), axis=1).max() < 6.0 * PLAY_MM
    free = points_of(scene, plan, plan.qs_rad, inside)
    assert np.linalg.norm(free - free.mean(axis=0), axis=1).max() > 0.25  # without a seat it swings
    # the arm gives way by a millimetre or so, and ends where it was to end
    np.testing.assert_allclose(qs[[0, -1]], plan.qs_rad[[0, -1]], atol=1e-9)
    assert np.rad2deg(np.abs(qs - plan.qs_rad).max()) < 1.0
    assert CHUCK_MM > 0.0


def test_a_robot_yields_only_where_there_is_a_seat(plan):
    alone = VirtualRobot(RX90, CaptureClock())
    alone.begin(RobotSettings(latency_ms=0.0), 0)
    with pytest.raises(DeviceError, match="no seat"):
        alone.move_seated(plan.times_s, plan.qs_rad, (1.0, 2.0))
    with pytest.raises(DeviceError, match="never in its seat"):
        seated_postures(scene_of(), RX90, plan.times_s, plan.qs_rad, Seated(0, 1e6, 2e6))


def test_a_seated_motion_starts_and_ends_as_any_other(plan):
    clock, told = CaptureClock(), []

    def yields(times_s, qs_rad, seated):
        told.append(seated)
        return qs_rad + 1e-3

    robot = VirtualRobot(RX90, clock, yields)
    robot.begin(RobotSettings(latency_ms=0.0), ORDINAL)
    clock.wait_until(2.0)
    motion = robot.move_seated(plan.times_s, plan.qs_rad, (1.0, 4.0))
    assert told == [Seated(ORDINAL, 3.0, 6.0)]
    clock.wait_until(2.0 + plan.times_s[-1] + 0.1)
    assert motion.done()
    np.testing.assert_allclose(robot.state().q_rad, plan.qs_rad[-1] + 1e-3, atol=1e-12)
    with pytest.raises(DeviceError, match="starts"):
        robot.move_seated(plan.times_s, plan.qs_rad + 0.5, (1.0, 4.0))
