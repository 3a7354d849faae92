"""Maps of the outer and inner boundary of the bone: heights over the plane that fits them best."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import map_coordinates

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryMap:
    """One boundary as heights over a grid (2.5D). ``map`` is the frame of that grid, z outward.

    Cells that are not ``ok`` hold the continuation of the fit, which is not to be used.
    """

    T_base_map: Pose
    u_mm: Floats  # (nu,) cell centres along x of the map
    v_mm: Floats  # (nv,) cell centres along y
    height_mm: Floats  # (nu, nv)
    ok: Bools  # (nu, nv) a sample that is not flagged lies close by

    def points_base(self) -> Floats:
        """Return the unflagged cells as points (n, 3) in ``base``."""
        i, j = np.nonzero(self.ok)
        points = np.column_stack((self.u_mm[i], self.v_mm[j], self.height_mm[i, j]))
        return self.T_base_map @ points

    def heights(self, points_map: Floats) -> Floats:
        """Return the heights (n,) below points (n, 3), linear between cells."""
        cells = self._cells(points_map)
        found = map_coordinates(self.height_mm, cells, order=1, mode="nearest")
        return np.asarray(found, dtype=np.float64)

    def mapped_share(self, points_map: Floats) -> Floats:
        """Return how much (n,), 0 to 1, of what lies below points (n, 3) is mapped."""
        ok = self.ok.astype(np.float64)
        found = map_coordinates(ok, self._cells(points_map), order=1, mode="constant")
        return np.asarray(found, dtype=np.float64)

    def _cells(self, points_map: Floats) -> Floats:
        """Return where points (n, 3) are in the grid (2, n), counted in cells."""
        cell_mm = self.u_mm[1] - self.u_mm[0]
        origin = np.array((self.u_mm[0], self.v_mm[0]))
        return ((points_map[:, :2] - origin) / cell_mm).T


@dataclass(frozen=True, slots=True, eq=False)
class CloudFit:
    """How the pointer cloud was moved onto the ultrasound map before both were joined."""

    correction: Pose  # corrected point = correction @ measured point, both in base
    rms_mm: float  # distance of the cloud to the map afterwards, along its normal
    n_used: int
    eigenvalues: Floats  # (6,) ascending, of the scaled normal equations: small = not observable
    # (6, 6) of the correction about the middle of the cloud: shift (mm), then turn (rad), in map
    covariance: Floats | None = field(default=None, metadata={"omit_empty": True})


@dataclass(frozen=True, slots=True, eq=False)
class Maps:
    """Step 9: the samples, and the maps made of them, all on the same grid."""

    outer_points_base: Floats  # (n, 3) one for each A-scan, those of tilted passes last
    inner_points_base: Floats  # (n, 3)
    outer_used: Bools  # (n,) went into the outer map
    inner_used: Bools  # (n,) went into the inner map
    outer: BoundaryMap
    inner: BoundaryMap
    fused: BoundaryMap  # outer boundary from ultrasound and pointer together
    cloud_fit: CloudFit | None  # None where the pointer cloud does not overlap the map
    # (p,) by which each pass had placed the inner boundary too deep, taken out of its points
    offsets_mm: Floats | None = field(default=None, metadata={"omit_empty": True})
    # standard deviation of what is left of these in the mean of all A-scans that are used
    offset_sigma_mm: float = field(default=0.0, metadata={"omit_empty": True})

    def seen_from(self, T_a_b: Pose) -> "Maps":
        """Return maps that are given in frame b as they are in frame a."""
        outer, inner, fused = (
            replace(part, T_base_map=T_a_b @ part.T_base_map)
            for part in (self.outer, self.inner, self.fused)
        )
        return replace(
            self,
            outer_points_base=readonly(T_a_b @ self.outer_points_base),
            inner_points_base=readonly(T_a_b @ self.inner_points_base),
            outer=outer,
            inner=inner,
            fused=fused,
        )

    @property
    def inner_share(self) -> float:
        """Share of the cells of the outer map that have an inner boundary."""
        return float((self.inner.ok & self.outer.ok).sum() / max(int(self.outer.ok.sum()), 1))

    def thickness_mm(self) -> Floats:
        """Return outer minus inner height (nu, nv); valid where both maps are ok."""
        return self.outer.height_mm - self.inner.height_mm
