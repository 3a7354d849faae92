"""Step 8 on the virtual devices: pressed on and by position alone, lost contact, one clock."""

from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.references import watch_head
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.scan import captures as scan_capture
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.app.steps.scan.derivation import DELAY, KNOWN_MOUNTING, POSES
from rona_core.app.steps.tool.robot_motion import drive_to
from rona_core.devices.live import Live
from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import APPROACH, CONTACT, RETRACT, STOPPED
from rona_core.errors import CancelledError
from rona_core.evaluation.scan_metrics import contact_figures, true_probe_poses
from rona_core.evaluation.truth import Truth
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import ScanCapture
from rona_core.session.codec import decode, digest, encode
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.specimen.build_specimen import build_specimen
from tests.scenes import demo_parts

pytestmark = pytest.mark.slow


def session_with(**robot):
    """The demo session, with few A-scans and other settings of the robot."""
    session = demo_parts.demo()
    devices = session.setup.devices
    devices = replace(
        devices,
        robot=replace(devices.robot, **robot),
        probe=replace(devices.probe, pitch_mm=5.0),
    )
    return replace(session, setup=replace(session.setup, devices=devices))


def scan(session, specimen=None, cancel=lambda: False):
    setup = session.setup
    specimen = specimen or build_specimen(setup.specimen, setup.seed)
    rig = VirtualRig(setup.seed, specimen, setup.devices)
    tools = ActivityContext(
        devices=lambda: rig,
        live=Live(),
        import_skull=lambda *_, **__: None,
        uploads=Path(),
        cancel=cancel,
    )
    return capture_scan(session, tools), rig, tools


@pytest.fixture(scope="module")
def pressed():
    session = session_with(contact=ContactSettings(), latency_ms=8.0)
    capture, rig, _ = scan(session)
    return replace(session, captures=replace(session.captures, scan=capture)), rig


def test_the_force_is_kept_over_the_whole_path(pressed):
    session, _ = pressed
    capture = session.captures.scan
    track = capture.forces
    assert not capture.partial
    assert not track.reason
    figures = contact_figures(capture)
    assert figures["contact_force_rms_n"] <= 0.7
    assert figures["contact_force_peak_n"] <= 6.0
    assert np.abs(track.travel_mm).max() < track.band_mm
    assert track.setpoint_n == 3.0
    assert track.stiffness_n_per_mm == pytest.approx(2.0, rel=0.25)
    codes = track.states[np.concatenate(([True], np.diff(track.states) != 0))]
    assert codes[:3].tolist() == [APPROACH, CONTACT, RETRACT]
    assert track.load.mass_kg == pytest.approx(0.2, abs=0.03)
    assert track.load.residual_n < 0.03


def test_a_scans_come_by_way_not_by_time(pressed):
    session, _ = pressed
    capture, track = session.captures.scan, session.captures.scan.forces
    way = np.interp(capture.scans.times_s, track.times_s, track.way_mm)
    np.testing.assert_allclose(np.diff(way), 5.0, atol=0.35)  # the way is known every 16 ms
    assert way[0] == pytest.approx(0.0, abs=0.35)
    gaps_s = np.diff(capture.scans.times_s)
    assert gaps_s.max() > 1.2 * gaps_s.min()


def test_the_stand_off_is_where_the_probe_really_is(pressed):
    """What presses is what the echoes see: stiffness times true depth is the force."""
    session, rig = pressed
    capture, track = session.captures.scan, session.captures.scan.forces
    true = true_probe_poses(capture, Truth(rig.scene))
    T_skull_base = rig.scene.T_base_skull.inv()
    axes = true.rotations[:, :, 2]
    starts = T_skull_base @ (true.translations - 30.0 * axes)
    depth_mm = 30.0 - rig.scene.specimen.ray(starts, T_skull_base.rotate(axes))
    force_n = np.interp(capture.scans.times_s, track.times_s, track.force_n)
    assert np.std(force_n - 2.0 * depth_mm) < 0.1
    assert abs(np.mean(force_n - 2.0 * depth_mm)) < 0.05


def test_the_delay_of_the_joint_angles_is_found(pressed):
    session, _ = pressed
    delay = DELAY.read(session)
    assert delay.delay_s == pytest.approx(0.008, abs=0.0008)
    assert delay.sigma_s < 0.0005
    found = POSES.read(session).translations
    capture = session.captures.scan
    model = robot_model(session.setup.devices.robot.model)
    face = Pose.from_translation((0.0, 0.0, KNOWN_MOUNTING.read(session).offset_mm))
    back = watch_head(session, capture).back(capture.scans.times_s)

    def faces(late_s):
        poses = model.forward(capture.joints.at(capture.scans.times_s + late_s))
        return (back @ poses @ (model.T_flange_probe @ face)).translations

    exact, late = faces(0.008), faces(0.0)
    assert np.linalg.norm(found - exact, axis=1).max() < 0.02
    assert np.linalg.norm(late - exact, axis=1).max() > 0.13  # 8 ms at 20 mm/s


def test_the_same_seed_gives_the_same_scan_bit_by_bit_and_a_file_keeps_it(pressed):
    session, _ = pressed
    again, _, _ = scan(session)
    assert digest(again) == digest(session.captures.scan)
    arrays = {}
    plain = encode(again, "scan", arrays)
    assert digest(decode(plain, ScanCapture, arrays)) == digest(again)


