"""What the results of a session say about the error of the pointer's map, without any truth.

The covariances of registration and pointer, and the noise of a single frame, are chained as
``error_propagation.py`` does, at places that the pointer has touched. What repeats leaves little
trace there: for the tracker's volume and for the robot stands what their makers state, as
``derivation.py`` says; frames beside their average stand for noise and what that rounds off.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.dependencies.references import TrackerReference, weakest_reference
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.view import thickness_shares
from rona_core.app.steps.maps.inputs import expected_map_errors
from rona_core.app.steps.path.path_checks import expected_coverage
from rona_core.app.steps.pointer.derivation import EVIDENCE, Evidence, repeating_errors
from rona_core.app.steps.roll.view import expected_duration
from rona_core.app.steps.scan.view import head_figures
from rona_core.app.steps.surface.derivation import Strokes
from rona_core.calibration.error_propagation import MapSetup, predict_map_error
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.landmark_check import LandmarkCheck
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import point_jacobians
from rona_core.geometry.surface.cloud import (
    SurfaceCloud,
    averaging_covariances,
    build_cloud,
    merge_clouds,
)
from rona_core.geometry.surface.normals.normals import NormalField
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember

PLACES = 120  # touched places that stand for all
NORMAL_RADIUS_MM = 10.0
ANY_SIDE = (0.0, 0.0, 1.0)
MIN_SIGMA_MM = 1e-6  # of a marker, where a perfect tracker leaves no scatter


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePrediction:
    """Expected errors of the pointer's cloud in mm; 3D RMS but for the first."""

    normal_mm: float | None  # RMS along the normals of the surface; None where there are none
    rms_mm: float
    registration_mm: float  # the part of chance in the registration of robot and tracker
    pointer_mm: float  # likewise in the calibrated tip
    frame_mm: float  # the part of the frames that were averaged, and of what that rounds off
    tracker_mm: float  # what the tracker does the same every time, as far as it does not cancel
    robot_mm: float  # what the robot does the same every time
    frames: int  # so many are averaged at each place
    rows: Ints  # (n,) places among all samples of the strokes, one stroke after the other
    whole: Floats  # (n, 3, 3) covariances in base at these places
    common: Floats  # (3, 3) of the mean error over them
    local: Floats  # (n, 3, 3) of the error less its mean


def predict_surface(session: Session) -> SurfacePrediction | None:
    """Return the expected error of the surface cloud; None while a result it needs is missing."""
    results, strokes = session.results, session.captures.surface
    tool, pointer, cloud = results.tool, results.pointer, results.surface
    if tool is None or pointer is None or cloud is None or not len(cloud.value.points_base):
        return None
    if any(stroke.pointer != pointer.value.pointer for stroke in strokes):
        return None
    found = _predict(
        required(EVIDENCE, session),
        tool.value,
        pointer.value,
        cloud.value,
        session.captures.surface,
    )
    return found if found is None else _moved(found, weakest_reference(session, strokes))


def _moved(found: SurfacePrediction, reference: TrackerReference | None) -> SurfacePrediction:
    """Add what a move of the tracker since the registration costs, the same in all directions."""
    if reference is None or reference.state != "carried":
        return found
    added_mm, normal_mm = reference.added_mm, found.normal_mm
    added = added_mm**2 / 3.0 * np.eye(3)
    return replace(
        found,
        normal_mm=None if normal_mm is None else float(np.hypot(normal_mm, added_mm / 3.0**0.5)),
        rms_mm=float(np.hypot(found.rms_mm, added_mm)),
        registration_mm=float(np.hypot(found.registration_mm, added_mm)),
        whole=readonly(found.whole + added),
        common=readonly(found.common + added),
    )


@remember(4)
def _predict(
    evidence: Evidence,
    tool: ToolRegistration,
    pointer: PointerCalibration,
    cloud: SurfaceCloud,
    strokes: Strokes,
) -> SurfacePrediction | None:
    rows, poses = _some_poses(strokes)
    if not len(poses):
        return None
    repeating = repeating_errors(evidence, tool, pointer, poses)
    random = repeating.registration
    setup = MapSetup(
        T_base_tracker=tool.T_base_tracker,
        registration=random,
        tip_pointermarker=pointer.tip_pointermarker,
        tip_covariance=repeating.tip,
        positions_pointermarker=GEOMETRIES[pointer.pointer].positions_marker,
        noise=MarkerNoise(
            sigma_mm=max(pointer.marker_sigma_mm or tool.marker_sigma_mm, MIN_SIGMA_MM)
        ),
        n_averaged=frames_averaged(strokes, cloud.average_s),
    )
    n, found = len(poses), predict_map_error(setup, poses)
    tips_base = setup.T_base_tracker @ (poses @ setup.tip_pointermarker)
    J = point_jacobians(tool.T_base_tracker, poses @ setup.tip_pointermarker).reshape(3 * n, 6)
    turns = (tool.T_base_tracker.rotation @ poses.rotations).reshape(3 * n, 3)
    joint = repeating.tracker + repeating.robot + J @ random[:6, :6] @ J.T
    joint = (joint + turns @ setup.tip_covariance @ turns.T).reshape(n, 3, n, 3)
    own = _of_averages(strokes, setup, cloud.average_s)[rows]
    joint[np.arange(n), :, np.arange(n)] += own
    whole, common = joint[np.arange(n), :, np.arange(n)], joint.mean(axis=(0, 2))
    with_mean = joint.mean(axis=2)
    local = whole - with_mean - np.swapaxes(with_mean, 1, 2) + common
    return SurfacePrediction(
        normal_mm=_along_normals(tips_base, cloud.points_base, whole),
        rms_mm=_rms_mm(whole),
        registration_mm=found.registration_rms_mm,
        pointer_mm=found.pointer_rms_mm,
        frame_mm=_rms_mm(own),
        tracker_mm=float(np.sqrt(np.trace(repeating.tracker) / n)),
        robot_mm=float(np.sqrt(np.trace(repeating.robot) / n)),
        frames=setup.n_averaged,
        rows=readonly(rows),
        whole=readonly(whole),
        common=readonly(common),
        local=readonly(local),
    )


