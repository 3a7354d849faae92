"""Causes of the errors of the maps of step 9, cell by cell, without any truth.

The time of flight of the nearest A-scans, how sure the surface through them is between them, the
speed of sound, and where the probe was. What a cause does to all cells alike stands apart from what
each cell has for itself. Nothing of it is stored: it follows from what a session holds, so that
maps of older files are as honest as new ones. See docs/algorithms/maps/boundary_maps.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import KDTree

from rona_core.app.steps.acoustics.thickness_uncertainty import speed_of_maps
from rona_core.app.steps.maps.accuracy.error_terms import ErrorTerm
from rona_core.app.steps.maps.accuracy.probe_place import (
    ProbePlace,
    cloud_prior,
    hand_place,
    robot_place,
)
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.cloud_fusion import PATCH_MM, CloudPrior, FusedCloud, fuse_cloud
from rona_core.mapping.fitting.plate_field import ROUGHNESS_MM, PlateField, fit_field
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import LOCAL_LENGTH_MM
from rona_core.ultrasound.acoustic_calibration.speed_uncertainty import speed_uncertainty
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, ScanName, corrected
from rona_core.ultrasound.probe.probe_model import probe_model

SPEED = "speed of sound of the patient"
INTERPOLATION = "interpolation"
CLOUD = "cloud of the pointer"
POINTS = "measure the bone at three reference points (step 9)"
ROWS = "scan closer rows, or a second pass"
NEAREST = 6  # A-scans whose time of flight counts at a cell
UNHEARD = "inner boundary not heard"
UNHEARD_SLOPE = 0.15  # of a table whose echo misses the probe, against the map; one deviation
UNHEARD_ALIKE = 0.4  # of that all such places share: the map goes on too thick in most of them


@dataclass(frozen=True, slots=True, eq=False)
class MapTerms:
    """Causes of error of the outer boundary, of the fused one and of the thickness.

    The plates are those that the maps are made of; that of the thickness is None without samples.
    """

    outer: tuple[ErrorTerm, ...]
    fused: tuple[ErrorTerm, ...]
    thickness: tuple[ErrorTerm, ...]
    outer_plate: PlateField
    thickness_plate: PlateField | None


@dataclass(frozen=True, slots=True)
class _Samples:
    """What was detected, and what may have been set by hand."""

    detections: tuple[Detection, ...]
    scans: tuple[ScanName, ...]
    edits: BoundaryEdits
    probe: ProbeSettings

    def __len__(self) -> int:
        return sum(len(found) for found in self.detections)

    def corrected(self) -> tuple[Detection, ...]:
        """Return what was detected, with what was set by hand in its place."""
        probe = probe_model(self.probe)
        pairs = zip(self.detections, self.scans, strict=True)
        return tuple(corrected(found, self.edits, scan, probe) for found, scan in pairs)


def map_terms(session: Session, *, hand: bool = False) -> MapTerms | None:
    """Return what the maps err by; None before there are any, or of other A-scans than these.

    Args:
        session: With its maps.
        hand: Those of the scan by hand, in place of the robot's.
    """
    results, devices = session.results, session.setup.devices
    if hand:
        if results.sono_maps is None or results.sono_detection is None:
            return None
        # boundaries set by hand are few, and are numbered by A-scans that the tracker may not see
        samples = _Samples(
            (results.sono_detection.value,), ("hand",), BoundaryEdits(), devices.probe
        )
        maps, place = results.sono_maps.value.maps, hand_place(session)
    else:
        if results.maps is None or results.detection is None:
            return None
        passes = (results.detection, results.second_detection)
        found = tuple(derived.value for derived in passes if derived is not None)
        samples = _Samples(
            found, ("first", "second")[: len(found)], session.boundary_edits, devices.probe
        )
        maps = results.maps.value
        place = robot_place(session)
    if len(samples) != len(maps.inner_used):
        return None
    cloud = None if hand else _cloud_of(session)
    return _terms(maps, samples, speed_of_maps(session, hand=hand), place, cloud)


_Cloud = tuple[SurfaceCloud, CloudPrior]


def _cloud_of(session: Session) -> _Cloud | None:
    """Return the cloud that the maps were fused with; None where the session has another one."""
    maps, surface = session.results.maps, session.results.surface
    if maps is None or surface is None or maps.inputs.get("surface") != digest(surface.value):
        return None
    return surface.value, cloud_prior(session)


@remember(2)  # maps never change, and every browser asks
def _terms(
    maps: Maps,
    samples: _Samples,
    known: SpeedCalibration | None,
    place: ProbePlace,
    cloud: _Cloud | None,
) -> MapTerms:
    found = samples.corrected()
    n, T_map_base = len(found[0]), maps.outer.T_base_map.inv()
    outer_map = T_map_base @ maps.outer_points_base[maps.outer_used]
    outer_sigma = found[0].outer_sigma_mm[maps.outer_used[:n]]  # of the first pass alone
    face_mm = 2.0 * probe_model(samples.probe).aperture_radius_mm
    plate = fit_field(outer_map[:, :2], outer_map[:, 2])
    rest = (ErrorTerm("roughness within the beam", own_mm=ROUGHNESS_MM), *place.of_cells(maps))
    outer = (*_sampling(maps.outer, plate, plate, outer_sigma, face_mm), *rest)
    fused = _fused_terms(maps, outer, plate, cloud)
    between_map = T_map_base @ maps.inner_points_base[maps.inner_used]
    between_map[:, 2] = _heights_at(maps.outer, between_map) - between_map[:, 2]
    timing = np.concatenate([one.thickness_sigma_mm for one in found])[maps.inner_used]
    between = fit_field(between_map[:, :2], between_map[:, 2]) if len(between_map) else None
    depth = np.maximum(maps.thickness_mm(), 0.0)
    cells_base = maps.outer.T_base_map @ _cells_map(maps.outer)
    region = cells_base[(maps.outer.ok & maps.inner.ok).ravel()]
    calibration = uncalibrated() if known is None else known
    shared, local = speed_uncertainty(calibration, cells_base, region if len(region) else None)
    thickness = (
        *_sampling(maps.inner, between, between, timing, face_mm),
        _unheard(maps, T_map_base),
        ErrorTerm(SPEED, shared_mm=depth * shared.reshape(depth.shape), remedy=POINTS),
        ErrorTerm(
            "speed of sound at the place",
            depth * local.reshape(depth.shape),
            remedy=POINTS,
            reach_mm=LOCAL_LENGTH_MM,
        ),
    )
    return MapTerms(outer, fused, thickness, plate, between)


def _fused_terms(
    maps: Maps, outer: Sequence[ErrorTerm], plate: PlateField, cloud: _Cloud | None
) -> tuple[ErrorTerm, ...]:
    """Return the terms of the fused boundary, given those of the ultrasound's.

    It follows what A-scans err by as far as they count beside the cloud, and the cloud for the
    rest. What the whole map errs by stays: the cloud was laid on it.
    """
    joined = _joined(maps, plate, cloud)
    if joined is None:
        return (*outer, _unknown_cloud(maps, cloud))
    shape, places = maps.outer.height_mm.shape, _cells_map(maps.outer)[:, :2]
    share = joined.plate.weights(places).reshape(shape)
    apart = joined.plate.sigmas_mm(places).reshape(shape)
    between = ErrorTerm(INTERPOLATION, apart, _of_mean(apart, maps.outer, PATCH_MM), remedy=ROWS)
    kept = [
        term if term.of_robot else replace(term, own_mm=share * term.own_mm)
        for term in outer
        if term.cause != INTERPOLATION
    ]
    touched = ErrorTerm(CLOUD, own_mm=(1.0 - share) * joined.scatter_mm, reach_mm=PATCH_MM / 2.0)
    return (*kept, between, touched)


def _sampling(
    boundary: BoundaryMap,
    samples: PlateField | None,
    surface: PlateField | None,
    sigma_mm: Floats,
    face_mm: float,
) -> tuple[ErrorTerm, ErrorTerm]:
    """Return what time of flight and interpolation add to each cell.

    A-scans less than the width of a face apart hear the same bone and err alike, so that the mean
    over a map is off by what is left after averaging over as many patches as it has.

    Args:
        boundary: Its grid is meant.
        samples: Plate through the samples (n); None where there are none.
        surface: The plate that the map is made of, as sure as it is between them.
        sigma_mm: Of the time of flight of each sample (n,).
        face_mm: Width of the probe's face.
    """
    shape = boundary.height_mm.shape
    if samples is None or surface is None:
        return ErrorTerm("time of flight"), ErrorTerm(INTERPOLATION, np.full(shape, np.inf))
    places = _cells_map(boundary)[:, :2]
    near = KDTree(samples.places_mm).query(places, k=min(NEAREST, len(sigma_mm)))[1]
    timing = np.sqrt(np.mean(sigma_mm[near.reshape(len(places), -1)] ** 2, axis=1))
    # two estimates of one variance: what the samples state here, and how all of them scatter
    timing = np.sqrt(0.5 * (timing**2 + samples.scatter_mm**2)).reshape(shape)
    apart = surface.sigmas_mm(places).reshape(shape)
    return (
        ErrorTerm(
            "time of flight", timing, _of_mean(timing, boundary, face_mm), reach_mm=face_mm / 4.0
        ),
        ErrorTerm(INTERPOLATION, apart, _of_mean(apart, boundary, face_mm), remedy=ROWS),
    )


def _unheard(maps: Maps, T_map_base: Pose) -> ErrorTerm:
    """Return what places add at which an A-scan heard no inner boundary, those nearer to it.

    An echo misses the probe where the inner table leans. Such bone is steeper than the bone that
    was heard and that the map continues, so that the map is the more wrong the further it goes,
    and wrong to the same side in most places.
    """
    shape, heard = maps.inner.height_mm.shape, maps.inner_used
    if heard.all() or not heard.any():
        return ErrorTerm(UNHEARD)
    places = _cells_map(maps.inner)[:, :2]
    ascans = (T_map_base @ maps.outer_points_base)[:, :2]
    to_heard = KDTree(ascans[heard]).query(places)[0]
    to_unheard = KDTree(ascans[~heard]).query(places)[0]
    off_mm = np.where(to_unheard < to_heard, UNHEARD_SLOPE * to_heard, 0.0).reshape(shape)
    return ErrorTerm(UNHEARD, off_mm, UNHEARD_ALIKE * off_mm, remedy=ROWS, reach_mm=NEAR_MM)


def _joined(maps: Maps, plate: PlateField, cloud: _Cloud | None) -> FusedCloud | None:
    """Return what ultrasound and cloud make together; None without a cloud."""
    if cloud is None:
        return None
    points_map = maps.outer.T_base_map.inv() @ cloud[0].points_base
    return fuse_cloud(points_map, plate, NEAR_MM, cloud[1])


def _of_mean(own_mm: Floats, boundary: BoundaryMap, face_mm: float) -> float:
    """Return what the mean over a map is off by when each cell is off by ``own_mm`` (nu, nv)."""
    if not boundary.ok.any() or min(boundary.ok.shape) < 2:
        return 0.0
    cell_mm2 = (boundary.u_mm[1] - boundary.u_mm[0]) * (boundary.v_mm[1] - boundary.v_mm[0])
    patches = boundary.ok.sum() * cell_mm2 / (np.pi * face_mm**2)
    return float(np.sqrt(np.mean(own_mm[boundary.ok] ** 2) / max(patches, 1.0)))


def _cells_map(boundary: BoundaryMap) -> Floats:
    """Return all cells as points (nu nv, 3) in ``map``."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.column_stack((u.ravel(), v.ravel(), boundary.height_mm.ravel()))


def _heights_at(boundary: BoundaryMap, points_map: Floats) -> Floats:
    """Return the heights (n,) of a map at the places of points (n, 3) in ``map``."""
    u, v = boundary.u_mm, boundary.v_mm
    if min(len(u), len(v)) < 2:  # a strip of one cell has no slope
        return np.full(len(points_map), float(boundary.height_mm.mean()))
    chart = RectBivariateSpline(
        u, v, boundary.height_mm, kx=min(3, len(u) - 1), ky=min(3, len(v) - 1)
    )
    return np.asarray(chart.ev(points_map[:, 0], points_map[:, 1]), dtype=np.float64)


def _unknown_cloud(maps: Maps, cloud: _Cloud | None) -> ErrorTerm:
    """Return what a cloud that is not there any more adds where it alone tells of the boundary.

    How far it lay from the map it was laid on.
    """
    fit = maps.cloud_fit
    if fit is None or cloud is not None:
        return ErrorTerm(CLOUD)
    return ErrorTerm(CLOUD, np.where(maps.outer.ok, 0.0, fit.rms_mm))
