"""Maps of the outer and inner boundary, and their fusion with the pointer cloud."""

from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.build_maps import build_maps
from rona_core.mapping.second_pass import plan_second_pass

__all__ = [
    "BoundaryMap",
    "Maps",
    "build_maps",
    "plan_second_pass",
]
