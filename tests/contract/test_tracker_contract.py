"""What every tracker keeps to, whatever is behind it."""

import dataclasses
from itertools import islice
from typing import get_args

import numpy as np
import pytest

from rona_core.devices.files.poses.sequences import read_igs_mha, write_igs_mha
from rona_core.devices.recording import Recording, ReplayTracker
from rona_core.devices.samples import WITH_POSE, ToolStatus
from rona_core.devices.settings import TOOLS, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DeviceError
from rona_core.geometry.pose import Pose
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.tracker.tracker import VirtualTracker
from tests.helpers.sphere_world import ScriptedWorld

FACING = Pose(np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, 1900.0)))


def moving(tool, time_s):
    """Two tools before the camera, one of them leaving and coming back; the third is not there."""
    if tool == "pointer5d":
        return None
    away = 900.0 if tool == "pointer6d" and int(time_s * 10) % 3 == 1 else 0.0
    return Pose.from_translation((10.0 * np.sin(time_s) + away, 0.0, 0.0)) @ FACING


def virtual(profile, **faults):
    def build():
        clock = CaptureClock()
        tracker = VirtualTracker(clock, ScriptedWorld(moving), 11)
        tracker.begin(TrackerSettings(profile=profile, **faults), 1)
        return tracker

    return build


def replayed():
    """A recording of the virtual tracker, through a file."""
    frames = list(islice(virtual("polaris")().frames(), 90))
    recording = read_igs_mha(write_igs_mha(Recording.from_frames(frames)))
    return ReplayTracker(recording, CaptureClock())


IMPLEMENTATIONS = {
    "virtual-ideal": virtual("ideal"),
    "virtual-polaris": virtual("polaris"),
    "virtual-white035": virtual("white035"),
    "virtual-spectra": virtual("spectra"),
    "virtual-vega": virtual("vega"),
    "virtual-faulty": virtual(
        "polaris",
        phantom_share=0.2,
        latency_ms=40.0,
        drift_mm=1.0,
        minutes_on=0.0,
        dropped_share=0.3,
    ),
    "replay": replayed,
}


@pytest.fixture(params=IMPLEMENTATIONS.values(), ids=IMPLEMENTATIONS.keys())
def tracker(request):
    device = request.param()
    yield device
    device.close()


def test_frame_numbers_and_times_only_grow(tracker):
    frames = list(islice(tracker.frames(), 60))
    assert (np.diff([frame.number for frame in frames]) > 0).all()
    assert (np.diff([frame.time_s for frame in frames]) > 0).all()


def test_what_is_not_seen_is_none_and_what_is_seen_is_rigid(tracker):
    seen = {tool: 0 for tool in TOOLS}
    for frame in islice(tracker.frames(), 60):
        for sample in frame.tools:
            assert sample.status in get_args(ToolStatus)
            if sample.status not in WITH_POSE:
                assert sample.T_tracker_marker is None
                assert sample.rms_error_mm is None
                continue
            seen[sample.tool] += 1
            rotation = sample.T_tracker_marker.rotation
            np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(rotation) == pytest.approx(1.0)
            assert np.isfinite(sample.T_tracker_marker.translation).all()
            assert sample.rms_error_mm >= 0.0
    assert seen["toolmarker"] == 60
    assert 20 < seen["pointer6d"] < 60
    assert seen["pointer5d"] == 0


def test_every_frame_tells_of_tools_it_knows_and_of_no_others(tracker):
    frame = tracker.latest()
    assert [sample.tool for sample in frame.tools] == list(GEOMETRIES)
    assert frame.tool("nothing of that name") is None


def test_samples_cannot_be_changed(tracker):
    frame = tracker.latest()
    with pytest.raises(dataclasses.FrozenInstanceError):
        frame.number = 7
    with pytest.raises(dataclasses.FrozenInstanceError):
        frame.tools[0].status = "covered"
    with pytest.raises(ValueError, match="read-only"):
        frame.tools[0].T_tracker_marker.translation[0] = 1.0


def test_latest_does_not_wait_and_does_not_change_what_comes(tracker):
    again = tracker.latest(), tracker.latest()
    assert again[0].number == again[1].number
    np.testing.assert_array_equal(
        again[0].tools[0].T_tracker_marker.matrix(), again[1].tools[0].T_tracker_marker.matrix()
    )


def test_closing_twice_is_safe_and_ends_the_frames(tracker):
    frames = tracker.frames()
    next(frames)
    tracker.close()
    tracker.close()
    assert next(frames, None) is None


def test_past_frames_are_those_that_came_only_fewer(tracker):
    """Law: looked at later and thinned out, a frame is what it was to the last bit."""
    frames = list(islice(tracker.frames(), 60))
    now_s = frames[-1].time_s
    clock = tracker._clock
    assert abs(clock.now() - now_s) < 1e-6
    past = tracker.past(0.2, 10.0)
    assert 0.6 <= len(past) / ((now_s - 0.2) * 10.0 + 1.0) <= 1.0 + 1e-9
    known = {frame.number: frame for frame in frames}
    for frame in past:
        assert frame.time_s >= 0.2 - 1e-9
        for ours, theirs in zip(frame.tools, known[frame.number].tools, strict=True):
            assert (ours.tool, ours.status) == (theirs.tool, theirs.status)
            assert ours.rms_error_mm == theirs.rms_error_mm
            if ours.T_tracker_marker is not None:
                np.testing.assert_array_equal(
                    ours.T_tracker_marker.matrix(), theirs.T_tracker_marker.matrix()
                )
    assert clock.now() == pytest.approx(now_s)
    tracker.close()
    with pytest.raises(DeviceError, match="closed"):
        tracker.past(0.0, 10.0)
