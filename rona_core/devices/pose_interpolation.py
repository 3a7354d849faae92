"""Interpolation of a tracked pose between the frames of the tracker."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from rona_core.devices.samples import ToolTrack
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Poses

NEAR_S = 0.05  # an instant counts only if the tool was seen this shortly before and after it


@dataclass(frozen=True, slots=True, eq=False)
class InterpolatedPoses:
    """Poses of a tool at those of n instants at which it is known."""

    known: Bools  # (n,)
    Ts_tracker_marker: Poses  # one for each known instant


def interpolate_poses(
    track: ToolTrack, times_s: Floats, *, delay_s: float = 0.0
) -> InterpolatedPoses:
    """Return where a tool was at some instants.

    Between two frames the position runs straight and the rotation by the shortest way, evenly.

    Args:
        track: What the tracker delivered.
        times_s: Instants (n,), by the clock of the capture.
        delay_s: By how much later than it was measured each frame arrived.
    """
    measured_s, wanted = track.times_s - delay_s, np.asarray(times_s, dtype=np.float64)
    if len(measured_s) < 2:
        none = Poses(np.zeros((0, 3, 3)), np.zeros((0, 3)))
        return InterpolatedPoses(readonly(np.zeros(len(wanted), dtype=np.bool_)), none)
    after = np.clip(np.searchsorted(measured_s, wanted), 1, len(measured_s) - 1)
    before = after - 1
    slack = 1e-9
    known = (wanted >= measured_s[before] - slack) & (wanted <= measured_s[after] + slack)
    known &= (wanted - measured_s[before] <= NEAR_S) & (measured_s[after] - wanted <= NEAR_S)
    times = np.clip(wanted[known], measured_s[0], measured_s[-1])
    poses = track.Ts_tracker_marker
    turns = Slerp(measured_s, Rotation.from_matrix(poses.rotations))(times)
    places = np.stack([np.interp(times, measured_s, p) for p in poses.translations.T], axis=1)
    return InterpolatedPoses(readonly(known), Poses(turns.as_matrix().reshape(-1, 3, 3), places))
