"""Figures of steps 2 to 7: calibrations, cloud, path and plan against the truth.

True tip of a pointer in each frame of a capture. What the virtual tracker adds to the truth is
known: its bias field, its drift, and noise that is a pure function of seed, capture and frame. So
the true pose behind a measured one can be solved for, and no record of the hand's motion is needed.
Which markers were seen follows from the RMS error that the tracker reported.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.staleness import made_of
from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import TrackerPlace, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES, MarkerGeometry
from rona_core.evaluation.truth import Figures, Truth, rms
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_core.path.path_samples import filter_path
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.ultrasound.probe.probe_model import probe_model
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.faults import drift_mm, swapped_markers
from rona_core.virtual.tracker.reporting_rules import MIN_MARKERS
from rona_core.virtual.tracker.tracker import ViewConditions, observe, white_numbers

if TYPE_CHECKING:
    from rona_core.app.steps.implant.burr.derivation import BurrRegistration
    from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
    from rona_core.calibration.handheld.pointer import PointerCalibration
    from rona_core.calibration.surface_registration import SurfaceRegistration
    from rona_core.geometry.path5d import Path5D
    from rona_core.geometry.surface.cloud import SurfaceCloud
    from rona_core.robot.planning.plan import RobotPlan
    from rona_core.session.captures import PointerCapture
    from rona_core.session.document import Session


ROUNDS = 4  # each makes the remaining error smaller by a factor of about 1000
SAME_RMS_MM = 1e-6  # reported and recomputed RMS errors that agree like this belong together


def true_markers(
    track: ToolTrack,
    rows: Ints,
    settings: TrackerSettings,
    seed: int,
    ordinal: int,
    share: float = 1.0,
) -> Poses:
    """Return the true ``Ts_tracker_marker`` (n,) behind some rows (n,) of a track of a capture.

    For a 5D tool the roll about its line stays arbitrary. A pose that no set of markers explains
    is returned as if all that can be seen had been. The tracker errs by ``share`` of what its maker
    states.
    """
    geometry, numbers = GEOMETRIES[track.tool], track.frame_numbers[rows]
    measured, rms_mm = track.Ts_tracker_marker.select(rows), track.rms_error_mm[rows]
    white = white_numbers(seed, "tracker", ordinal, numbers)[track.tool]
    drift = drift_mm(settings, seed, ordinal, numbers / settings.rate_hz)
    swapped = swapped_markers(settings, geometry, seed, ordinal, numbers)
    rotations, translations = measured.rotations.copy(), measured.translations.copy()
    unexplained = np.arange(len(numbers))
    for clear in _marker_sets(geometry):
        shape = (len(unexplained), len(geometry.positions_marker))
        conditions = ViewConditions(
            None if clear is None else np.ones(shape, dtype=np.bool_),
            None if clear is None else np.broadcast_to(clear, shape),
            drift[unexplained],
            None if swapped is None else swapped[unexplained],
            share,
        )
        target = measured.select(unexplained)
        poses, seen, found_mm = target, np.ones(len(target), dtype=np.bool_), np.zeros(len(target))
        for _ in range(ROUNDS):
            reports = observe(geometry, poses, white[unexplained], settings, seed, conditions)
            seen &= reports.seen  # not so at the very edge of what the tracker sees
            found_mm = reports.rms_error_mm
            corrected = (target @ reports.Ts_tracker_marker.inv()) @ poses
            poses = Poses(
                np.where(seen[:, None, None], corrected.rotations, poses.rotations),
                np.where(seen[:, None], corrected.translations, poses.translations),
            )
        explained = seen & (np.abs(found_mm - rms_mm[unexplained]) <= SAME_RMS_MM)
        taken = np.ones_like(seen) if clear is None else explained
        rotations[unexplained[taken]] = poses.rotations[taken]
        translations[unexplained[taken]] = poses.translations[taken]
        unexplained = unexplained[~explained]
        if not len(unexplained):
            break
    return Poses(rotations, translations)


def _marker_sets(geometry: MarkerGeometry) -> Iterator[Bools | None]:
    """Yield None for what can be seen as a rule, then sets of markers (m,), larger ones first."""
    yield None
    count = len(geometry.positions_marker)
    for size in range(count, MIN_MARKERS[geometry.dof] - 1, -1):
        for chosen in combinations(range(count), size):
            clear = np.zeros(count, dtype=np.bool_)
            clear[list(chosen)] = True
            yield clear


def true_tips_base(
    scene: VirtualScene,
    track: ToolTrack,
    ordinal: int,
    rows: Ints,
    T_base_tracker: Pose | None = None,
) -> Floats:
    """Return the true tip (n, 3) in ``base`` in some rows (n,) of a pointer's track.

    ``T_base_tracker`` says where the tracker stood; None: where it stands now.
    It is where the tip was when the frame was measured, which is earlier than it arrived.
    """
    settings, share = scene.settings.tracker, scene.world.tracker_share
    markers = true_markers(track, rows, settings, scene.seed, ordinal, share)
    stood = scene.T_base_tracker if T_base_tracker is None else T_base_tracker
    return stood @ (markers @ scene.tips[track.tool])


def tool_figures(
    registration: "ToolRegistration", truth: Truth, place: TrackerPlace | None = None
) -> Figures:
    """Return the error of the tool's tip, and that of mapping the tracker to the base.

    ``place`` says where the tracker stood at the registration; None: where it stands now.
    """
    scene = truth.scene
    T_base_tracker = scene.T_base_tracker if place is None else scene.tracker_at(place)
    tip = registration.T_toolmarker_tip.translation
    true_tip = scene.T_tip_toolmarker.inv().translation
    landmarks = np.array(list(truth.landmarks_base().values()))
    return {
        "tool_tip_error_mm": float(np.linalg.norm(tip - true_tip)),
        "tracker_registration_tre_mm": registration_tre_mm(
            registration.T_base_tracker, T_base_tracker, landmarks
        ),
    }


def burr_figures(registration: "BurrRegistration", truth: Truth) -> Figures:
    """Return the error of the burr's tip in the frame of the drawn one."""
    off = registration.offset_tip - truth.scene.world.spindle_off_tip
    return {"burr_tip_error_mm": float(np.linalg.norm(off))}


