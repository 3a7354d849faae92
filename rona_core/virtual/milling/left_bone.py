"""What is left of the true bone under a burr: a height field over its layers."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.virtual.specimen.boundaries import Specimen

CELL_MM = 0.2
AT_ONCE = 2048  # rays that are traced at a time: those of a whole bed take much memory
ABOVE_MM = 20.0  # above z = 0 of the bed, where rays at the bone start


class LeftBone:
    """Heights over a grid in ``bed``, the frame as it lies on the true bone.

    Attributes:
        x_mm: Cell centres (nx,).
        y_mm: Cell centres (ny,).
        top_mm: What is left reaches up to here (nx, ny).
        bounds_mm: Lower ends (3, nx, ny) of outer table, diploe and inner table.
    """

    def __init__(self, specimen: Specimen, T_skull_bed: Pose, half_mm: float) -> None:
        """Look at a bone that nothing was taken from, so far to all sides of the bed's middle."""
        count = int(np.ceil(half_mm / CELL_MM))
        self.x_mm = self.y_mm = CELL_MM * np.arange(-count, count + 1.0)
        x, y = np.meshgrid(self.x_mm, self.y_mm, indexing="ij")
        starts = T_skull_bed @ np.column_stack((x.ravel(), y.ravel(), np.full(x.size, ABOVE_MM)))
        down = T_skull_bed.rotate(np.tile((0.0, 0.0, -1.0), (x.size, 1)))
        blocks = [slice(start, start + AT_ONCE) for start in range(0, x.size, AT_ONCE)]
        found = np.concatenate([specimen.layers(starts[some], down[some]) for some in blocks])
        # where a ray misses a boundary there is no bone: nothing to cut, nothing to break through
        heights = np.where(np.isfinite(found), ABOVE_MM - found, -np.inf).T.reshape(4, *x.shape)
        self.top_mm: Floats = heights[0].copy()
        self.bounds_mm: Floats = heights[1:].copy()
        inner = heights[3].ravel()
        known = np.isfinite(inner)
        self._inner = KDTree(np.column_stack((x.ravel(), y.ravel(), inner))[known])

    def cut(self, center_bed: Floats, radius_mm: float) -> Floats:
        """Take away what a ball reaches; return how much of each layer (4,) in mm3, dura last."""
        cells = self._cells(center_bed[None], np.array((radius_mm,)))[0]
        old, bounds = self.top_mm[cells], self.bounds_mm[:, *cells]
        new = np.minimum(old, self._reached(cells, center_bed, radius_mm))
        if not old.size or (old - new).max() <= 0.0:
            return np.zeros(4)
        known = np.maximum(bounds, -1e3)
        above = (np.maximum(old, known) - np.maximum(new, known)).sum(axis=(1, 2))
        total = float((np.maximum(old, -1e3) - np.maximum(new, -1e3)).sum())
        self.top_mm[cells] = new
        return CELL_MM**2 * np.diff((0.0, *above, total))

    def cut_along(self, centers_bed: Floats, radii_mm: Floats) -> None:
        """Take away what a ball (n, 3) reaches on its way, as ``cut`` does."""
        for row, cells in enumerate(self._cells(centers_bed, radii_mm)):
            lowest = self._reached(cells, centers_bed[row], float(radii_mm[row]))
            np.minimum(self.top_mm[cells], lowest, out=self.top_mm[cells])

    def distances_to_inner_mm(self, centers_bed: Floats, radii_mm: Floats) -> Floats:
        """Return the distances (n,) from balls (n, 3) to the inner boundary; negative: through.

        To the nearest of its places 0.2 mm apart: a ball of 2 mm radius that touches it is 0.01 mm
        off. Over a hole it is that to its edge; infinite where there is no such boundary at all.
        """
        if not self._inner.n:
            return np.full(len(radii_mm), np.inf)
        away = np.asarray(self._inner.query(centers_bed)[0])
        cells = (centers_bed[:, :2] - (self.x_mm[0], self.y_mm[0])) / CELL_MM
        heights = np.maximum(self.bounds_mm[2], -1e3)
        boundary = map_coordinates(heights, cells.T, order=1, mode="nearest")
        return np.where(centers_bed[:, 2] < boundary, -away, away) - radii_mm

    def _cells(self, centers_bed: Floats, radii_mm: Floats) -> list[tuple[slice, slice]]:
        """Return the cells below balls."""
        ends = [
            axis.searchsorted(center + side * radii_mm).tolist()
            for axis, center in ((self.x_mm, centers_bed[:, 0]), (self.y_mm, centers_bed[:, 1]))
            for side in (-1.0, 1.0)
        ]
        return [(slice(a, b), slice(c, d)) for a, b, c, d in zip(*ends, strict=True)]

    def _reached(self, cells: tuple[slice, slice], center_bed: Floats, radius_mm: float) -> Floats:
        """Return how low a ball reaches in cells."""
        x, y, z = center_bed.tolist()
        away2 = ((self.x_mm[cells[0]] - x) ** 2)[:, None] + (self.y_mm[cells[1]] - y) ** 2
        square = radius_mm * radius_mm
        half = np.sqrt(np.maximum(square - away2, 0.0))
        return np.where(away2 <= square, z - half, np.inf)
