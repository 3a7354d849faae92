"""Grid of cells that the maps of all boundaries share."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.fitting.plate_field import PlateField

NEAR_MM = 2.5  # a cell is mapped if a sample lies this close


class MapGrid:
    """The cells that all maps share."""

    def __init__(self, T_base_map: Pose, points_map: Floats, cell_mm: float) -> None:
        low = np.floor(points_map[:, :2].min(axis=0) / cell_mm) * cell_mm
        high = np.ceil(points_map[:, :2].max(axis=0) / cell_mm) * cell_mm
        self.T_base_map = T_base_map
        self.cell_mm = cell_mm
        self.u_mm, self.v_mm = (
            np.arange(low[k], high[k] + 0.5 * cell_mm, cell_mm) for k in range(2)
        )
        u, v = np.meshgrid(self.u_mm, self.v_mm, indexing="ij")
        self.places = np.column_stack((u.ravel(), v.ravel()))
        self.shape = u.shape

    def near(self, points_map: Floats) -> Bools:
        """Return which cells (nu, nv) have one of the points (n, 3) close by."""
        if not len(points_map):
            return np.zeros(self.shape, dtype=np.bool_)
        distance = KDTree(points_map[:, :2]).query(self.places)[0]
        return (distance <= NEAR_MM).reshape(self.shape)

    def boundary(self, plate: PlateField, ok: Bools) -> BoundaryMap:
        """Return a map with the heights of the plate."""
        return self.with_heights(plate.heights(self.places).reshape(self.shape), ok)

    def with_heights(self, heights: Floats, ok: Bools) -> BoundaryMap:
        """Return a map with these heights (nu, nv)."""
        return BoundaryMap(
            T_base_map=self.T_base_map,
            u_mm=readonly(self.u_mm),
            v_mm=readonly(self.v_mm),
            height_mm=readonly(np.ascontiguousarray(heights)),
            ok=readonly(np.ascontiguousarray(ok)),
        )
