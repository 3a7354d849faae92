"""How sure the maps of step 9 are, cell by cell, without any truth.

Four parts, whose squares add up: the time of flight of the nearest A-scans, what left-out samples
tell of places between samples, the speed of sound, and where the probe was. The last two are
nearly the same for all cells of a map. Nothing of it is stored: it follows from what a session
holds, so that maps of older files are as honest as new ones. See
docs/algorithms/maps/boundary_maps.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import KDTree

from rona_core.app.steps.acoustics.thickness_uncertainty import speed_of_maps
from rona_core.devices.settings import ProbeSettings
from rona_core.devices.tracker_volumes import ACCURACY_MM
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.thin_plate_spline import left_out_error
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_uncertainty import speed_uncertainty
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, ScanName, corrected
from rona_core.ultrasound.probe.probe_model import probe_model

ROBOT_ACCURACY_MM = 0.35  # 3D RMS, as the paper states for its arm
# As makers state it: how far an arm is off when it comes to a place again. Taken for a standard
# deviation along the normal, which is on the safe side.
REPEATABILITY_MM = {"rx90": 0.02, "ur5": 0.1, "ur10": 0.1}
NEAREST = 6  # A-scans whose time of flight counts at a cell


@dataclass(frozen=True, slots=True, eq=False)
class CellSigma:
    """Standard deviations of a height or a thickness over the grid of a map, by who shares them."""

    own_mm: Floats  # (nu, nv) time of flight, interpolation, speed of sound at the place
    speed_mm: Floats  # (nu, nv) speed of sound of the patient: one error for the whole map
    pose_mm: float  # where the probe was, along the normal: nearly one error for the whole map

    def same_robot_mm(self) -> Floats:
        """Return the standard deviation (nu, nv) where the robot that scanned uses the map."""
        return np.hypot(self.own_mm, self.speed_mm)

    def total_mm(self) -> Floats:
        """Return the standard deviation (nu, nv), all parts together."""
        return np.hypot(self.same_robot_mm(), self.pose_mm)


@dataclass(frozen=True, slots=True, eq=False)
class MapAccuracy:
    """How sure the three maps and the thickness between two of them are."""

    outer: CellSigma
    inner: CellSigma
    fused: CellSigma
    thickness: CellSigma


def accuracy_words(maps: Maps, accuracy: MapAccuracy) -> str:
    """Return a sentence about the errors that are to be expected: RMS over the mapped cells."""

    def rms_mm(sigma: Floats, which: Bools) -> float:
        return float(np.sqrt(np.mean(sigma[which] ** 2)))

    outer, inner, bone = accuracy.outer, accuracy.inner, accuracy.thickness
    both = maps.outer.ok & maps.inner.ok
    if not maps.outer.ok.any():
        return ""
    words = (
        f"Expected errors (1 σ): outer boundary {rms_mm(outer.total_mm(), maps.outer.ok):.2f} mm "
        f"({rms_mm(outer.same_robot_mm(), maps.outer.ok):.2f} where the same robot uses the map)"
    )
    if both.any():
        words += (
            f", inner {rms_mm(inner.total_mm(), maps.inner.ok):.2f} mm, thickness "
            f"{rms_mm(bone.total_mm(), both):.2f} mm: of it {rms_mm(bone.speed_mm, both):.2f} mm "
            "by the speed of sound, alike in the whole map"
        )
    return f"{words}."


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


@dataclass(frozen=True, slots=True)
class _Arm:
    """What carried the probe: how far off along the normal, and when it comes again."""

    pose_mm: float
    repeat_mm: float


def map_accuracy(session: Session, *, hand: bool = False) -> MapAccuracy | None:
    """Return how sure the maps are; None before there are any, or of other A-scans than these.

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
        maps, arm = results.sono_maps.value.maps, _Arm(_hand_pose_mm(session), 0.0)
    else:
        if results.maps is None or results.detection is None:
            return None
        passes = (results.detection, results.second_detection)
        found = tuple(derived.value for derived in passes if derived is not None)
        samples = _Samples(
            found, ("first", "second")[: len(found)], session.boundary_edits, devices.probe
        )
        maps = results.maps.value
        worst = max(REPEATABILITY_MM.values())
        repeat_mm = REPEATABILITY_MM.get(devices.robot.model, worst)
        arm = _Arm(ROBOT_ACCURACY_MM / 3.0**0.5, repeat_mm)
    known = speed_of_maps(session, hand=hand)
    return _accuracy(maps, samples, known, arm) if len(samples) == len(maps.inner_used) else None


