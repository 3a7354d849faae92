"""Fusion of the pointer cloud with the outer map of the ultrasound.

The cloud as a whole is off by the errors of registration and pointer, which all its points share.
So it is first moved onto the map as one rigid body, held back by what is expected of it where the
map cannot tell (a dome does not show a slide along itself). Then both are one surface, and what
stays unknown of the motion is part of how sure that surface is.
"""

from dataclasses import dataclass
from hashlib import sha256
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.robust import TUKEY_CUTOFF, mad_sigma, tukey_weights
from rona_core.mapping.boundary_map import CloudFit
from rona_core.mapping.fitting.hampel_filter import agreeing
from rona_core.mapping.fitting.plate_field import (
    ROUGHNESS_MM,
    PlateField,
    SurfaceSamples,
    fit_field,
    joined,
)

LEAST_OVERLAP = 30  # points of the cloud over the map; fewer tell nothing
ROUNDS = 25
LEAST_STEP_MM = 1e-5
LEAST_SCALE_MM = 0.02
ARM_MM = 20.0  # turns count as the way of a point so far from the middle
PATCH_MM = 7.0  # errors of tracker and map hang together over so much
NEAREST = 12  # points that tell by how much the surface misses the bone at a place


@dataclass(frozen=True, slots=True)
class CloudPrior:
    """How far off a cloud as a whole is expected to be: one standard deviation along each axis.

    By default a tracker and a robot of 0.35 mm (3D) each and a pivot, seen from 100 mm.
    """

    shift_mm: float = 0.35
    turn_rad: float = 0.0035

    def precision(self) -> Floats:
        """Return the inverse covariance (6, 6): shift, then turn."""
        return np.diag((*[self.shift_mm**-2] * 3, *[self.turn_rad**-2] * 3))


@dataclass(frozen=True, slots=True, eq=False)
class FusedCloud:
    """The plate through both, and how the cloud was moved for it."""

    plate: PlateField
    fit: CloudFit  # its correction in ``map``
    points_map: Floats  # (k, 3) of the cloud that went in, moved: one for each cell
    scatter_mm: float  # of the cloud about the map it was laid on

    def cloud_sigmas_mm(self, places_mm: Floats) -> Floats:
        """Return the standard deviation of the surface (m,) at places (m, 2) that the cloud leads.

        Two estimates of one variance, and their mean: how points over the ultrasound scatter about
        the map they were laid on, and by how much the points nearest to a place miss the surface,
        which is more at a groove, at an edge, or where ultrasound disagrees.
        """
        points = self.points_map
        off = points[:, 2] - self.plate.heights(points[:, :2])
        near = KDTree(points[:, :2]).query(places_mm, k=min(NEAREST, len(points)))[1]
        missed = np.mean(off[near.reshape(len(places_mm), -1)] ** 2, axis=1)
        return np.sqrt(0.5 * (missed + self.scatter_mm**2))


