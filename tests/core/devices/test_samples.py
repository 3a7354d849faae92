import numpy as np
import pytest

from rona_core.devices.samples import (
    AScan,
    AScanTrack,
    JointSample,
    JointTrack,
    LateSamples,
    ToolColumn,
    ToolSample,
    ToolTrack,
    TrackerFrame,
)
from rona_core.geometry.pose import Pose, Poses
from tests.helpers.strategies import random_pose


def frames():
    rng = np.random.default_rng(0)
    seen = [random_pose(rng) if number not in (2, 5) else None for number in range(8)]
    return seen, [
        TrackerFrame(
            number,
            number / 60,
            (
                ToolSample("other", "ok", Pose.identity(), 0.1),
                ToolSample("pointer6d", "ok" if pose else "covered", pose, 0.01 * number),
            ),
        )
        for number, pose in enumerate(seen)
    ]


def test_a_track_holds_the_frames_in_which_its_tool_was_seen():
    seen, all_frames = frames()
    track = ToolTrack.from_frames("pointer6d", all_frames)
    np.testing.assert_array_equal(track.frame_numbers, [0, 1, 3, 4, 6, 7])
    np.testing.assert_allclose(track.times_s, np.array([0, 1, 3, 4, 6, 7]) / 60)
    np.testing.assert_allclose(track.rms_error_mm, [0, 0.01, 0.03, 0.04, 0.06, 0.07])
    expected = [pose for pose in seen if pose is not None]
    for found, pose in zip(track.Ts_tracker_marker, expected, strict=True):
        np.testing.assert_array_equal(found.matrix(), pose.matrix())
    assert track.n_frames == 8
    with pytest.raises(ValueError, match="read-only"):
        track.times_s[0] = 1.0


def test_a_tool_that_was_never_seen_gives_an_empty_track():
    track = ToolTrack.from_frames("toolmarker", frames()[1])
    assert (len(track.Ts_tracker_marker), len(track.times_s), track.n_frames) == (0, 0, 8)
    assert frames()[1][0].tool("toolmarker") is None


def test_what_is_not_known_of_a_fit_stays_unknown_in_a_frame():
    sample = ToolSample("pointer6d", "ok", Pose.identity())
    frame = TrackerFrame(0, 0.0, (sample,))
    assert frame.tool("pointer6d") is sample
    assert ToolTrack.from_frames("pointer6d", [frame]).rms_error_mm.tolist() == [0.0]


def test_late_samples_are_a_sequence_and_only_what_is_asked_for_is_worked_out():
    asked = []

    def column(tool):
        def samples():
            asked.append(tool)
            poses, seen = Poses.stack([Pose.identity()] * 3), np.array([True, False, True])
            return ToolColumn(tool, ["ok", "missing", "ok"], seen, poses, 0.1 * np.arange(3.0))

        return samples

    late = LateSamples({tool: column(tool) for tool in ("a", "b", "c")}, row=2)
    assert (len(late), asked) == (3, [])
    assert late.column("b")[late.row].rms_error_mm == 0.2
    assert late.column("b")[1].T_tracker_marker is None
    assert (late.column("nobody"), asked) == (None, ["b", "b"])
    assert TrackerFrame(2, 0.1, late).tool("c").tool == "c"
    assert [one.tool for one in late] == ["a", "b", "c"]
    assert [one.tool for one in late[1:]] == ["b", "c"]
    assert late[-1].tool == "c"


def test_joints_are_interpolated_in_time():
    samples = [JointSample(float(t), np.arange(6.0) * t) for t in range(4)]
    track = JointTrack.from_samples(samples)
    np.testing.assert_allclose(track.at(np.array([0.5, 2.25])), np.outer((0.5, 2.25), range(6)))
    np.testing.assert_array_equal(track.at(track.times_s), track.qs_rad)
    assert JointTrack.from_samples([]).qs_rad.shape == (0, 6)


def test_scans_become_one_array():
    scans = [AScan(t / 10, np.full(50, t / 8), 50.0, 2.0, t == 1) for t in range(3)]
    track = AScanTrack.from_scans(scans)
    assert len(track) == 3
    assert track.rf.dtype == np.float32
    np.testing.assert_array_equal(track.rf, np.stack([scan.rf for scan in scans]))
    np.testing.assert_array_equal(track.clipped, [False, True, False])
    assert (track.sampling_mhz, track.start_us) == (50.0, 2.0)
