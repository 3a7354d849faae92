"""Maps of the outer and inner boundary, and their fusion with the pointer cloud."""

from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.build_maps import build_maps
from rona_core.mapping.tilted_passes import tilted_paths

__all__ = [
    "BoundaryMap",
    "Maps",
    "build_maps",
    "tilted_paths",
]
