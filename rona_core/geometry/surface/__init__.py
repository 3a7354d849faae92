"""Surface point clouds, their normals, and ray casting."""

from rona_core.geometry.surface.cloud import SurfaceCloud, build_cloud, merge_clouds
from rona_core.geometry.surface.normals.normals import NormalField
from rona_core.geometry.surface.raycast import MeshRaycaster

__all__ = [
    "MeshRaycaster",
    "NormalField",
    "SurfaceCloud",
    "build_cloud",
    "merge_clouds",
]
