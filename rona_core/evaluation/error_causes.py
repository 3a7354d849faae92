"""Errors of the maps by cause, against ground truth.

A map follows its samples, so that what one cause does to each A-scan is what it does to the map.
Beside each stands what the program predicts, ``mapping/accuracy``.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.dependencies.head_reference import watch_head
from rona_core.app.steps.acoustics.thickness_uncertainty import speed_of_maps
from rona_core.app.steps.scan.inputs import POSES
from rona_core.evaluation.figures import Figures, rms
from rona_core.evaluation.maps.map_metrics import cells, outer_errors_mm, thickness_errors_mm
from rona_core.evaluation.scan_metrics import WRONG_MM, true_probe_poses
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.fitting.plate_field import fit_field
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at
from rona_core.virtual.acoustics.medium import bone_medium, true_bone

if TYPE_CHECKING:
    from rona_core.mapping.boundary_map import BoundaryMap, Maps
    from rona_core.session.captures import ScanCapture
    from rona_core.session.document import Session
    from rona_core.ultrasound.detection.detect import Detection

LEAST_SAMPLES = 12  # that tell an error of the thickness


@dataclass(frozen=True, slots=True, eq=False)
class _FirstPass:
    """A first pass (n) and the maps made of it."""

    scan: "ScanCapture"
    found: "Detection"
    maps: "Maps"
    speeds_mm_per_us: Floats  # (n,) of sound that the maps were made with
    led_back_mm: Floats  # (n, 3) how far the marker on the head led the probe back, in base

    def __len__(self) -> int:
        return len(self.found)


def cause_figures(session: "Session", truth: Truth) -> Figures:
    """Return the RMS errors of outer map and thickness by cause, of the first pass."""
    results, scan = session.results, session.captures.scan
    if results.detection is None or results.maps is None or scan is None:
        return {}
    found, maps = results.detection.value, results.maps.value
    n = len(found)
    if len(scan.scans) != n or not maps.outer_used[:n].any():
        return {}
    speeds, known = np.full(n, found.sound_speed_mm_per_us), speed_of_maps(session)
    if known is not None:
        speeds = speed_at(known, maps.outer_points_base[:n])[0]
    first = _FirstPass(scan, found, maps, speeds, _led_back_mm(session, scan))
    return _outer(first, truth) | _thickness(first, truth)


def _led_back_mm(session: "Session", scan: "ScanCapture") -> Floats:
    """Return the correction (n, 3) of the probe for the head's motion since step 4."""
    watch, poses = watch_head(session, scan), POSES.read(session)
    back = None if watch is None else watch.back(scan.scans.times_s)
    if back is None or poses is None:
        return np.zeros((len(scan.scans), 3))
    faces = poses.translations
    return back.inv() @ faces - faces


def _outer(first: _FirstPass, truth: Truth) -> Figures:
    """Return what each cause does to the outer boundary."""
    scan, n, scene = first.scan, len(first), truth.scene
    used = first.maps.outer_used[:n]
    model = robot_model(scene.settings.robot.model)
    qs_rad = scan.joints.at(scan.scans.times_s + scene.settings.robot.latency_ms / 1000.0)
    nominal = model.forward(qs_rad) @ model.T_flange_probe
    outward = -nominal.rotations[:, :, 2]
    systematic = scene.robot_error.systematic_mm(nominal.translations, qs_rad)
    links = -np.einsum("ij,ij->i", outward, systematic)
    moved = scene.head_shift_base(scan.ordinal, scan.scans.times_s) - truth.head_base
    head = np.einsum("ij,ij->i", outward, moved - first.led_back_mm)
    whole = outer_errors_mm(first.maps.outer_points_base[:n], truth, False)
    rest = (whole - links - head)[used]
    # where the face is, how fast its line and what is under it cannot be separated by echoes
    probe = float(rest.mean())
    figures = {
        "outer_by_links_mm": rms(links[used]),
        "outer_by_head_mm": rms(head[used]),
        "outer_by_probe_mm": abs(probe),
    }
    # nor can what one echo errs by and what it averages of rough bone, so that it is one cause of
    # all that cells err by besides
    at_cells = outer_errors_mm(cells(first.maps.outer), truth, False)
    elsewhere = fit_field(_places(first.maps, used), (links + head)[used] + probe)
    besides = at_cells - elsewhere.heights(_cells(first.maps.outer))
    return {**figures, "outer_by_sampling_mm": rms(besides)}


def _thickness(first: _FirstPass, truth: Truth) -> Figures:
    """Return what each cause does to the thickness; wrong echoes (1 mm off) are left out."""
    maps, taken, n = first.maps, first.speeds_mm_per_us, len(first)
    medium = bone_medium(truth.scene.world)
    true, depth = true_bone(true_probe_poses(first.scan, truth), truth.scene, medium)
    measured = first.found.thickness_mm * taken / first.found.sound_speed_mm_per_us
    sure = maps.inner_used[:n] & np.isfinite(true) & (np.abs(measured - depth) < WRONG_MM)
    if np.count_nonzero(sure) < LEAST_SAMPLES:
        return {}
    off = taken / true - 1.0  # of the speed, which with reference points differs by place too
    mean = float(off[sure].mean())
    echo = (measured - depth * taken / true)[sure]
    # a late echo and a slow bone cannot be separated: reference points see their sum
    parts = {
        "speed": depth[sure] * mean + echo.mean(),
        "place": (depth * (off - mean))[sure],
        "echo": echo - echo.mean(),
    }
    figures = {f"thickness_by_{cause}_mm": rms(part) for cause, part in parts.items()}
    places, wanted = _places(maps, sure), _cells(maps.inner, maps.inner.ok & maps.outer.ok)
    errors = thickness_errors_mm(maps, truth)
    near = np.isfinite(errors) & (KDTree(places).query(wanted)[0] <= NEAR_MM)
    between = errors - fit_field(places, (measured - depth)[sure]).heights(wanted)
    return {**figures, "thickness_by_interpolation_mm": rms(between[near])}


def _places(maps: "Maps", which: Bools) -> Floats:
    """Return the places (m, 2) on the grid of the maps of some A-scans of the first pass (n,)."""
    points = maps.outer_points_base[: len(which)][which]
    return (maps.outer.T_base_map.inv() @ points)[:, :2]


def _cells(boundary: "BoundaryMap", which: Bools | None = None) -> Floats:
    """Return the places (m, 2) of the mapped cells, or of those named."""
    return (boundary.T_base_map.inv() @ cells(boundary, which))[:, :2]
