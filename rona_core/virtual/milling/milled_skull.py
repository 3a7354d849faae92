"""A skull with a bed in it, asked by rays like any specimen."""

import numpy as np
from scipy.ndimage import map_coordinates

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.virtual.milling.left_bone import CELL_MM, LeftBone
from rona_core.virtual.specimen.boundaries import Specimen

ROUNDS = 3  # of finding the floor along a ray that is nearly plumb to it


class MilledSkull:
    """What a probe meets after the burr: the boundaries below the floor, and the floor."""

    def __init__(self, specimen: Specimen, T_skull_bed: Pose, left: LeftBone) -> None:
        """Look at a skull of which this is left."""
        self._specimen, self._T_bed_skull, self._left = specimen, T_skull_bed.inv(), left

    def layers(self, origins_skull: Floats, directions_skull: Floats) -> Floats:
        """Return the distances (n, 4) of the boundaries along rays, none above the floor."""
        found = self._specimen.layers(origins_skull, directions_skull)
        starts = self._T_bed_skull @ origins_skull
        along = self._T_bed_skull.rotate(directions_skull)
        way = np.where(np.isfinite(found[:, 0]), found[:, 0], 0.0)
        for _ in range(ROUNDS):
            place = starts + way[:, None] * along
            cells = (place[:, :2] - (self._left.x_mm[0], self._left.y_mm[0])) / CELL_MM
            height = map_coordinates(self._left.top_mm, cells.T, order=1, mode="nearest")
            way = way + (height - place[:, 2]) / along[:, 2]
        return np.maximum(found, np.where(np.isfinite(way), way, 0.0)[:, None])
