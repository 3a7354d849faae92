"""True tip of a pointer in each frame of a capture.

What the virtual tracker adds to the truth is known: its bias field, its drift, and noise that is a
pure function of seed, capture and frame. So the true pose behind a measured one can be solved for,
and no record of the hand's motion is needed. Which markers were seen follows from the RMS error
that the tracker reported.
"""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import TrackerSettings
from rona_core.devices.trackers import GEOMETRIES, MarkerGeometry
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.faults import drift_mm, swapped_markers
from rona_core.virtual.tracker.reporting_rules import MIN_MARKERS
from rona_core.virtual.tracker.tracker import ViewConditions, observe, white_numbers

ROUNDS = 4  # each makes the remaining error smaller by a factor of about 1000
SAME_RMS_MM = 1e-6  # reported and recomputed RMS errors that agree like this belong together


def true_markers(
    track: ToolTrack,
    rows: Ints,
    settings: TrackerSettings,
    seed: int,
    ordinal: int,
    share: float = 1.0,
) -> Poses:
    """Return the true ``Ts_tracker_marker`` (n,) behind some rows (n,) of a track of a capture.

    For a 5D tool the roll about its line stays arbitrary. A pose that no set of markers explains
    is returned as if all that can be seen had been. The tracker errs by ``share`` of what its maker
    states.
    """
    geometry, numbers = GEOMETRIES[track.tool], track.frame_numbers[rows]
    measured, rms_mm = track.Ts_tracker_marker.select(rows), track.rms_error_mm[rows]
    white = white_numbers(seed, "tracker", ordinal, numbers)[track.tool]
    drift = drift_mm(settings, seed, ordinal, numbers / settings.rate_hz)
    swapped = swapped_markers(settings, geometry, seed, ordinal, numbers)
    rotations, translations = measured.rotations.copy(), measured.translations.copy()
    unexplained = np.arange(len(numbers))
    for clear in _marker_sets(geometry):
        shape = (len(unexplained), len(geometry.positions_marker))
        conditions = ViewConditions(
            None if clear is None else np.ones(shape, dtype=np.bool_),
            None if clear is None else np.broadcast_to(clear, shape),
            drift[unexplained],
            None if swapped is None else swapped[unexplained],
            share,
        )
        target = measured.select(unexplained)
        poses, seen, found_mm = target, np.ones(len(target), dtype=np.bool_), np.zeros(len(target))
        for _ in range(ROUNDS):
            reports = observe(geometry, poses, white[unexplained], settings, seed, conditions)
            seen &= reports.seen  # not so at the very edge of what the tracker sees
            found_mm = reports.rms_error_mm
            corrected = (target @ reports.Ts_tracker_marker.inv()) @ poses
            poses = Poses(
                np.where(seen[:, None, None], corrected.rotations, poses.rotations),
                np.where(seen[:, None], corrected.translations, poses.translations),
            )
        explained = seen & (np.abs(found_mm - rms_mm[unexplained]) <= SAME_RMS_MM)
        taken = np.ones_like(seen) if clear is None else explained
        rotations[unexplained[taken]] = poses.rotations[taken]
        translations[unexplained[taken]] = poses.translations[taken]
        unexplained = unexplained[~explained]
        if not len(unexplained):
            break
    return Poses(rotations, translations)


def _marker_sets(geometry: MarkerGeometry) -> Iterator[Bools | None]:
    """Yield None for what can be seen as a rule, then sets of markers (m,), larger ones first."""
    yield None
    count = len(geometry.positions_marker)
    for size in range(count, MIN_MARKERS[geometry.dof] - 1, -1):
        for chosen in combinations(range(count), size):
            clear = np.zeros(count, dtype=np.bool_)
            clear[list(chosen)] = True
            yield clear


def true_tips_base(
    scene: VirtualScene,
    track: ToolTrack,
    ordinal: int,
    rows: Ints,
    T_base_tracker: Pose | None = None,
) -> Floats:
    """Return the true tip (n, 3) in ``base`` in some rows (n,) of a pointer's track.

    ``T_base_tracker`` says where the tracker stood; None: where it stands now.
    It is where the tip was when the frame was measured, which is earlier than it arrived.
    """
    settings, share = scene.settings.tracker, scene.world.tracker_share
    markers = true_markers(track, rows, settings, scene.seed, ordinal, share)
    stood = scene.T_base_tracker if T_base_tracker is None else T_base_tracker
    return stood @ (markers @ scene.tips[track.tool])
