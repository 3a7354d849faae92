"""Surface point clouds, normals, ray casting and registration."""

from rona_core.surface.cloud import SurfaceCloud, build_cloud, merge_clouds
from rona_core.surface.icp import register_surface
from rona_core.surface.normals.normals import NormalField
from rona_core.surface.raycast import MeshRaycaster

__all__ = [
    "MeshRaycaster",
    "NormalField",
    "SurfaceCloud",
    "build_cloud",
    "merge_clouds",
    "register_surface",
]
