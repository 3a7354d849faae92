"""The tracker between captures: where a hand put a pointer, seen with the noise of the settings."""

import numpy as np
import pytest

from rona_core.devices.live import live_tracker_of
from rona_core.devices.settings import DeviceSettings, TrackerSettings
from rona_core.errors import DeviceError, NotFoundError
from rona_core.geometry.pose import Pose
from rona_core.virtual.tracker.live_tracker import VirtualLiveTracker

FACING = Pose.from_rotvec((np.pi, 0.0, 0.0), (20.0, 10.0, 1800.0))


class Wall:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def wall():
    return Wall()


@pytest.fixture
def tracker(wall):
    return VirtualLiveTracker(3, lambda: FACING, wall=wall)


def status(frame):
    return {sample.tool: sample.status for sample in frame.tools}


def test_frames_follow_real_time(tracker, wall):
    settings = TrackerSettings(rate_hz=20.0)
    assert tracker.frame(settings).number == 0
    wall.now += 1.01
    frame = tracker.frame(settings)
    assert (frame.number, frame.time_s) == (20, 1.0)
    assert tracker.frame(settings).number == 20


def test_a_frame_depends_on_seed_and_number_only(tracker, wall):
    settings = TrackerSettings()
    tracker.place("pointer6d", FACING)
    first = tracker.frame(settings)
    again = tracker.frame(settings)
    wall.now += 1.0
    later = tracker.frame(settings)

    def position(frame):
        return frame.tool("pointer6d").T_tracker_marker.translation

    np.testing.assert_array_equal(position(first), position(again))
    assert np.linalg.norm(position(first) - position(later)) > 0.0


def test_noise_has_the_size_of_the_profile(tracker, wall):
    tracker.place("pointer6d", FACING)
    errors = []
    for _ in range(200):
        wall.now += 0.1
        sample = tracker.frame(TrackerSettings("white035")).tool("pointer6d")
        errors.append(sample.T_tracker_marker.translation - FACING.translation)
    rms = np.sqrt((np.array(errors) ** 2).sum(axis=1).mean())
    assert 0.1 < rms < 0.7  # 0.35 mm at each marker; the origin is one of four
    exact = tracker.frame(TrackerSettings("ideal")).tool("pointer6d").T_tracker_marker
    np.testing.assert_allclose(exact.matrix(), FACING.matrix(), atol=1e-9)


def test_what_is_not_there_or_covered_has_no_pose(tracker):
    assert status(tracker.frame(TrackerSettings())) == {
        "toolmarker": "ok",
        "pointer6d": "out_of_view",
        "pointer5d": "out_of_view",
        "basemarker": "out_of_view",
        "sonopointer": "out_of_view",
        "headmarker": "out_of_view",
    }
    tracker.place("pointer6d", FACING)
    hidden = TrackerSettings(hidden_tools=("pointer6d", "toolmarker"))
    frame = tracker.frame(hidden)
    assert status(frame)["pointer6d"] == status(frame)["toolmarker"] == "covered"
    assert frame.tool("pointer6d").T_tracker_marker is None
    tracker.place("pointer6d", None)
    tracker.place("pointer6d", None)
    assert status(tracker.frame(TrackerSettings()))["pointer6d"] == "out_of_view"


def test_a_pointer_turned_away_is_not_seen(tracker):
    tracker.place("pointer6d", Pose.from_translation(FACING.translation))
    assert status(tracker.frame(TrackerSettings()))["pointer6d"] == "out_of_view"


def test_tools_that_cannot_be_placed(tracker):
    with pytest.raises(DeviceError, match="robot"):
        tracker.place("toolmarker", FACING)
    with pytest.raises(DeviceError, match="base"):
        tracker.place("basemarker", FACING)
    with pytest.raises(NotFoundError, match="spoon"):
        tracker.place("spoon", FACING)


def test_the_virtual_rig_has_a_live_tracker_that_follows_the_robot():
    from rona_core.compose import build_virtual_rig
    from rona_core.session.document import Setup

    rig = build_virtual_rig(Setup())
    live = live_tracker_of(rig)
    ideal = TrackerSettings("ideal")
    before = live.frame(ideal).tool("toolmarker").T_tracker_marker
    q_rad = np.array(rig.robot.state().q_rad)
    q_rad[0] += 0.05
    rig.begin(DeviceSettings(), 0)
    rig.robot.place(q_rad)
    after = live.frame(ideal).tool("toolmarker").T_tracker_marker
    moved_mm = np.linalg.norm(after.translation - before.translation)
    assert 10.0 < moved_mm < 60.0  # 0.05 rad at 0.6 m
    rig.close()


def test_a_rig_without_one_has_none():
    assert live_tracker_of(object()) is None
