"""Map sheet: the maps and how sure they are, as arrays over one grid, for the writers of files.

All files hold places in ``base``, in mm, unchanged, and where a format names its space they say
``left-posterior-superior``: so ``base`` x, y, z count as L, P, S, and files of one session lie on
each other in programs that assume it (3D Slicer).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import BoundaryMap, Maps

BoundaryName = Literal["outer", "inner", "fused"]
BOUNDARIES: tuple[BoundaryName, ...] = ("outer", "inner", "fused")


@dataclass(frozen=True, slots=True, eq=False)
class SigmaOverGrid:
    """Standard deviation over the grid (nu, nv), in mm; not finite where it is unknown."""

    own_mm: Floats  # of what each cell has for itself
    common_mm: Floats  # of one error that all cells share

    def total_mm(self) -> Floats:
        """Return both together (nu, nv)."""
        return np.hypot(self.own_mm, self.common_mm)


@dataclass(frozen=True, slots=True, eq=False)
class MapSheet:
    """Maps, and the standard deviations of ``outer``, ``inner``, ``fused`` and ``thickness``.

    Raises:
        InvalidInputError: the arrays are not all over one grid.
    """

    maps: Maps
    sigmas: dict[str, SigmaOverGrid]  # what is missing is not known

    def __post_init__(self) -> None:
        shape = self.maps.outer.ok.shape
        held = [getattr(self.maps, name).ok for name in BOUNDARIES]
        held += [part for one in self.sigmas.values() for part in (one.own_mm, one.common_mm)]
        others = {part.shape for part in held} - {shape}
        if others:
            raise InvalidInputError(
                f"expected all maps on one grid of {shape} cells, got {sorted(others)}: "
                "compute the maps again (step 9)"
            )

    def boundary(self, name: BoundaryName) -> BoundaryMap:
        """Return one of the three maps."""
        return getattr(self.maps, name)

    def thickness_ok(self) -> Bools:
        """Return where the thickness, outer minus inner height, is known (nu, nv)."""
        return self.maps.outer.ok & self.maps.inner.ok

    def thickness_mm(self) -> Floats:
        """Return the thickness (nu, nv), NaN where it is not known."""
        return np.where(self.thickness_ok(), self.maps.thickness_mm(), np.nan)

    def sigma_mm(self, name: str) -> dict[str, Floats]:
        """Return ``total``, ``own`` and ``common`` (nu, nv) of a quantity, NaN where not known."""
        ok = self.thickness_ok() if name == "thickness" else getattr(self.maps, name).ok
        stated = self.sigmas.get(name)
        if stated is None:
            unknown = np.full(ok.shape, np.nan)
            return {"total": unknown, "own": unknown, "common": unknown}
        known = ok & np.isfinite(stated.total_mm())
        parts = {"total": stated.total_mm(), "own": stated.own_mm, "common": stated.common_mm}
        return {key: np.where(known, part, np.nan) for key, part in parts.items()}

    def points_base(self, name: BoundaryName) -> Floats:
        """Return all cells of a map as points (nu, nv, 3) in ``base``, ok or not."""
        own = self.boundary(name)
        u, v = np.meshgrid(own.u_mm, own.v_mm, indexing="ij")
        points = np.stack((u, v, own.height_mm), axis=-1)
        return (own.T_base_map @ points.reshape(-1, 3)).reshape(points.shape)


def cell_sizes_mm(boundary: BoundaryMap) -> tuple[float, float]:
    """Return the widths of a cell along u and v; a single row is as wide as the cells are long."""
    widths = [float(axis[1] - axis[0]) for axis in (boundary.u_mm, boundary.v_mm) if len(axis) > 1]
    if not widths:
        return 1.0, 1.0
    u = widths[0]
    return u, (widths[-1] if len(boundary.v_mm) > 1 else u)
