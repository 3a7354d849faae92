"""Commanded floor: what a burr leaves if it goes exactly where it is sent."""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats

CELL_MM = 0.25
AROUND_MM = 0.5


class CommandedFloor:
    """Heights over a grid in ``bed``.

    Attributes:
        places_mm: Cell centres (n,), along x and along y.
        top_mm: What should be left reaches up to here (n, n).
    """

    def __init__(self, half_mm: float) -> None:
        """Lay a grid so far to all sides of the bed's middle."""
        count = int(np.ceil((half_mm + AROUND_MM) / CELL_MM))
        self.places_mm = CELL_MM * np.arange(-count, count + 1.0)
        self.top_mm = np.zeros((len(self.places_mm), len(self.places_mm)))

    def cells(self) -> Floats:
        """Return x and y (m, 2) of every cell, rows of ``top_mm`` one after the other."""
        x, y = np.meshgrid(self.places_mm, self.places_mm, indexing="ij")
        return np.column_stack((x.ravel(), y.ravel()))

    def cut(self, bottom_bed: Floats, radius_mm: float) -> float:
        """Take away what a ball with its lowest place there reaches; return how much, in mm3."""
        i, j = (
            slice(*np.searchsorted(self.places_mm, (middle - radius_mm, middle + radius_mm)))
            for middle in bottom_bed[:2].tolist()
        )
        away2 = ((self.places_mm[i] - bottom_bed[0]) ** 2)[:, None]
        away2 = away2 + (self.places_mm[j] - bottom_bed[1]) ** 2
        lowest = bottom_bed[2] + radius_mm - np.sqrt(np.maximum(radius_mm**2 - away2, 0.0))
        old = self.top_mm[i, j]
        new = np.where(away2 <= radius_mm**2, np.minimum(old, lowest), old)
        taken_mm3 = CELL_MM**2 * float((old - new).sum())
        self.top_mm[i, j] = new
        return taken_mm3

    def flat_places(self, radius_mm: float, step_mm: float, rough_mm: float) -> Floats:
        """Return places (m, 3) on a grid round which the floor is flat for so far.

        Args:
            radius_mm: Of the disc that has to be flat.
            step_mm: Between places.
            rough_mm: From the lowest to the highest place of the disc, at most.
        """
        reach = np.arange(-radius_mm, radius_mm + 1e-9, CELL_MM)
        disc: Bools = np.hypot(reach[:, None], reach) <= radius_mm
        shifts = np.column_stack(np.nonzero(disc)) - len(reach) // 2
        every, margin = max(1, round(step_mm / CELL_MM)), len(reach) // 2
        middle = len(self.places_mm) // 2
        lines = np.arange(middle % every, len(self.places_mm), every)
        lines = lines[(lines >= margin) & (lines < len(self.places_mm) - margin)]
        found: list[tuple[float, float, float]] = []
        for i in lines.tolist():
            for j in lines.tolist():
                heights = self.top_mm[i + shifts[:, 0], j + shifts[:, 1]]
                if heights.max() - heights.min() <= rough_mm:
                    x, y = float(self.places_mm[i]), float(self.places_mm[j])
                    found.append((x, y, float(heights.mean())))
        return np.array(found, dtype=np.float64).reshape(-1, 3)
