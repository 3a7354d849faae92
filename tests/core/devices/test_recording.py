"""Recordings by column: nothing is lost on the way in and out, and faults are named."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.recording import Recording, ReplayTracker
from rona_core.devices.samples import ToolSample, ToolTrack, TrackerFrame
from rona_core.errors import DeviceError, InvalidInputError, NotFoundError
from rona_core.virtual.clock import CaptureClock
from tests.helpers.recordings import frames_like, same_frames
from tests.helpers.strategies import seeds


@settings(max_examples=30)
@given(seed=seeds, n=st.integers(1, 30))
def test_frames_come_out_as_they_went_in(seed, n):
    frames = frames_like(seed, n)
    recording = Recording.from_frames(frames)
    assert same_frames(list(recording.frames()), frames)
    for name in ("pointer6d", "Stylus"):
        mine, theirs = recording.track(name), ToolTrack.from_frames(name, frames)
        for field in ("frame_numbers", "times_s", "rms_error_mm"):
            np.testing.assert_array_equal(getattr(mine, field), getattr(theirs, field))
        assert mine.n_frames == theirs.n_frames
        np.testing.assert_array_equal(
            mine.Ts_tracker_marker.rotations, theirs.Ts_tracker_marker.rotations
        )


def test_a_stored_capture_gives_the_same_track_again():
    track = ToolTrack.from_frames("pointer6d", frames_like(4, 40))
    recording = Recording.from_track(track)
    again = recording.track("pointer6d")
    assert (again.n_frames, len(recording)) == (40, len(track.times_s))
    np.testing.assert_array_equal(again.times_s, track.times_s)
    np.testing.assert_array_equal(again.frame_numbers, track.frame_numbers)
    np.testing.assert_array_equal(again.rms_error_mm, track.rms_error_mm)
    assert again.Ts_tracker_marker is track.Ts_tracker_marker


def test_one_tool_alone():
    recording = Recording.from_frames(frames_like(1, 5))
    alone = recording.only("Stylus")
    assert [len(frame.tools) for frame in alone.frames()] == [1] * 5
    with pytest.raises(NotFoundError, match="its tools are pointer6d, Stylus"):
        recording.track("pointer5d")


def with_frame(frames, k, **parts):
    return [*frames[:k], dataclasses.replace(frames[k], **parts), *frames[k + 1 :]]


def test_faults_of_a_stream_are_named():
    frames = frames_like(2, 6)
    for bad, words in (
        ([], "at least one frame"),
        (with_frame(frames, 3, number=frames[2].number), "number of frame 3"),
        (with_frame(frames, 4, time_s=0.0), "time of frame 4"),
        (with_frame(frames, 2, tools=frames[2].tools[:1]), "has pointer6d, the first one of"),
        ([TrackerFrame(0, 0.0, (ToolSample("a", "ok"),))], "status 'ok' and no pose in frame 0"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            Recording.from_frames(bad)
    unseen = ToolTrack.from_frames("pointer5d", frames)
    with pytest.raises(InvalidInputError, match="seen in no frame"):
        Recording.from_track(unseen)


# -- replay ----------------------------------------------------------------------------------------


def test_a_replay_plays_every_frame_at_its_time_and_ends():
    frames = frames_like(5, 25, start_s=280.5)
    clock = CaptureClock()
    tracker = ReplayTracker(Recording.from_frames(frames), clock)
    assert tracker.origin == "REPLAY"
    played = []
    for frame in tracker.frames():
        assert clock.now() == frame.time_s
        played.append(frame)
    shifted = [dataclasses.replace(f, time_s=f.time_s - frames[0].time_s) for f in frames]
    assert same_frames(played, shifted)
    assert tracker.duration_s == shifted[-1].time_s
    assert tracker.latest().number == frames[-1].number
    tracker.close()
    with pytest.raises(DeviceError, match="closed"):
        tracker.latest()


def test_latest_follows_the_clock():
    frames = frames_like(6, 30)
    clock = CaptureClock()
    tracker = ReplayTracker(Recording.from_frames(frames), clock)
    start_s = frames[0].time_s
    for k in (0, 7, 8, 29):
        clock.wait_until(frames[k].time_s - start_s + 1e-6)
        assert tracker.latest().number == frames[k].number
