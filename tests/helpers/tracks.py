"""Tracks of which some frames are left."""

from dataclasses import replace

from rona_core.devices.samples import ToolTrack
from rona_core.geometry.arrays import Bools, Ints


def track_rows(track: ToolTrack, rows: Bools | Ints) -> ToolTrack:
    """Return a track with these of its rows (k,) alone, as if the others had not been seen."""
    return replace(
        track,
        frame_numbers=track.frame_numbers[rows],
        times_s=track.times_s[rows],
        Ts_tracker_marker=track.Ts_tracker_marker.select(rows),
        rms_error_mm=track.rms_error_mm[rows],
    )
