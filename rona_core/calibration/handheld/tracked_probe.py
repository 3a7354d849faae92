"""Calibration of the tracked hand-held probe: face and axis in the frame of its marker.

Two motions are needed. With a calibration point of the delay line's length in place of the line,
the probe pivots in a dimple: that gives the middle of the face. Turned about its own axis in a
bush, all poses agree on the direction of that axis.

Rotation axis of a tracked body, from poses that turn about it. The direction a with the longest
mean of ``R a`` over all poses is the right singular vector of the mean rotation with the largest
singular value. Its sign is not determined by the poses.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.calibration.pivot.quality import Verdict
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3, readonly
from rona_core.geometry.pose import Pose, Poses

MIN_POSES = 20
LEAST_SPIN_DEG = 40.0  # from end to end; below it, play and noise turn the axis at will
MOST_WOBBLE_DEG = 5.0  # RMS; beyond it, the body did not turn about one axis
AWAY = 6.0  # median residuals beyond which a pose does not count
LEAST_RAD = 1e-4  # below the resolution of any tracker
ROUNDS = 3
BINS = 8  # poses in a bin share the errors that follow the turn, or the time
FITTED = 2  # complex numbers that the fit takes out of the bins


@dataclass(frozen=True, slots=True, eq=False)
class RotationAxisFit:
    """The axis of a body that was turned about it, in its ``marker`` frame."""

    axis_marker: Vector3  # (3,) unit length, of arbitrary sign
    point_marker: Vector3  # (3,) the point of the axis nearest to the origin of ``marker``
    residuals_deg: Floats  # (n,) angle between the axis in each pose and its mean
    used: Bools  # (n,)
    spin_deg: float  # from end to end
    rms_deg: float  # of the residuals that were used
    sigma_deg: float  # predicted RMS angle between this axis and the true one


def fit_rotation_axis(Ts_tracker_marker: Poses) -> RotationAxisFit:
    """Return the axis that a body was turned about.

    Args:
        Ts_tracker_marker: Poses (n) while it turned, in the order they were taken, n >= 20.

    Raises:
        InvalidInputError: too few poses.
        DegenerateGeometryError: it turned by less than 40 degrees, or not about one axis.
    """
    n = len(Ts_tracker_marker)
    if n < MIN_POSES:
        raise InvalidInputError(f"a spin needs at least {MIN_POSES} poses, not {n}")
    rotations = Ts_tracker_marker.rotations
    used: Bools = np.ones(n, dtype=np.bool_)
    axis, mean, residuals = _common(rotations, used)
    for _ in range(ROUNDS):
        now = np.asarray(residuals <= AWAY * max(float(np.median(residuals)), LEAST_RAD))
        if np.array_equal(now, used):
            break
        used = now
        axis, mean, residuals = _common(rotations, used)
    turns = _turns(rotations, axis, mean)
    spin_deg = float(np.rad2deg(np.ptp(turns[used])))
    if spin_deg < LEAST_SPIN_DEG:
        raise DegenerateGeometryError(
            f"the probe was turned by {spin_deg:.0f} degrees from end to end, {LEAST_SPIN_DEG:.0f} "
            "are the least: turn it further about its own axis"
        )
    rms_deg = float(np.rad2deg(np.sqrt(np.mean(residuals[used] ** 2))))
    if rms_deg > MOST_WOBBLE_DEG:
        raise DegenerateGeometryError(
            f"the probe wobbled by {rms_deg:.1f} degrees RMS: it must turn about its own axis only"
        )
    return RotationAxisFit(
        axis_marker=readonly(axis),
        point_marker=readonly(_point(Ts_tracker_marker.select(used), axis)),
        residuals_deg=readonly(np.rad2deg(residuals)),
        used=readonly(used),
        spin_deg=spin_deg,
        rms_deg=rms_deg,
        sigma_deg=_sigma_deg(rotations[used], axis, mean),
    )


def _common(rotations: Floats, used: Bools) -> tuple[Floats, Floats, Floats]:
    """Return the common axis in ``marker`` and ``tracker``, and each pose's angle (n,) to it."""
    U, _, Vt = np.linalg.svd(rotations[used].mean(axis=0))
    axis, mean = Vt[0], U[:, 0]
    axes_tracker = rotations @ axis
    sines = np.linalg.norm(axes_tracker - (axes_tracker @ mean)[:, None] * mean, axis=1)
    return axis, mean, np.arctan2(sines, axes_tracker @ mean)


def _across(z: Floats) -> tuple[Floats, Floats]:
    """Return two directions that make right-handed axes with the third, z."""
    x = np.linalg.svd(z[None])[2][1]
    return x, np.asarray(np.cross(z, x), dtype=np.float64)


def _turns(rotations: Floats, axis: Floats, mean: Floats) -> Floats:
    """Return by how much (n,) each pose is turned about the axis in rad, from their middle."""
    x, y = _across(mean)
    arms_tracker = rotations @ _across(axis)[0]
    turns = np.exp(1j * np.arctan2(arms_tracker @ y, arms_tracker @ x))
    return np.angle(turns / np.exp(1j * np.angle(turns.mean())))


def _point(Ts_tracker_marker: Poses, axis: Floats) -> Floats:
    """Return the point (3,) of the axis, nearest to the origin, that stayed at one place."""
    rotations, translations = Ts_tracker_marker.rotations, Ts_tracker_marker.translations
    across = np.linalg.svd(axis[None])[2][1:].T  # (3, 2)
    n = len(rotations)
    design = np.concatenate((rotations @ across, -np.broadcast_to(np.eye(3), (n, 3, 3))), axis=2)
    found = np.linalg.lstsq(design.reshape(-1, 5), -translations.ravel())[0]
    return np.asarray(across @ found[:2], dtype=np.float64)


def _sigma_deg(rotations: Floats, axis: Floats, mean: Floats) -> float:
    """Return the predicted RMS angle between the axis and the true one.

    Seen along it, with directions across it as complex numbers, an axis that is off by a leaves
    ``b - a exp(i turn)`` in each pose, where b is the error of the mean: linear least squares.
    Neighbouring poses err alike, by how far they are turned (the field of the tracker) or in time
    (the play of the bush); the larger of both variances counts.
    """
    (x, y), (arm, _) = _across(mean), _across(axis)
    axes_tracker, arms = rotations @ axis, rotations @ arm
    errors = axes_tracker @ x + 1j * (axes_tracker @ y)
    turned = arms @ x + 1j * (arms @ y)
    turned = turned / np.abs(turned)
    parts = turned - turned.mean()
    scores = parts.conj() * errors
    order = np.arange(len(scores))
    by_turn = np.zeros_like(order)
    by_turn[np.argsort(np.angle(turned / turned.mean()), kind="stable")] = order
    variance = max(_clustered(scores, by_turn), _clustered(scores, order))
    information = float((np.abs(parts) ** 2).sum())
    return float(np.rad2deg(np.sqrt(variance) / information))


def _clustered(scores: np.typing.NDArray[np.complex128], ranks: Ints) -> float:
    """Return the variance of the sum of scores (n,), alike among those of neighbouring ranks."""
    total = 0.0
    for counted in (ranks, len(ranks) - 1 - ranks):  # the same from either end
        bins = counted * BINS // len(ranks)
        sums = np.bincount(bins, scores.real) + 1j * np.bincount(bins, scores.imag)
        total += 0.5 * float((np.abs(sums) ** 2).sum())
    return total * BINS / (BINS - FITTED)


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
        DegenerateGeometryError: a pivot or a rotation that is too small, or that slipped.
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
