"""What the results of a session say about the error of the pointer's map, without any truth.

The covariances of registration and pointer, and the noise of a single frame, are chained as
``error_propagation.py`` does, at places that the pointer has touched. What repeats leaves no
trace in the data: for the tracker's volume the accuracy that its maker states is taken, less the
noise that was found; the robot's absolute error is not in it, as in a map for the same robot.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.app.dependencies.base_reference import TrackerReference, weakest_reference
from rona_core.app.steps.acoustics.thickness_uncertainty import thickness_shares
from rona_core.calibration.error_propagation import MapSetup, predict_map_error
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.tracker_volumes import ACCURACY_MM
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember
from rona_core.surface.cloud import SurfaceCloud
from rona_core.surface.normals.normals import NormalField

PLACES = 120  # touched places that stand for all
NORMAL_RADIUS_MM = 10.0
ANY_SIDE = (0.0, 0.0, 1.0)
MIN_SIGMA_MM = 1e-6  # of a marker, where a perfect tracker leaves no scatter


@dataclass(frozen=True, slots=True)
class SurfacePrediction:
    """Expected errors of the pointer's cloud in mm; 3D RMS but for the first."""

    normal_mm: float | None  # RMS along the normals of the surface; None where there are none
    rms_mm: float
    registration_mm: float  # the part of the registration of robot and tracker
    pointer_mm: float  # the part of the calibrated tip
    frame_mm: float  # the part of the frames that were averaged
    stated_mm: float  # what averaging leaves, by the accuracy that the tracker's maker states
    frames: int  # so many are averaged at each place


def predict_surface(session: Session) -> SurfacePrediction | None:
    """Return the expected error of the surface cloud; None while a result it needs is missing."""
    results, strokes = session.results, session.captures.surface
    tool, pointer, cloud = results.tool, results.pointer, results.surface
    if tool is None or pointer is None or cloud is None or not len(cloud.value.points_base):
        return None
    if any(stroke.pointer != pointer.value.pointer for stroke in strokes):
        return None
    stated_mm = ACCURACY_MM[session.setup.devices.tracker.profile]
    found = _predict(tool.value, pointer.value, cloud.value, strokes, stated_mm)
    return found if found is None else _moved(found, weakest_reference(session, strokes))


def _moved(found: SurfacePrediction, reference: TrackerReference | None) -> SurfacePrediction:
    """Add what a move of the tracker since the registration costs, the same in all directions."""
    if reference is None or reference.state != "carried":
        return found
    added_mm, normal_mm = reference.added_mm, found.normal_mm
    return replace(
        found,
        normal_mm=None if normal_mm is None else float(np.hypot(normal_mm, added_mm / 3.0**0.5)),
        rms_mm=float(np.hypot(found.rms_mm, added_mm)),
        registration_mm=float(np.hypot(found.registration_mm, added_mm)),
    )


@remember(4)
def _predict(
    tool: ToolRegistration,
    pointer: PointerCalibration,
    cloud: SurfaceCloud,
    strokes: tuple[PointerCapture, ...],
    stated_mm: float,
) -> SurfacePrediction | None:
    poses = _some_poses(strokes)
    if not len(poses):
        return None
    sigma_mm = pointer.marker_sigma_mm or tool.marker_sigma_mm
    setup = MapSetup(
        T_base_tracker=tool.T_base_tracker,
        registration=tool.covariance,
        tip_pointermarker=pointer.tip_pointermarker,
        tip_covariance=pointer.tip_covariance_pointermarker,
        positions_pointermarker=GEOMETRIES[pointer.pointer].positions_marker,
        noise=MarkerNoise(sigma_mm=max(sigma_mm, MIN_SIGMA_MM)),
        n_averaged=frames_averaged(strokes, cloud.average_s),
        bias_mm=float(np.sqrt(max(stated_mm**2 - sigma_mm**2, 0.0))),
    )
    found = predict_map_error(setup, poses)
    tips_base = setup.T_base_tracker @ (poses @ setup.tip_pointermarker)
    return SurfacePrediction(
        normal_mm=_along_normals(tips_base, cloud.points_base, found.total),
        rms_mm=found.rms_mm,
        registration_mm=found.registration_rms_mm,
        pointer_mm=found.pointer_rms_mm,
        frame_mm=found.frame_rms_mm,
        stated_mm=setup.bias_mm,
        frames=setup.n_averaged,
    )


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
    alike = (pointer.registration_mm, pointer.pointer_mm, pointer.stated_mm)
    return float(np.sqrt((fit_mm**2).mean() + sum(part**2 for part in alike)))


def predicted_figures(session: Session) -> dict[str, float | None]:
    """Return the predicted errors under the keys of ``docs/metrics.md``; None where unknown."""
    tool, pointer = session.results.tool, session.results.pointer
    surface, thickness = predict_surface(session), thickness_shares(session)
    return {
        "tool_tip_sigma_mm": None if tool is None else tool.value.tip_sigma_mm,
        "pointer_tip_sigma_mm": None if pointer is None else pointer.value.tip_sigma_mm,
        "surface_sigma_predicted_mm": None if surface is None else surface.normal_mm,
        "skull_registration_sigma_mm": predict_skull_mm(session),
        "thickness_sigma_predicted_mm": None if thickness is None else thickness.total_mm,
    }


def frames_averaged(strokes: tuple[PointerCapture, ...], average_s: float) -> int:
    """Return how many frames the moving average of a cloud takes together, at least 1."""
    steps = np.concatenate([np.diff(stroke.marker.times_s) for stroke in strokes])
    if not len(steps) or average_s <= 0.0:
        return 1
    return 1 + 2 * int(average_s / 2.0 / np.median(steps) + 1e-9)


def _some_poses(strokes: tuple[PointerCapture, ...]) -> Poses:
    """Return poses of the pointer, spread evenly over all strokes."""
    seen = [stroke.marker.Ts_tracker_marker for stroke in strokes]
    rotations = np.concatenate([poses.rotations for poses in seen])
    translations = np.concatenate([poses.translations for poses in seen])
    rows = np.unique(np.linspace(0, max(len(rotations) - 1, 0), PLACES).round().astype(np.int64))
    rows = rows[: len(rotations)]
    return Poses(rotations[rows], translations[rows])


def _along_normals(tips_base: Floats, cloud_base: Floats, covariances: Floats) -> float | None:
    # which side is outside does not matter for a variance
    field = NormalField(cloud_base, NORMAL_RADIUS_MM)
    normals = field.normals(tips_base, method="ols", outward=ANY_SIDE)
    if not normals.ok.any():
        return None
    n = normals.normals[normals.ok]
    variances = np.einsum("ni,nij,nj->n", n, covariances[normals.ok], n)
    return float(np.sqrt(variances.mean()))
