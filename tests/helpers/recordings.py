"""Streams of a tracker for tests: seen and unseen tools, uneven times, all digits in use."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.devices.samples import ToolSample, ToolTrack, TrackerFrame
from rona_core.geometry.arrays import Bools, Ints
from rona_core.geometry.pose import Pose

HIDDEN = ("out_of_volume", "out_of_view", "too_few_markers", "covered")


def frames_like(seed, n, tools=("pointer6d", "Stylus"), start_s=0.25):
    """Return n frames of tools that come and go; the first tool is seen in the first frame."""
    rng = np.random.default_rng(seed)
    numbers = np.cumsum(rng.integers(1, 4, n))
    times = start_s + np.cumsum(rng.uniform(0.01, 0.05, n))
    frames = []
    for i in range(n):
        samples = []
        for k, tool in enumerate(tools):
            if rng.random() < 0.3 and not (i == 0 and k == 0):
                samples.append(ToolSample(tool, str(rng.choice(HIDDEN))))
                continue
            pose = Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(0.0, 700.0, 3))
            known = rng.random() < 0.8
            samples.append(ToolSample(tool, "ok", pose, float(rng.random()) if known else None))
        frames.append(TrackerFrame(int(numbers[i]), float(times[i]), tuple(samples)))
    return frames


def same_frames(a, b):
    """Return whether two streams agree in every bit."""
    if len(a) != len(b):
        return False
    for one, other in zip(a, b, strict=True):
        if (one.number, one.time_s) != (other.number, other.time_s):
            return False
        for s, t in zip(one.tools, other.tools, strict=True):
            if (s.tool, s.status, s.rms_error_mm) != (t.tool, t.status, t.rms_error_mm):
                return False
            if (s.T_tracker_marker is None) != (t.T_tracker_marker is None):
                return False
            if s.T_tracker_marker is not None and (
                s.T_tracker_marker.matrix().tobytes() != t.T_tracker_marker.matrix().tobytes()
            ):
                return False
    return True


def track_rows(track: ToolTrack, rows: Bools | Ints) -> ToolTrack:
    """Return a track with these of its rows (k,) alone, as if the others had not been seen."""
    return replace(
        track,
        frame_numbers=track.frame_numbers[rows],
        times_s=track.times_s[rows],
        Ts_tracker_marker=track.Ts_tracker_marker.select(rows),
        rms_error_mm=track.rms_error_mm[rows],
    )
