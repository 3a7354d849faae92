"""Pose coverage of a pivot motion, and the next best pose.

Directions of the shaft, from the tip to the markers, are given as a tilt from their middle and an
azimuth about it: 0 degrees is away from the tracker (its +z), 90 degrees is to the side of +x.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.pivot.maximum_likelihood import tip_information
from rona_core.calibration.tracking_error import MarkerNoise, tracked_from_poses
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_vector3, readonly
from rona_core.geometry.pose import Pose, Poses

RINGS_DEG = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0)
SECTORS = 12
CENTRAL_DEG = 3.0  # tilts below this have no azimuth worth counting
CANDIDATE_TILTS_DEG = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0)
MIN_LENGTH_MM = 1.0
IN_LINE = 0.1  # sine of the angle between shaft and line of sight, below which words fail


@dataclass(frozen=True, slots=True, eq=False)
class SwingCoverage:
    """Directions of the shaft by tilt and azimuth, for a picture."""

    tilts_deg: Floats  # (n,)
    azimuths_deg: Floats  # (n,) 0 to 360
    rings_deg: tuple[float, ...]  # of the picture
    gap_deg: float  # the widest range of azimuths into which the shaft was not tilted
    gap_azimuth_deg: float  # its middle


@dataclass(frozen=True, slots=True, eq=False)
class NextPose:
    """Next best pose: the tilt with most information on the tip."""

    tilt_deg: float  # from the middle of the swing so far
    azimuth_deg: float
    words: str
    tip_sigma_mm: float  # predicted, after it has been taken
    tip_sigma_before_mm: float


def swing_coverage(Ts_tracker_marker: Poses, tip_marker: ArrayLike) -> SwingCoverage:
    """Return which directions the shaft of a swing has covered.

    Args:
        Ts_tracker_marker: n poses of the swinging marker, at least one.
        tip_marker: The tip (3,) in mm; roughly is enough.

    Raises:
        InvalidInputError: no poses.
        DegenerateGeometryError: a tip in the origin of the marker, or opposite directions.
    """
    shafts = _shafts(Ts_tracker_marker, as_vector3(tip_marker, name="tip_marker"))
    axis, aside, across = _frame(shafts)
    tilts = np.rad2deg(np.arctan2(np.hypot(shafts @ aside, shafts @ across), shafts @ axis))
    azimuths = np.rad2deg(np.arctan2(shafts @ across, shafts @ aside)) % 360.0
    gap_deg, gap_azimuth_deg = _widest_gap(azimuths[tilts >= CENTRAL_DEG])
    return SwingCoverage(
        tilts_deg=readonly(tilts),
        azimuths_deg=readonly(azimuths),
        rings_deg=RINGS_DEG,
        gap_deg=gap_deg,
        gap_azimuth_deg=gap_azimuth_deg,
    )


def next_best_pose(
    Ts_tracker_marker: Poses,
    tip_marker: ArrayLike,
    positions_marker: ArrayLike,
    *,
    dof: int,
    sigma_mm: float,
) -> NextPose:
    """Return the tilt that would lower the predicted error of the tip most.

    Candidates are tilts of the middle orientation by 5 to 30 degrees in 12 azimuths.

    Args:
        Ts_tracker_marker: Poses taken so far, at least 3 that differ (2 for 5D).
        tip_marker: The tip (3,) in mm as far as it is known.
        positions_marker: Marker geometry (m, 3) in mm.
        dof: 6, or 5 for collinear markers.
        sigma_mm: 3D RMS of one marker, as the calibration reports it.

    Raises:
        InvalidInputError: no poses.
        DegenerateGeometryError: the poses so far leave the tip open.
    """
    tip = as_vector3(tip_marker, name="tip_marker")
    axis, aside, across = _frame(_shafts(Ts_tracker_marker, tip))
    noise = MarkerNoise()
    tracked = tracked_from_poses(Ts_tracker_marker, positions_marker, noise, dof=dof)
    known = tip_information(tracked, tip, dof=dof).sum(axis=0)
    if np.linalg.cond(known) > 1e12:
        raise DegenerateGeometryError(
            "the poses so far leave the tip open: swing in all directions"
        )
    azimuths_deg = np.arange(SECTORS) * (360.0 / SECTORS)
    tried_deg = [(tilt, azimuth) for tilt in CANDIDATE_TILTS_DEG for azimuth in azimuths_deg]
    candidates = _tilted(Ts_tracker_marker, tried_deg, (axis, aside, across))
    more = tip_information(
        tracked_from_poses(candidates, positions_marker, noise, dof=dof), tip, dof=dof
    )
    k = known.shape[0] - 3
    after: Floats = np.trace(np.linalg.inv(known + more)[:, :k, :k], axis1=1, axis2=2)
    best = int(after.argmin())
    tilt_deg, azimuth_deg = tried_deg[best]
    words = f"tilt the markers {tilt_deg:.0f} degrees {_words(azimuth_deg, axis)}"
    return NextPose(
        tilt_deg=float(tilt_deg),
        azimuth_deg=float(azimuth_deg),
        words=words,
        tip_sigma_mm=float(sigma_mm * np.sqrt(after[best])),
        tip_sigma_before_mm=float(sigma_mm * np.sqrt(np.trace(np.linalg.inv(known)[:k, :k]))),
    )


def _tilted(
    Ts_tracker_marker: Poses,
    tilts_and_azimuths_deg: list[tuple[float, float]],
    frame: tuple[Vector3, Vector3, Vector3],
) -> Poses:
    """Return the middle orientation of poses, tilted by angles towards azimuths."""
    axis, aside, across = frame
    middle = Pose(Ts_tracker_marker.mean().rotation, np.zeros(3))
    turns = [
        np.deg2rad(tilt) * np.cross(axis, _toward(azimuth, aside, across))
        for tilt, azimuth in tilts_and_azimuths_deg
    ]
    return Poses.stack([Pose.from_rotvec(turn) @ middle for turn in turns])


def _shafts(Ts_tracker_marker: Poses, tip: Vector3) -> Floats:
    """Return the unit vectors (n, 3) from the tip to the origin of the markers."""
    if not len(Ts_tracker_marker):
        raise InvalidInputError("the coverage of no poses was asked for")
    length = float(np.linalg.norm(tip))
    if length < MIN_LENGTH_MM:
        raise DegenerateGeometryError(f"the tip lies {length:.2g} mm from the markers: no shaft")
    return Ts_tracker_marker.rotations @ (-tip / length)


def _frame(shafts: Floats) -> tuple[Vector3, Vector3, Vector3]:
    """Return the middle of directions (n, 3) and two unit vectors across it.

    The first lies as far away from the tracker as it can, the second completes a right-handed
    frame; where the middle is the line of sight itself, +y takes the place of depth.
    """
    mean = shafts.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < 1e-6:
        raise DegenerateGeometryError("the directions of the shaft cancel: no middle")
    axis = mean / length
    depth = np.array((0.0, 0.0, 1.0)) if _has_depth(axis) else np.array((0.0, 1.0, 0.0))
    aside = depth - (depth @ axis) * axis
    aside /= np.linalg.norm(aside)
    across = np.cross(axis, aside)
    # the azimuth grows towards +x of the tracker, from whichever side the shaft stands
    return axis, aside, across if across[0] >= 0.0 else -across


def _has_depth(axis: Vector3) -> bool:
    return bool(np.hypot(axis[0], axis[1]) > IN_LINE)


def _toward(azimuth_deg: float, aside: Vector3, across: Vector3) -> Vector3:
    angle = np.deg2rad(azimuth_deg)
    return np.cos(angle) * aside + np.sin(angle) * across


def _words(azimuth_deg: float, axis: Vector3) -> str:
    """Say a direction with what a person sees: the tracker; its own axes only to the sides."""
    if not _has_depth(axis):
        return f"towards {azimuth_deg:.0f} degrees, counted from +y to +x of the tracker"
    sides = ("away from the tracker", "to its +x side", "towards the tracker", "to its -x side")
    nearest = round(azimuth_deg / 90.0) % 4
    off = (azimuth_deg - 90.0 * nearest + 180.0) % 360.0 - 180.0
    if abs(off) < 20.0:
        return sides[nearest]
    other = (nearest + (1 if off > 0 else -1)) % 4
    return f"{sides[nearest]} and somewhat {sides[other]}"


def _widest_gap(azimuths_deg: Floats) -> tuple[float, float]:
    """Return width and middle of the widest range of azimuths that is empty."""
    if not len(azimuths_deg):
        return 360.0, 180.0
    around = np.sort(azimuths_deg)
    gaps = np.diff(around, append=around[0] + 360.0)
    widest = int(gaps.argmax())
    return float(gaps[widest]), float((around[widest] + gaps[widest] / 2.0) % 360.0)