def registration_tre_mm(T_base_tracker: Pose, true: Pose, points_base: Floats) -> float | None:
    """Return the RMS distance between points (n, 3) and where a registration puts them."""
    points_tracker = true.inv() @ points_base
    return rms(T_base_tracker @ points_tracker - points_base)


def skull_figures(registration: "SurfaceRegistration", truth: Truth) -> Figures:
    """Return the error of the five named points, mapped from the skull's file to the base."""
    landmarks = np.array(list(truth.landmarks_base().values()))
    T_base_skull = registration.T_b_a.inv()
    return {
        "skull_registration_tre_mm": registration_tre_mm(
            T_base_skull, truth.T_base_skull, landmarks
        )
    }


def pointer_figures(calibration: "PointerCalibration", truth: Truth) -> Figures:
    """Return the error of the pointer's tip in its marker frame; of a 5D pointer along its line."""
    off = calibration.tip_pointermarker - truth.scene.tips[calibration.pointer]
    error_mm = abs(off[2]) if calibration.dof == 5 else np.linalg.norm(off)
    return {"pointer_tip_error_mm": float(error_mm)}


def surface_figures(
    cloud: "SurfaceCloud", captures: "Sequence[PointerCapture]", truth: Truth
) -> Figures:
    """Return the size of the cloud, its distance to the bone and to the true tip."""
    if not len(cloud.points_base):
        return {"surface_points": 0, "surface_rms_mm": None, "surface_tip_3d_rms_mm": None}
    distances_mm = truth.signed_distance_mm(cloud.points_base)
    return {
        "surface_points": len(cloud.points_base),
        "surface_rms_mm": rms(distances_mm),
        "surface_tip_3d_rms_mm": rms(tip_errors(cloud, captures, truth)),
    }


def tip_errors(cloud: "SurfaceCloud", captures: "Sequence[PointerCapture]", truth: Truth) -> Floats:
    """Return the cloud's points minus the true tip on the head when they were taken (m, 3).

    The cloud holds its captures one after the other; each point is found again in its capture by
    its time. A point that is in none of them has no true tip and is left out.
    """
    errors: list[Floats] = []
    begin = 0
    for capture in captures:
        end = _end_of_capture(cloud.times_s, begin, capture.marker.times_s)
        if end > begin:
            rows = np.searchsorted(capture.marker.times_s, cloud.times_s[begin:end])
            stood = truth.scene.tracker_at(capture.tracker_place)
            true = true_tips_base(truth.scene, capture.marker, capture.ordinal, rows, stood)
            moved = truth.scene.head_shift_base(capture.ordinal, cloud.times_s[begin:end])
            errors.append(cloud.points_base[begin:end] - (true - moved + truth.head_base))
        begin = end
    return np.concatenate(errors) if errors else np.zeros((0, 3))


def _end_of_capture(times_s: Floats, begin: int, known_s: Floats) -> int:
    """Return the end of the run of rows from ``begin`` on that increase and occur in a capture."""
    rest = times_s[begin:]
    belongs = np.isin(rest, known_s)
    belongs[1:] &= np.diff(rest) > 0.0
    return begin + (int(np.argmin(belongs)) if not belongs.all() else len(rest))


