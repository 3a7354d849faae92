"""Figures of step 8 and of the sound speed, and errors of the maps by cause.

Errors of the maps by cause, against ground truth. A map follows its samples, so that what one cause
does to each A-scan is what it does to the map. Beside each stands what the program predicts,
``mapping/accuracy``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.dependencies.references import watch_head
from rona_core.app.dependencies.staleness import made_of, required
from rona_core.app.steps.acoustics.view import at_speed_of_maps, speed_of_maps
from rona_core.app.steps.scan.derivation import PLACES, POSES
from rona_core.app.steps.scan.view import head_report
from rona_core.devices.wrench import summarize
from rona_core.evaluation.map_metrics import cells, outer_errors_mm, thickness_errors_mm
from rona_core.evaluation.truth import Figures, Truth, rms
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.mapping.fitting.plate_field import fit_field
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at
from rona_core.virtual.acoustics.medium import bone_medium, true_bone
from rona_core.virtual.true_tool_poses import error_keys

if TYPE_CHECKING:
    from rona_core.mapping.boundary_map import BoundaryMap, Maps
    from rona_core.session.captures import ScanCapture
    from rona_core.session.document import Session
    from rona_core.ultrasound.detection.detect import Detection


WRONG_MM = 0.5  # a thickness further off than this is a failure


def detection_figures(
    passes: Sequence["tuple[Detection, tuple[ScanCapture, ...]]"],
    truth: Truth,
    used: Bools | None = None,
) -> Figures:
    """Return the shares of A-scans that are wrong, wrong without a flag, and flagged.

    Those of further passes count like those of the first.

    Args:
        passes: What was detected in the A-scans of captures, one capture after the other; their
            thickness counts as it is, at the speed that it was taken with.
        truth: Of the same session.
        used: Which A-scans (n,) went into the map, where several passes were fused: the others
            count as flagged. None: their own flags count.
    """
    flagged = np.concatenate([detection.flag != 0 for detection, _ in passes])
    if used is not None and len(used) == len(flagged):
        flagged = ~used
    if not len(flagged):
        return dict.fromkeys(
            ("detection_failure_fraction", "unflagged_failure_fraction", "flagged_fraction")
        )
    wrong = np.concatenate(
        [
            wrong_inner(
                detection,
                truth.thickness_below_mm(Poses.joined([true_probe_poses(s, truth) for s in scans])),
            )
            for detection, scans in passes
        ]
    )
    return {
        "detection_failure_fraction": float(wrong.mean()),
        "unflagged_failure_fraction": float(wrong[~flagged].mean()) if (~flagged).any() else None,
        "flagged_fraction": float(flagged.mean()),
    }


def detected_passes(session: "Session") -> "list[tuple[Detection, tuple[ScanCapture, ...]]]":
    """Return what was found in the A-scans of each pass, its thickness as the maps have it.

    At their speed, and less what each pass is off as a whole. Without a pass that was taken again
    since it was looked through.
    """
    scan, passes = session.captures.scan, list["tuple[Detection, tuple[ScanCapture, ...]]"]()
    first, again = session.results.detection, session.results.second_detection
    if scan is None or first is None or not made_of(first, "capture", scan):
        return passes
    passes.append((first.value, (scan,)))
    further = session.captures.second
    if again is not None and further and made_of(again, "capture", further):
        passes.append((again.value, further))
    places = required(PLACES, session)
    poses = [Poses.joined([places.poses(one) for one in scans]) for _, scans in passes]
    offsets = _offsets_mm(session)
    return [
        (_less(at_speed_of_maps(session, found, at), scans, offsets), scans)
        for (found, scans), at in zip(passes, poses, strict=True)
    ]


def _offsets_mm(session: "Session") -> dict[int, float]:
    """Return what each pass is off as a whole, by the ordinal of its capture."""
    maps, scan = session.results.maps, session.captures.scan
    if maps is None or scan is None or maps.value.offsets_mm is None:
        return {}
    passes = (scan, *session.captures.second)
    return {
        one.ordinal: float(off) for one, off in zip(passes, maps.value.offsets_mm, strict=False)
    }


def _less(
    found: "Detection", scans: "tuple[ScanCapture, ...]", offsets: dict[int, float]
) -> "Detection":
    off_mm = [np.full(len(one.scans), offsets.get(one.ordinal, 0.0)) for one in scans]
    return replace(found, thickness_mm=readonly(found.thickness_mm - np.concatenate(off_mm)))


def contact_figures(scan: "ScanCapture") -> Figures:
    """Return how well the force kept to its set point, and the largest force of the scan."""
    found = None if scan.forces is None else summarize(scan.forces)
    if found is None:
        return {}
    return {"contact_force_rms_n": found.rms_n, "contact_force_peak_n": found.peak_n}


def head_shift_figures(session: "Session", truth: Truth) -> Figures:
    """Return the error of the mean shift of the head in the scan, as its marker shows it."""
    scan, report = session.captures.scan, head_report(session)
    if scan is None or scan.head is None or report is None:
        return {}
    seen = next(s.shift_mm for s in report.shifts if s.capture == "scan")
    if seen is None:
        return {}
    shifts = truth.scene.head_shift_base(scan.ordinal, scan.head.times_s)
    error = np.array(seen) - (shifts.mean(axis=0) - truth.head_base)
    return {"head_shift_error_mm": float(np.linalg.norm(error))}


def wrong_inner(detection: "Detection", true_mm: Floats) -> Bools:
    """Return which A-scans (n,) are more than 0.5 mm off in thickness along the probe axis.

    Where there is no inner boundary, an A-scan is wrong only if it claims one without a flag.
    """
    missing = ~np.isfinite(true_mm)
    off = np.abs(detection.thickness_mm - np.where(missing, 0.0, true_mm)) > WRONG_MM
    return np.where(missing, detection.flag == 0, off)


def true_probe_poses(scan: "ScanCapture", truth: Truth) -> Poses:
    """Return where the probe really was on the head at each A-scan.

    Joint angles arrive somewhat later.
    """
    scene = truth.scene
    model = robot_model(scene.settings.robot.model)
    late_s = scene.settings.robot.latency_ms / 1000.0
    times_s = scan.scans.times_s
    qs_rad = scan.joints.at(times_s + late_s)
    nominal = model.forward(qs_rad) @ model.T_flange_tip
    true = scene.Ts_base_tip_true(nominal, qs_rad, scan.ordinal, error_keys(times_s))
    T_tip_probe = model.T_flange_tip.inv() @ model.T_flange_probe
    probes = true @ (T_tip_probe @ scene.world.clamping)
    moved = scene.head_shift_base(scan.ordinal, times_s) - truth.head_base
    return Poses(probes.rotations, probes.translations - moved) if moved.any() else probes


def speed_figures(session: "Session", truth: Truth) -> Figures:
    """Return how far the speed of the map is off, and the thickness of A-scans with it.

    Both over the A-scans that are sure of their inner boundary; the error of the thickness is along
    the axis of the probe, and leaves out those that took another echo (0.5 mm off and more).
    """
    detection, maps, scan = session.results.detection, session.results.maps, session.captures.scan
    if detection is None or maps is None or scan is None or len(scan.scans) != len(detection.value):
        return {}
    ok = np.asarray(detection.value.inner_ok)
    poses = true_probe_poses(scan, Truth(truth.scene))  # on the head at rest
    medium = bone_medium(truth.scene.world)
    true, depth = true_bone(poses, truth.scene, medium)
    nominal = detection.value.sound_speed_mm_per_us
    used = np.full(len(ok), nominal)
    known = speed_of_maps(session)
    if known is not None:
        used = speed_at(known, maps.value.outer_points_base[: len(ok)])[0]
    sure = ok & np.isfinite(true)
    if not sure.any():
        return {"sound_speed_error_percent": None, "scan_thickness_rms_mm": None}
    error = detection.value.thickness_mm * used / nominal - depth
    right = error[sure & (np.abs(error) < WRONG_MM)]
    return {
        "sound_speed_error_percent": 100.0 * float(np.mean(used[sure] / true[sure] - 1.0)),
        "scan_thickness_rms_mm": rms(right),
    }


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
    """Return what each cause does to the thickness; wrong echoes (0.5 mm off) are left out."""
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
