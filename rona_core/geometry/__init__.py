"""Poses with covariance, frame graph, fits, robust statistics, meshes, surfaces, the 5D path."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_MODULES = {
    "FrameGraph": "frame_graph",
    "Path5D": "path5d",
    "Pose": "pose",
    "Poses": "pose",
    "register_points": "rigid_fit",
}


def __getattr__(name: str) -> Any:
    """Load on access: a program that only checks arrays starts without the rest."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
