"""Rigid poses, fits of simple shapes, and the 5D path: the words the other packages share."""

from rona_core.geometry.frame_graph import FrameGraph
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.rigid_fit import register_points

__all__ = [
    "FrameGraph",
    "Path5D",
    "Pose",
    "Poses",
    "register_points",
]