class Pit:
    """A specimen whose surface drops away by 20 mm on one side of the region."""

    def __init__(self, specimen):
        self._specimen = specimen
        center, normal = specimen.region.center_skull, specimen.region.normal_skull
        side = np.cross(normal, (1.0, 0.0, 0.0))
        self._center, self._side = center, side / np.linalg.norm(side)

    def __getattr__(self, name):
        return getattr(self._specimen, name)

    def ray(self, origins_skull, directions_skull):
        depth = self._specimen.ray(origins_skull, directions_skull)
        met = origins_skull + depth[:, None] * directions_skull
        return depth + 20.0 * ((met - self._center) @ self._side > 0.0)


def test_lost_contact_stops_the_scan_and_says_so():
    session = session_with(contact=ContactSettings(), latency_ms=8.0)
    setup = session.setup
    pit = Pit(build_specimen(setup.specimen, setup.seed))
    capture, rig, tools = scan(session, pit)
    assert capture.partial
    assert "no surface was met" in capture.forces.reason
    assert capture.forces.states[-1] == STOPPED
    assert capture.forces.travel_mm[-1] < capture.forces.travel_mm.max()  # it was drawn back
    planned_mm = session.results.roll.value.trajectory.path_mm[-1]
    assert capture.forces.way_mm[-1] < planned_mm
    drive_to(robot_model("rx90").home_rad, session, tools)  # and may be driven on
    np.testing.assert_allclose(rig.robot.state().q_rad, robot_model("rx90").home_rad, atol=1e-6)


def test_cancel_ends_it_and_keeps_what_came():
    session = session_with(contact=ContactSettings(), latency_ms=8.0)
    asked = [0]

    def cancel():
        asked[0] += 1
        return asked[0] > 1500

    capture, rig, _ = scan(session, cancel=cancel)
    assert capture.partial
    assert 0 < len(capture.scans) < 90
    assert not rig.robot.state().moving


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (0, "on its way to the start.*earlier is kept"),
        (1, "tool was weighed.*earlier scan is kept"),
    ],
)
def test_cancel_while_the_tool_is_weighed_records_nothing_and_says_so(asked, words):
    questions = count()
    with pytest.raises(CancelledError, match=words):
        scan(session_with(contact=ContactSettings()), cancel=lambda: next(questions) >= asked)


def test_a_scan_by_position_that_is_stopped_on_its_way_to_the_bone_records_nothing(monkeypatch):
    arrived = [False]
    genuine = scan_capture.drive_to

    def drive_to_start(*args):
        genuine(*args)
        arrived[0] = True

    monkeypatch.setattr(scan_capture, "drive_to", drive_to_start)
    with pytest.raises(CancelledError, match="nothing was recorded"):
        scan(session_with(contact=None), cancel=lambda: arrived[0])


def test_after_a_stop_on_the_bone_the_probe_is_drawn_back_first():
    session = session_with(contact=ContactSettings(), latency_ms=8.0)
    asked = [0]

    def cancel():
        asked[0] += 1
        return asked[0] == 1500

    capture, rig, tools = scan(session, cancel=cancel)
    assert 0 < len(capture.scans) < 90
    model = robot_model("rx90")
    stopped = rig.robot.q_at(np.inf)
    sent = []

    class Watched:
        def __getattr__(self, name):
            return getattr(rig.robot, name)

        def move(self, times_s, qs_rad):
            sent.append(np.array(qs_rad))
            return rig.robot.move(times_s, qs_rad)

    class Rig:
        robot = Watched()

        def __getattr__(self, name):
            return getattr(rig, name)

    drive_to(model.home_rad, session, replace(tools, devices=Rig))
    np.testing.assert_allclose(rig.robot.state().q_rad, model.home_rad, atol=1e-6)
    np.testing.assert_allclose(sent[0][0], stopped, atol=1e-9)
    probes = model.forward(sent[0]) @ model.T_flange_probe
    way, axis = probes.translations - probes.translations[0], probes.rotations[0, :, 2]
    np.testing.assert_allclose(way, np.outer(way @ axis, axis), atol=0.02)
    assert way[-1] @ axis == pytest.approx(-30.0, abs=1e-6)
    around = session_obstacles(session).without_touch()
    assert CollisionWorld(model, around).clear(np.concatenate(sent[1:])).all()


def test_without_contact_position_alone_drives_as_before():
    session = session_with(contact=None, latency_ms=8.0)
    capture, _, _ = scan(session)
    trajectory = session.results.roll.value.trajectory
    assert capture.forces is None
    assert not capture.partial
    assert contact_figures(capture) == {}
    assert len(capture.scans) == pytest.approx(trajectory.path_mm[-1] / 5.0, abs=1.0)
    late = capture.joints.at(capture.scans.times_s + 0.008)
    wanted = np.stack(
        [np.interp(capture.scans.times_s, trajectory.times_s, q) for q in trajectory.qs_rad.T], 1
    )
    assert np.abs(late - wanted).max() < 2e-4
    session = replace(session, captures=replace(session.captures, scan=capture))
    assert DELAY.read(session).delay_s == pytest.approx(0.008, abs=0.001)