def _hand_pose_mm(session: Session) -> float:
    """Return how far off along the normal the tracked probe in the hand is.

    The tracker sees the marker of the probe and that on the robot base, both as well as its maker
    states; where the maps are in ``base``, that of the robot's registration comes to it.
    """
    results = session.results
    tracker = ACCURACY_MM[session.setup.devices.tracker.profile]
    face = 0.0 if results.sono is None else results.sono.value.face_sigma_mm
    squares = 2.0 * tracker**2 + face**2
    if results.sono_maps is not None and results.sono_maps.value.frame == "base":
        registered = 0.0 if results.tool is None else results.tool.value.registration_sigma_mm
        squares += registered**2 + ROBOT_ACCURACY_MM**2
    return float((squares / 3.0) ** 0.5)


@remember(4)  # maps never change, and every browser asks
def _accuracy(
    maps: Maps, samples: _Samples, known: SpeedCalibration | None, arm: _Arm
) -> MapAccuracy:
    found = samples.corrected()
    n, T_map_base = len(found[0]), maps.outer.T_base_map.inv()
    outer_map = T_map_base @ maps.outer_points_base[maps.outer_used]
    outer_sigma = found[0].outer_sigma_mm[maps.outer_used[:n]]  # of the first pass alone
    own_outer = np.hypot(_own_mm(maps.outer, outer_map, outer_sigma), arm.repeat_mm)
    between_map = T_map_base @ maps.inner_points_base[maps.inner_used]
    between_map[:, 2] = _heights_at(maps.outer, between_map) - between_map[:, 2]
    timing = np.concatenate([one.thickness_sigma_mm for one in found])[maps.inner_used]
    own_between = _own_mm(maps.inner, between_map, timing)
    depth = np.maximum(maps.thickness_mm(), 0.0)
    cells_base = maps.outer.T_base_map @ _cells_map(maps.outer)
    shared, place = speed_uncertainty(uncalibrated() if known is None else known, cells_base)
    speed_mm = depth * shared.reshape(depth.shape)
    own_thickness = np.hypot(own_between, depth * place.reshape(depth.shape))
    none = readonly(np.zeros(depth.shape))
    return MapAccuracy(
        outer=CellSigma(readonly(own_outer), none, arm.pose_mm),
        inner=CellSigma(
            readonly(np.hypot(own_thickness, own_outer)), readonly(speed_mm), arm.pose_mm
        ),
        fused=CellSigma(readonly(_own_fused_mm(maps, own_outer)), none, arm.pose_mm),
        thickness=CellSigma(readonly(own_thickness), readonly(speed_mm), 0.0),
    )


def _own_mm(boundary: BoundaryMap, samples: Floats, sigma_mm: Floats) -> Floats:
    """Return what time of flight and interpolation add to each cell (nu, nv).

    Args:
        boundary: Its grid is meant.
        samples: Place and height (n, 3), in ``map``.
        sigma_mm: Of the time of flight of each (n,).
    """
    shape = boundary.height_mm.shape
    if not len(samples):
        return np.full(shape, np.inf)
    places = _cells_map(boundary)[:, :2]
    away, near = KDTree(samples[:, :2]).query(places, k=min(NEAREST, len(samples)))
    away, near = away.reshape(len(places), -1), near.reshape(len(places), -1)
    between = left_out_error(samples[:, :2], samples[:, 2]).at(away[:, 0])
    timing = np.sqrt(np.mean(sigma_mm[near] ** 2, axis=1))
    return np.hypot(timing, between).reshape(shape)


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


def _own_fused_mm(maps: Maps, own_outer: Floats) -> Floats:
    """Return what each cell (nu, nv) of the fused map has of its own.

    Where there is ultrasound it is that of the outer map. Beyond, where the pointer's cloud alone
    tells: how far the cloud lies from the map it was laid on, and how sure that is.
    """
    if maps.cloud_fit is None or not maps.outer.ok.any():
        return own_outer
    there = float(np.sqrt(np.mean(own_outer[maps.outer.ok] ** 2)))
    return np.where(maps.outer.ok, own_outer, np.hypot(there, maps.cloud_fit.rms_mm))