def _of_averages(strokes: tuple[PointerCapture, ...], setup: MapSetup, average_s: float) -> Floats:
    """Return covariances (n, 3, 3) in base by noise and moving average, of all samples.

    Samples that a cloud leaves out have that of the next one which it holds.
    """
    T, tip = setup.T_base_tracker, setup.tip_pointermarker
    tracks = [
        (T @ (stroke.marker.Ts_tracker_marker @ tip), stroke.marker.times_s)
        for stroke in strokes
        if len(stroke.marker.times_s)
    ]
    single = [build_cloud(*track) for track in tracks]
    averaged = [build_cloud(*track, average_s=average_s) for track in tracks]
    found = averaging_covariances(merge_clouds(single), merge_clouds(averaged), setup.n_averaged)
    begins = np.cumsum([0, *(len(times) for _, times in tracks)])
    held = np.concatenate(
        [
            begin + np.searchsorted(times, one.times_s)
            for begin, (_, times), one in zip(begins[:-1], tracks, single, strict=True)
        ]
    )
    nearest = np.searchsorted(held, np.arange(begins[-1]))
    return found[np.minimum(nearest, len(held) - 1)]


def _rms_mm(covariances: Floats) -> float:
    return float(np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean()))


def predict_skull_mm(session: Session) -> float | None:
    """Return the expected 3D RMS error, over the cloud, of a loaded skull that was registered.

    The fit's own error, and those of the pointer that shift all points alike. None without either.
    """
    registered, cloud = session.results.registration, session.results.surface
    pointer = predict_surface(session)
    if registered is None or cloud is None or pointer is None:
        return None
    points = cloud.value.points_base
    places = points[:: max(1, len(points) // PLACES)]
    fit_mm = registered.value.target_errors_mm(places)
    return float(np.sqrt((fit_mm**2).mean() + np.trace(pointer.common)))


def predicted_figures(session: Session) -> dict[str, float | None]:
    """Return the predicted errors under the keys of ``docs/metrics.md``; None where unknown."""
    tool, pointer = session.results.tool, session.results.pointer
    surface, thickness = predict_surface(session), thickness_shares(session)
    maps = expected_map_errors(session)
    return {
        "tool_tip_sigma_mm": None if tool is None else tool.value.tip_sigma_mm,
        "tracker_registration_sigma_mm": (
            None if tool is None else tool.value.registration_sigma_mm
        ),
        "pointer_tip_sigma_mm": None if pointer is None else pointer.value.tip_sigma_mm,
        "surface_sigma_predicted_mm": None if surface is None else surface.normal_mm,
        "skull_registration_sigma_mm": predict_skull_mm(session),
        "coverage_predicted_fraction": expected_coverage(session),
        "scan_duration_predicted_s": expected_duration(session),
        "thickness_sigma_predicted_mm": None if thickness is None else thickness.total_mm,
        "outer_sigma_predicted_mm": maps.get("outer"),
        "inner_sigma_predicted_mm": maps.get("inner"),
        "thickness_map_sigma_predicted_mm": maps.get("thickness"),
        **_landmark_figures(session),
        **_burr_figures(session),
        **head_figures(session),
    }


def _landmark_figures(session: Session) -> dict[str, float]:
    held = session.results.get("landmarks")
    if held is None:
        return {}
    check: LandmarkCheck = held.value
    return {"landmark_distance_mm": check.rms_mm, "landmark_sigma_mm": check.expected_rms_mm}


def _burr_figures(session: Session) -> dict[str, float]:
    held = session.results.get("burr")
    return {} if held is None else {"burr_tip_sigma_mm": held.value.tip_sigma_mm}


def frames_averaged(strokes: tuple[PointerCapture, ...], average_s: float) -> int:
    """Return how many frames the moving average of a cloud takes together, at least 1."""
    steps = np.concatenate([np.diff(stroke.marker.times_s) for stroke in strokes])
    if not len(steps) or average_s <= 0.0:
        return 1
    return 1 + 2 * int(average_s / 2.0 / np.median(steps) + 1e-9)


def _some_poses(strokes: tuple[PointerCapture, ...]) -> tuple[Ints, Poses]:
    """Return rows (n,) and poses of the pointer, spread evenly over all strokes."""
    seen = [stroke.marker.Ts_tracker_marker for stroke in strokes]
    rotations = np.concatenate([poses.rotations for poses in seen])
    translations = np.concatenate([poses.translations for poses in seen])
    rows = np.unique(np.linspace(0, max(len(rotations) - 1, 0), PLACES).round().astype(np.int64))
    rows = rows[: len(rotations)]
    return rows, Poses(rotations[rows], translations[rows])


def _along_normals(tips_base: Floats, cloud_base: Floats, covariances: Floats) -> float | None:
    # which side is outside does not matter for a variance
    field = NormalField(cloud_base, NORMAL_RADIUS_MM)
    normals = field.normals(tips_base, method="plane", outward=ANY_SIDE)
    if not normals.ok.any():
        return None
    n = normals.normals[normals.ok]
    variances = np.einsum("ni,nij,nj->n", n, covariances[normals.ok], n)
    return float(np.sqrt(variances.mean()))
