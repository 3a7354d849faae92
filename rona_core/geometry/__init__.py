"""Poses with covariance, frame graph, least-squares fits, robust statistics and the 5D path."""

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
