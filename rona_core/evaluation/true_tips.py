"""Where a pointer's tip really was in each frame of a capture.

What the virtual tracker adds to the truth is known: its bias field, and white noise that is a pure
function of seed, capture and frame. So the true pose behind a measured one can be solved for, and
no record of the hand's motion is needed.
"""

import numpy as np

from rona_core.arrays import Floats, Ints
from rona_core.devices.markers import GEOMETRIES
from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import TrackerProfile
from rona_core.geometry.pose import Pose
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker import observe, white_numbers

ROUNDS = 4  # each makes the remaining error smaller by a factor of about 1000


def true_marker(
    tool: str,
    measured: Pose,
    profile: TrackerProfile,
    seed: int,
    ordinal: int,
    frame: int,
) -> Pose:
    """Return the true ``T_tracker_marker`` behind a measured one, in one frame of a capture.

    For a 5D tool the roll about its line stays arbitrary.
    """
    white = white_numbers(seed, ordinal, frame)[tool]
    T_tracker_marker = measured
    for _ in range(ROUNDS):
        seen = observe(GEOMETRIES[tool], T_tracker_marker, white, profile, seed).fit
        if seen is None:  # at the very edge of what the tracker sees
            break
        correction = measured @ seen.T_tracker_marker.inv()
        T_tracker_marker = correction @ T_tracker_marker
    return T_tracker_marker


def true_tips_base(scene: VirtualScene, track: ToolTrack, ordinal: int, rows: Ints) -> Floats:
    """Return the true tip (n, 3) in ``base`` in some rows (n,) of a pointer's track."""
    profile, tip = scene.settings.tracker.profile, scene.tips[track.tool]
    tips = np.zeros((len(rows), 3))
    for out, row in enumerate(rows):
        seen = track.Ts_tracker_marker[int(row)]
        frame = int(track.frame_numbers[row])
        pose = true_marker(track.tool, seen, profile, scene.seed, ordinal, frame)
        tips[out] = pose @ tip
    return scene.T_base_tracker @ tips
