"""Maps of a dome that are known in closed form, leaning in base, with a hole."""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.files.map_sheet import MapSheet, SigmaOverGrid

T_BASE_MAP = Pose.from_rotvec((0.4, -0.7, 1.9), (612.3, -48.1, 255.5))
RADIUS_MM = 80.0
THICKNESS_MM = 6.0
CELL_U_MM, CELL_V_MM = 1.0, 1.25


def dome_sheet(*, hole: bool = True) -> MapSheet:
    """Return maps of 21 by 17 cells; the fused one is a cell wider, the inner one has a hole."""
    u = np.asarray(CELL_U_MM * np.arange(-10, 11), dtype=np.float64)
    v = np.asarray(CELL_V_MM * np.arange(-8, 9), dtype=np.float64)
    u_mm, v_mm = np.meshgrid(u, v, indexing="ij")
    height = RADIUS_MM * (np.sqrt(1.0 - (u_mm**2 + v_mm**2) / RADIUS_MM**2) - 1.0)
    ok = np.ones(height.shape, dtype=bool)
    inside = ok.copy()
    inside[[0, -1], :], inside[:, [0, -1]] = False, False
    inner_ok = inside.copy()
    if hole:
        inner_ok[8:12, 6:10] = False
    depth = THICKNESS_MM + 0.05 * u_mm

    def boundary(heights: Floats, known: Bools) -> BoundaryMap:
        return BoundaryMap(T_BASE_MAP, u, v, heights, known)

    maps = Maps(
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros(0, dtype=bool),
        np.zeros(0, dtype=bool),
        boundary(height, inside),
        boundary(height - depth, inner_ok),
        boundary(height, ok),
        None,
    )
    own = 0.03 + 0.001 * np.hypot(u_mm, v_mm)
    sigmas = {
        name: SigmaOverGrid(k * own, np.full(own.shape, k * 0.04))
        for k, name in enumerate(("outer", "inner", "fused", "thickness"), 1)
    }
    return MapSheet(maps, sigmas)
