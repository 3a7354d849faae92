"""Calibration of the tracked hand-held probe: face and axis in the frame of its marker.

Two motions tell it. With a calibration point of the delay line's length in place of the line, the
probe pivots in a dimple: that gives the middle of the face. Turned about its own axis in a bush,
all poses agree on the direction of that axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.calibration.handheld.rotation_axis import RotationAxisFit, fit_rotation_axis
from rona_core.calibration.pivot.quality import Verdict
from rona_core.geometry.arrays import Floats, Vector3, readonly
from rona_core.geometry.pose import Pose, Poses

GOOD_AXIS_DEG = 0.5  # predicted; at 8 mm of bone it moves the inner boundary by 0.07 mm
BAD_AXIS_DEG = 1.5
WIDE_SPIN_DEG = 90.0  # from end to end
LOOSE_DEG = 0.5  # RMS; a bush leaves less
OFF_AXIS_MM = 2.0  # the calibration point may stand beside the axis by this
MANY_REJECTED = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class SonoCalibration:
    """The probe in the marker frame of the SonoPointer, and how well it is known."""

    T_sonomarker_probe: Pose  # z into the bone; the turn about z means nothing
    face: PointerCalibration  # the pivot that gave the middle of the face
    face_sigma_mm: float  # predicted 3D standard deviation of that place
    axis_sigma_deg: float  # predicted RMS angle of the axis to the true one
    spin_deg: float  # turned from end to end
    spin_rms_deg: float  # by which the axis wobbled
    spin_residuals_deg: Floats  # (m,) of every pose of the spin
    off_axis_mm: float  # between the middle of the face and the axis that it was turned about
    verdict: Verdict
    reasons: tuple[str, ...]  # why not good, and what to do about it


def calibrate_sono(
    pivot: Poses, spin: Poses, *, pointer: str, positions_marker: ArrayLike
) -> SonoCalibration:
    """Return where the probe is in its marker frame.

    Args:
        pivot: Poses (n) of the marker while the calibration point rests in the dimple, n >= 10.
        spin: Poses (m) of the marker while the probe turns about its own axis, m >= 20.
        pointer: Name of the tool.
        positions_marker: Marker geometry (k, 3) in mm.

    Raises:
        InvalidInputError: too few poses, or no geometry.
        DegenerateGeometryError: a pivot or a spin that tells too little, or that slipped.
    """
    face = calibrate_pointer(
        pivot, pointer=pointer, dof=6, positions_pointermarker=positions_marker
    )
    fit = fit_rotation_axis(spin)
    middle = np.asarray(positions_marker, dtype=np.float64).mean(axis=0)
    tip = face.tip_pointermarker
    down = fit.axis_marker if fit.axis_marker @ (tip - middle) > 0.0 else -fit.axis_marker
    beside = tip - fit.point_marker
    off_axis_mm = float(np.linalg.norm(beside - (beside @ down) * down))
    verdict, reasons = _judge(face, fit, off_axis_mm)
    return SonoCalibration(
        T_sonomarker_probe=Pose(_axes(down), tip),
        face=face,
        face_sigma_mm=face.tip_sigma_mm,
        axis_sigma_deg=fit.sigma_deg,
        spin_deg=fit.spin_deg,
        spin_rms_deg=fit.rms_deg,
        spin_residuals_deg=readonly(fit.residuals_deg),
        off_axis_mm=off_axis_mm,
        verdict=verdict,
        reasons=reasons,
    )


def _axes(z: Vector3) -> Floats:
    """Return a rotation (3, 3) with this z, x as near to that of the marker as that allows."""
    x = np.eye(3)[int(np.argmin(np.abs(z)))] if abs(z[0]) > 0.9 else np.array((1.0, 0.0, 0.0))
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def _judge(
    face: PointerCalibration, fit: RotationAxisFit, off_axis_mm: float
) -> tuple[Verdict, tuple[str, ...]]:
    reasons = [f"face: {reason}" for reason in face.reasons]
    bad = face.verdict == "bad"
    if fit.sigma_deg > GOOD_AXIS_DEG:
        bad = bad or fit.sigma_deg > BAD_AXIS_DEG
        reasons.append(
            f"the axis is known to {fit.sigma_deg:.2g} degrees only, {GOOD_AXIS_DEG:g} are wanted: "
            "turn the probe further and longer"
        )
    if fit.spin_deg < WIDE_SPIN_DEG:
        reasons.append(
            f"the probe was turned by {fit.spin_deg:.0f} degrees from end to end: turn it by "
            f"{WIDE_SPIN_DEG:.0f}"
        )
    if fit.rms_deg > LOOSE_DEG:
        reasons.append(
            f"the axis wobbled by {fit.rms_deg:.2g} degrees: hold the probe down in its bush"
        )
    lost = 1.0 - float(fit.used.mean())
    if lost > MANY_REJECTED:
        reasons.append(f"{lost:.0%} of the poses of the turn disagree: look for hidden markers")
    if off_axis_mm > OFF_AXIS_MM:
        reasons.append(
            f"the calibration point stands {off_axis_mm:.1f} mm beside the axis: seat it straight"
        )
    if bad:
        return "bad", tuple(reasons)
    return ("weak", tuple(reasons)) if reasons else ("good", ())