def fuse_cloud(
    cloud_map: Floats, plate: PlateField, overlap_mm: float, prior: CloudPrior
) -> FusedCloud | None:
    """Return the surface through ultrasound and cloud, and the rigid motion of the cloud.

    Args:
        cloud_map: Points of the cloud (n, 3) in ``map``, in the order they were taken.
        plate: The outer map as fitted to the ultrasound.
        overlap_mm: How close to an ultrasound sample a point must lie to count as over the map.
        prior: Of the motion.

    Returns:
        None where too few points lie over the map.
    """
    laid = _laid_once(cloud_map, plate, overlap_mm, prior)
    if laid is None:
        return None
    return FusedCloud(joined(plate, laid.samples), laid.fit, laid.samples.points_map, laid.scale_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Laid:
    """A cloud that was laid on a plate."""

    samples: SurfaceSamples
    fit: CloudFit
    scale_mm: float  # scatter of its points about the plate


_Asked = tuple[bytes, float, CloudPrior]
_LAST_LAID: "WeakKeyDictionary[PlateField, tuple[_Asked, _Laid | None]]" = WeakKeyDictionary()


def _laid_once(
    cloud_map: Floats, plate: PlateField, overlap_mm: float, prior: CloudPrior
) -> _Laid | None:
    """Return the cloud laid on a plate, remembered as long as the plate lives: arrays are small."""
    asked = sha256(cloud_map.tobytes()).digest(), overlap_mm, prior
    known = _LAST_LAID.get(plate)
    if known is None or known[0] != asked:
        known = asked, _laid(cloud_map, plate, overlap_mm, prior)
        _LAST_LAID[plate] = known
    return known[1]


def _laid(
    cloud_map: Floats, plate: PlateField, overlap_mm: float, prior: CloudPrior
) -> _Laid | None:
    ultrasound = KDTree(plate.places_mm)
    over = ultrasound.query(cloud_map[:, :2])[0] <= overlap_mm
    if np.count_nonzero(over) < LEAST_OVERLAP:
        return None
    seen = cloud_map[over]
    middle = seen.mean(axis=0)
    fit = _registered(seen, plate, prior.precision())
    cells = thinned(cloud_map, plate.grid.step_mm)
    cells = fit.correction @ cells[agreeing(cells[:, :2], cells[:, 2])]
    off, normals = _off(cells, plate)
    scale = mad_sigma(fit.distances_mm, floor=LEAST_SCALE_MM)
    alone = ultrasound.query(cells[:, :2])[0] > overlap_mm  # nothing speaks against these
    # weighted, as A-scans are, by its scatter about its own surface: its distance from the map is
    # the map's error as much as its own, and the error shared by all points is in the motion
    variance = fit_field(cells[:, :2], cells[:, 2]).scatter_mm ** 2 + ROUGHNESS_MM**2
    samples = SurfaceSamples(
        points_map=cells,
        upright=normals[:, 2],
        weights=np.where(alone, 1.0, tukey_weights(off, TUKEY_CUTOFF * scale)) / variance,
        moved_by=_moved_by(normals, cells - middle),
        motion=fit.covariance,
    )
    scaled = fit.information / np.outer(*[np.array((1.0,) * 3 + (ARM_MM,) * 3)] * 2)
    cloud_fit = CloudFit(
        correction=fit.correction,
        rms_mm=float(np.sqrt(np.mean(fit.distances_mm**2))),
        n_used=len(seen),
        eigenvalues=readonly(np.asarray(np.linalg.eigvalsh(scaled), dtype=np.float64)),
        covariance=readonly(fit.covariance),
    )
    return _Laid(samples, cloud_fit, scale)


@dataclass(frozen=True, slots=True, eq=False)
class _Registered:
    correction: Pose
    distances_mm: Floats  # (n,) of the moved points from the map
    information: Floats  # (6, 6) by the points alone
    covariance: Floats  # (6, 6) of the motion about the middle: shift, then turn


def _registered(points: Floats, plate: PlateField, prior: Floats) -> _Registered:
    """Register points (n, 3) to the map: point to plane (Chen 1991), Tukey's weights.

    All points of a patch count as one, since what they and the map err by hangs together.
    """
    middle, pose, total = points.mean(axis=0), Pose.identity(), np.zeros(6)
    points_as_one = len(points) / len(thinned(points, PATCH_MM))
    information = prior
    for _ in range(ROUNDS):
        moved = pose @ points
        distance, normals = _off(moved, plate)
        scale = mad_sigma(distance, floor=LEAST_SCALE_MM)
        weights = tukey_weights(distance, TUKEY_CUTOFF * scale) / (points_as_one * scale**2)
        rows = _moved_by(normals, moved - middle)
        information = rows.T @ (weights[:, None] * rows)
        step = np.linalg.solve(information + prior, -rows.T @ (weights * distance) - prior @ total)
        total = total + step
        turn = Pose.from_rotvec(step[3:])
        pose = Pose(turn.rotation, middle - turn.rotation @ middle + step[:3]) @ pose
        if np.abs(step).max() < LEAST_STEP_MM:
            break
    covariance = np.asarray(np.linalg.inv(information + prior), dtype=np.float64)
    return _Registered(pose, _off(pose @ points, plate)[0], information, covariance)


def _moved_by(normals: Floats, arms: Floats) -> Floats:
    """Return how distances (n, 6) along normals (n, 3) change with a shift and a turn."""
    turned = np.asarray(np.cross(arms, normals), dtype=np.float64)
    return np.column_stack((normals, turned))


def _off(points: Floats, surface: PlateField) -> tuple[Floats, Floats]:
    """Return signed distances (n,) to a surface along its normals, and those normals (n, 3)."""
    places = points[:, :2]
    east, north = surface.heights(places, (1, 0)), surface.heights(places, (0, 1))
    slopes = np.column_stack((-east, -north, np.ones(len(points))))
    normals = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    return (points[:, 2] - surface.heights(places)) * normals[:, 2], normals


def thinned(points_map: Floats, cell_mm: float) -> Floats:
    """Return one point (k, 3) for each cell that holds points (n, 3): their median."""
    if not len(points_map):
        return points_map
    cells = np.floor(points_map[:, :2] / cell_mm).astype(np.int64)
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    first = np.cumsum(counts) - counts
    low, high = first + (counts - 1) // 2, first + counts // 2
    ranked = np.column_stack([column[np.lexsort((column, group))] for column in points_map.T])
    return 0.5 * (ranked[low] + ranked[high])