PATTERN = "GenerateScanPattern"  # the message that makes a path without a demonstration


def smoothing_figures(session: "Session") -> Figures:
    """Return the number of points left, and K1 to the samples before and after filtering.

    The filter is no result of its own: it is applied again with the settings of the simplification.
    """
    smoothing, raw, capture = session.results.smoothing, session.results.path, session.captures.path
    figures: Figures = {}
    if smoothing is None:
        return figures
    value, kept = smoothing.value, smoothing.value.simplified.index
    figures["path_points_smoothed"] = len(kept)
    if raw is None or not made_of(smoothing, "edits", session.path_edits):
        return figures  # its numbers count on other changes by hand
    if raw.message == PATTERN or len(session.path_edits):
        if made_of(smoothing, "path", raw.value):
            figures["path_deviation_max_mm"] = float(value.from_filtered_mm.max())
            figures["path_deviation_raw_max_mm"] = float(value.from_raw_mm.max())
        return figures
    if capture is None or len(raw.value.points_base) != value.simplified.n_original:
        return figures  # the demonstration has been taken again since
    samples = raw.value.points_base
    given = filter_path(samples, capture.marker.times_s, filter_width_s(smoothing.arguments))
    figures["path_deviation_max_mm"] = deviation_max_mm(given, kept, given[kept])
    figures["path_deviation_raw_max_mm"] = deviation_max_mm(samples, kept, given[kept])
    return figures


def filter_width_s(arguments: dict[str, object]) -> float:
    """Return the width of the filter that a smoothing was asked for; 0 for none."""
    width = arguments.get("filter_s", 0.0)
    return float(width) if isinstance(width, int | float) else 0.0


def deviation_max_mm(points: Floats, kept: Ints, nodes: Floats) -> float:
    """Return K1: the largest distance of samples to the segment that replaces them.

    Args:
        points: Samples (n, 3).
        kept: Indices (k,) of the samples that the path keeps, ascending, first and last included.
        nodes: Positions (k, 3) of the path's points; segment j replaces samples kept[j] to
            kept[j + 1]. They differ from ``points[kept]`` where the samples were filtered before.
    """
    worst = 0.0
    for j in range(len(kept) - 1):
        between = points[kept[j] : kept[j + 1] + 1]
        worst = max(worst, float(to_segment_mm(between, nodes[j], nodes[j + 1]).max()))
    if len(kept) == 1:
        worst = float(np.linalg.norm(points - nodes[0], axis=1).max())
    return worst


def to_segment_mm(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distance of each point (n, 3) to a segment, not to its line."""
    along = end - start
    length2 = float(along @ along)
    share = np.clip((points - start) @ along / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
    nearest = start + np.multiply.outer(share, along)
    return np.linalg.norm(points - nearest, axis=1)


def normal_figures(path: "Path5D", truth: Truth) -> Figures:
    """Return median and 95th percentile of the angle between probe axis and true inward normal.

    The true one is that of the bone below the probe's crystal.
    """
    radius_mm = probe_model(truth.scene.settings.probe).aperture_radius_mm
    normals = truth.face_normals(path.points_base, radius_mm)
    cosine = -(path.axes_base * normals).sum(axis=1)
    sine = np.linalg.norm(np.cross(path.axes_base, normals), axis=1)
    angles_deg = np.rad2deg(np.arctan2(sine, cosine))
    return {
        "normal_error_median_deg": float(np.median(angles_deg)),
        "normal_error_p95_deg": float(np.percentile(angles_deg, 95.0)),
    }


def plan_figures(plan: "RobotPlan") -> Figures:
    """Return how many rolls were tried, how the chosen one fares, and how long the scan takes."""
    search, trajectory, certificate = plan.search, plan.trajectory, plan.certificate
    least_deg, chosen = None, search.mode != "none"
    if trajectory is not None:
        times_s = trajectory.times_s
        scanning = (times_s >= trajectory.scan_start_s) & (times_s <= trajectory.scan_end_s)
        room_rad = robot_model(plan.model).limits.clearance_rad(trajectory.qs_rad[scanning])
        least_deg = float(np.rad2deg(room_rad.min())) if scanning.any() else None
    return {
        "rolls_tried": len(search.verdicts),
        "rolls_feasible": sum(verdict.feasible for verdict in search.verdicts),
        "roll_mode": search.mode,
        "min_clearance_mm": None if certificate is None else certificate.min_clearance_mm,
        "roll_variation_deg": search.roll_variation_deg if chosen else None,
        "min_joint_margin_deg": least_deg,
        "scan_duration_s": None if trajectory is None else trajectory.duration_s,
    }
