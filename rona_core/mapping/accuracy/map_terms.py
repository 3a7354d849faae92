"""Causes of the errors of the maps of step 9, cell by cell, without any truth.

The time of flight of the nearest A-scans, how sure the surface through them is between them, the
speed of sound, and where the probe was. What a cause does to all cells alike stands apart from what
each cell has for itself. See docs/algorithms/maps/boundary_maps.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RectBivariateSpline

from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.mapping.accuracy.echo_terms import (
    INTERPOLATION,
    ROWS,
    cells_map,
    mean_error_mm,
    no_echo_term,
    no_front_echo_term,
    roughness_term,
    sampling_terms,
)
from rona_core.mapping.accuracy.error_terms import ErrorTerm
from rona_core.mapping.accuracy.probe_place import ProbePlace
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.cloud_fusion import PATCH_MM, CloudPrior, FusedCloud, fuse_cloud
from rona_core.mapping.fitting.plate_field import (
    PlateField,
    fit_field,
    plate_through,
)
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    speed_uncertainty,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import LOCAL_LENGTH_MM
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, ScanName, corrected
from rona_core.ultrasound.probe.probe_model import probe_model

SPEED = "speed of sound of the patient"
CLOUD = "cloud of the pointer"
BETWEEN_PASSES = "offsets between passes"
MORE_PASSES = "plan further passes with the probe tilted (step 9)"
POINTS = "measure the bone at three reference points (step 9)"


@dataclass(frozen=True, slots=True, eq=False)
class MapTerms:
    """Causes of error of the three boundaries and of the thickness.

    An echo measures how far the inner boundary lies from the probe. By what bone departs from its
    mean below the face the thickness errs as the outer boundary does, and the inner one does not.
    """

    place: tuple[ErrorTerm, ...]  # where the probe was, which all boundaries share
    front: tuple[ErrorTerm, ...]  # of front echoes, and between them
    no_front_echo: ErrorTerm  # where there were none
    rough: ErrorTerm  # of the outer boundary within the beam
    fused: tuple[ErrorTerm, ...]
    depth: tuple[ErrorTerm, ...]  # of the way of an echo through the bone

    @property
    def outer(self) -> tuple[ErrorTerm, ...]:
        """Those of the outer boundary."""
        return (*self.front, self.no_front_echo, self.rough, *self.place)

    @property
    def inner(self) -> tuple[ErrorTerm, ...]:
        """Those of the inner boundary."""
        return (*self.depth, *self.place)

    @property
    def thickness(self) -> tuple[ErrorTerm, ...]:
        """Those of the thickness; what front echoes err by is in the scatter of its samples."""
        return (*self.depth, self.rough)


@dataclass(frozen=True, slots=True)
class MapSamples:
    """Boundaries as detected pass by pass, and those set by hand."""

    detections: tuple[Detection, ...]
    scans: tuple[ScanName, ...]
    edits: BoundaryEdits
    probe: ProbeSettings

    def __len__(self) -> int:
        return sum(len(found) for found in self.detections)

    def levels(self) -> Floats:
        """Return the levels of the front echoes of the first pass (n,) as they were detected.

        By hand a probe is tilted by more than bone is rough, so that they all count alike.
        """
        detected = self.detections[0].outer_quality
        return np.ones_like(detected) if self.scans == ("hand",) else detected

    def corrected(self) -> tuple[Detection, ...]:
        """Return what was detected, with what was set by hand in its place."""
        probe = probe_model(self.probe)
        pairs = zip(self.detections, self.scans, strict=True)
        return tuple(corrected(found, self.edits, scan, probe) for found, scan in pairs)


Cloud = tuple[SurfaceCloud, CloudPrior]


def map_terms(
    maps: Maps,
    samples: MapSamples,
    known: SpeedCalibration | None,
    place: ProbePlace,
    cloud: Cloud | None,
) -> MapTerms | None:
    """Return what the maps err by; None where the samples are not those of the maps.

    Args:
        maps: Of both boundaries.
        samples: That they were made of.
        known: The speed of sound that they were made at; None: the published one.
        place: Of the probe.
        cloud: That they were fused with, and how far off it may be as a whole.
    """
    if len(samples) != len(maps.inner_used):
        return None
    found = samples.corrected()
    n, T_map_base = len(found[0]), maps.outer.T_base_map.inv()
    outer_map = T_map_base @ maps.outer_points_base[maps.outer_used]
    first_used = maps.outer_used[:n]  # of the first pass alone
    outer_sigma = found[0].outer_sigma_mm[first_used]
    probe = probe_model(samples.probe)
    face_mm = 2.0 * probe.aperture_radius_mm
    plate, of_place = plate_through(outer_map), place.of_cells(maps)
    rough = roughness_term(maps.outer, plate, samples.levels()[first_used], probe)
    front = sampling_terms(maps.outer, plate, plate, outer_sigma, face_mm)
    silent_around = no_front_echo_term(maps, T_map_base, n)
    fused = _fused_terms(maps, (*front, silent_around, rough, *of_place), plate, cloud)
    between_map = T_map_base @ maps.inner_points_base[maps.inner_used]
    between_map[:, 2] = _heights_at(maps.outer, between_map) - between_map[:, 2]
    timing = np.concatenate([one.thickness_sigma_mm for one in found])[maps.inner_used]
    between = fit_field(between_map[:, :2], between_map[:, 2]) if len(between_map) else None
    bone_mm = np.maximum(maps.thickness_mm(), 0.0)
    cells_base = maps.outer.T_base_map @ cells_map(maps.outer)
    region = cells_base[(maps.outer.ok & maps.inner.ok).ravel()]
    calibration = uncalibrated() if known is None else known
    shared, local = speed_uncertainty(calibration, cells_base, region if len(region) else None)
    depth = (
        *sampling_terms(maps.inner, between, between, timing, face_mm),
        no_echo_term(maps, T_map_base),
        ErrorTerm(SPEED, shared_mm=bone_mm * shared.reshape(bone_mm.shape), remedy=POINTS),
        ErrorTerm(
            "speed of sound at the place",
            bone_mm * local.reshape(bone_mm.shape),
            remedy=POINTS,
            reach_mm=LOCAL_LENGTH_MM,
        ),
        ErrorTerm(BETWEEN_PASSES, shared_mm=maps.offset_sigma_mm, remedy=MORE_PASSES),
    )
    return MapTerms(of_place, front, silent_around, rough, fused, depth)


def _fused_terms(
    maps: Maps, outer: Sequence[ErrorTerm], plate: PlateField, cloud: Cloud | None
) -> tuple[ErrorTerm, ...]:
    """Return the terms of the fused boundary, given those of the ultrasound's.

    It follows what A-scans err by as far as they count beside the cloud, and for the rest the
    cloud, by its scatter and by what it misses nearby. What the whole map errs by stays: the cloud
    was laid on it.
    """
    joined = _joined(maps, plate, cloud)
    if joined is None:
        return (*outer, _unknown_cloud(maps, cloud))
    shape, places = maps.outer.height_mm.shape, cells_map(maps.outer)[:, :2]
    share = joined.plate.weights(places).reshape(shape)
    apart = joined.plate.sigmas_mm(places).reshape(shape)
    mean_mm = mean_error_mm(apart, maps.outer, PATCH_MM)
    between = ErrorTerm(INTERPOLATION, apart, mean_mm, remedy=ROWS, reach_mm=PATCH_MM / 2.0)
    kept = [
        term if term.of_robot else replace(term, own_mm=share * term.own_mm)
        for term in outer
        if term.cause != INTERPOLATION
    ]
    felt = joined.cloud_sigmas_mm(places).reshape(shape)
    touched = ErrorTerm(CLOUD, own_mm=(1.0 - share) * felt, reach_mm=PATCH_MM / 2.0)
    return (*kept, between, touched)


def _joined(maps: Maps, plate: PlateField, cloud: Cloud | None) -> FusedCloud | None:
    """Return what ultrasound and cloud make together; None without a cloud."""
    if cloud is None:
        return None
    points_map = maps.outer.T_base_map.inv() @ cloud[0].points_base
    return fuse_cloud(points_map, plate, NEAR_MM, cloud[1])


def _heights_at(boundary: BoundaryMap, points_map: Floats) -> Floats:
    """Return the heights (n,) of a map at the places of points (n, 3) in ``map``."""
    u, v = boundary.u_mm, boundary.v_mm
    if min(len(u), len(v)) < 2:  # a strip of one cell has no slope
        return np.full(len(points_map), float(boundary.height_mm.mean()))
    chart = RectBivariateSpline(
        u, v, boundary.height_mm, kx=min(3, len(u) - 1), ky=min(3, len(v) - 1)
    )
    return np.asarray(chart.ev(points_map[:, 0], points_map[:, 1]), dtype=np.float64)


def _unknown_cloud(maps: Maps, cloud: Cloud | None) -> ErrorTerm:
    """Return the error of a removed cloud where it alone measured the boundary.

    How far it lay from the map it was laid on.
    """
    fit = maps.cloud_fit
    if fit is None or cloud is not None:
        return ErrorTerm(CLOUD)
    return ErrorTerm(CLOUD, np.where(maps.outer.ok, 0.0, fit.rms_mm))
