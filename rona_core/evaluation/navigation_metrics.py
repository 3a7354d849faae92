"""Figures of steps 2 to 4: calibrations and the pointer's cloud against the truth."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rona_core.devices.settings import TrackerPlace
from rona_core.evaluation.figures import Figures, rms
from rona_core.evaluation.true_tips import true_tips_base
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose

if TYPE_CHECKING:
    from rona_core.app.steps.implant.burr.registration import BurrRegistration
    from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
    from rona_core.calibration.handheld.pointer import PointerCalibration
    from rona_core.calibration.surface_registration import SurfaceRegistration
    from rona_core.geometry.surface.cloud import SurfaceCloud
    from rona_core.session.captures import PointerCapture


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
