"""A world for the virtual tracker, made of a function from tool and time to a pose."""

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.geometry.pose import Poses


class ScriptedWorld:
    """Tools that move as ``true_pose(tool, time_s)`` says; None for a tool that is not there.

    ``clear(tool, T_tracker_marker, time_s)`` says which markers (m,) nothing hides; None: all.
    Without ``foreseen`` the motion answers to what happens: frames are measured one by one.
    """

    def __init__(self, true_pose, clear=None, *, foreseen=True):
        self.true_pose, self.hidden_by, self.foreseen = true_pose, clear, foreseen
        self.changes = 0  # to be raised when the motion becomes another

    def Ts_tracker_marker(self, tool, times_s):  # noqa: N802
        poses = [self.true_pose(tool, float(time_s)) for time_s in times_s]
        return None if poses[0] is None else Poses.stack(poses)

    def clear(self, tool, Ts_tracker_marker, times_s):
        if self.hidden_by is None:
            markers = len(GEOMETRIES[tool].positions_marker)
            return np.ones((len(times_s), markers), dtype=bool)
        looks = zip(Ts_tracker_marker, times_s, strict=True)
        return np.stack([self.hidden_by(tool, pose, float(time_s)) for pose, time_s in looks])

    def motion_key(self):
        return self.changes if self.foreseen else None
