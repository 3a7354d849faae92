"""True tip of a pointer in each frame of a capture.

What the virtual tracker adds to the truth is known: its bias field, its drift, and noise that is a
pure function of seed, capture and frame. So the true pose behind a measured one can be solved for,
and no record of the hand's motion is needed. Which markers were seen follows from the RMS error
that the tracker reported.
"""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES, MarkerGeometry
from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import TrackerSettings
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.faults import drift_mm, swapped_markers
from rona_core.virtual.tracker.reporting_rules import MIN_MARKERS
from rona_core.virtual.tracker.tracker import ViewConditions, observe, white_numbers

ROUNDS = 4  # each makes the remaining error smaller by a factor of about 1000
SAME_RMS_MM = 1e-6  # reported and recomputed RMS errors that agree like this belong together


def true_marker(
    tool: str,
    measured: Pose,
    rms_error_mm: float,
    settings: TrackerSettings,
    seed: int,
    ordinal: int,
    frame: int,
) -> Pose:
    """Return the true ``T_tracker_marker`` behind a measured one, in one frame of a capture.

    For a 5D tool the roll about its line stays arbitrary. A pose that no set of markers explains
    is returned as if all that can be seen had been.
    """
    geometry = GEOMETRIES[tool]
    white = white_numbers(seed, ordinal, frame)[tool]
    drift = drift_mm(settings, seed, ordinal, frame / settings.rate_hz)
    swapped = swapped_markers(settings, geometry, seed, ordinal, frame)
    first: Pose | None = None
    for clear in _marker_sets(geometry):
        T_tracker_marker, rms = measured, None
        for _ in range(ROUNDS):
            seen = observe(
                geometry,
                T_tracker_marker,
                white,
                settings,
                seed,
                ViewConditions(
                    None if clear is None else np.ones(len(white), dtype=np.bool_),
                    clear,
                    drift,
                    swapped,
                ),
            ).fit
            if seen is None:  # at the very edge of what the tracker sees
                break
            rms = seen.rms_error_mm
            correction = measured @ seen.T_tracker_marker.inv()
            T_tracker_marker = correction @ T_tracker_marker
        if rms is not None and abs(rms - rms_error_mm) <= SAME_RMS_MM:
            return T_tracker_marker
        first = T_tracker_marker if first is None else first
    return measured if first is None else first


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
    settings, tip = scene.settings.tracker, scene.tips[track.tool]
    tips = np.zeros((len(rows), 3))
    for out, row in enumerate(rows):
        pose = true_marker(
            track.tool,
            track.Ts_tracker_marker[int(row)],
            float(track.rms_error_mm[row]),
            settings,
            scene.seed,
            ordinal,
            int(track.frame_numbers[row]),
        )
        tips[out] = pose @ tip
    return (scene.T_base_tracker if T_base_tracker is None else T_base_tracker) @ tips
