"""Tool centre point (TCP) on the flange, by turning the tool about a seat that holds its tip.

    T_base_tip(i) offset = seat        for every pose i

Linear in both unknowns, the offset of the true tip in the frame ``tip`` that the robot believes,
and the seat in ``base``. Industrial robots calibrate the centre of a tool so (the fixed-point or
four-point method, Mooring 1991). A tracker that sees a marker on the tool cannot take its place: a
marker on the flange moves as the flange does, wherever the tip is. Only the seat knows where it is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.pivot.motion_extent import cap_half_angle_deg, require_swing
from rona_core.calibration.pivot.pivot_calibration import as_keep
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.pose import Poses

MIN_POSES = 5  # three would do, but leave hardly a residual to tell the scatter by


@dataclass(frozen=True, slots=True, eq=False)
class SeatedTip:
    """Where a seat held the tip of a tool, and how errors of the robot move that."""

    offset_tip: Vector3  # (3,) of the true tip, in ``tip`` as the robot believes it, in mm
    seat_base: Vector3  # (3,) mm
    covariance: Floats  # (3, 3) mm^2 of the offset by chance, as the residuals tell
    by_robot: Floats  # (3, n, 3) derivatives of its error by those of the robot's tip in ``base``
    residuals_mm: Floats  # (n,) distance of the tip from the seat, of every pose
    rmse_mm: float  # of those used
    cone_deg: float  # half-angle over which the tool was turned
    used: Bools  # (n,)


def solve_seated_tip(Ts_base_tip: Poses, exclude: ArrayLike | None = None) -> SeatedTip:
    """Return the offset of a tip that a seat held at n poses of the robot.

    Args:
        Ts_base_tip: Tip as the robot believes it, n poses.
        exclude: (n,) True for poses that must not count; they have a residual all the same.

    Raises:
        InvalidInputError: too few poses.
        DegenerateGeometryError: the tool hardly turned, or about one axis only.
    """
    keep = as_keep(exclude, len(Ts_base_tip))
    n = int(keep.sum())
    if n < MIN_POSES:
        raise InvalidInputError(
            f"the tip of a tool needs at least {MIN_POSES} poses in its seat, not {n}"
        )
    kept = Ts_base_tip.select(keep)
    require_swing(kept.rotations, 6)
    held = np.broadcast_to(-np.eye(3), (n, 3, 3))
    A = np.concatenate((kept.rotations, held), axis=2).reshape(3 * n, 6)
    inverse = np.linalg.pinv(A)
    offset, seat = np.split(-inverse @ kept.translations.ravel(), 2)
    misses = Ts_base_tip @ offset - seat
    squares = float((misses[keep] ** 2).sum())
    by_robot = np.zeros((3, len(keep), 3))
    by_robot[:, keep] = inverse[:3].reshape(3, n, 3)
    return SeatedTip(
        offset_tip=readonly(offset),
        seat_base=readonly(seat),
        covariance=readonly(squares / (3 * n - 6) * (inverse @ inverse.T)[:3, :3]),
        by_robot=readonly(by_robot),
        residuals_mm=readonly(np.linalg.norm(misses, axis=1)),
        rmse_mm=float(np.sqrt(squares / n)),
        cone_deg=cap_half_angle_deg(kept.rotations[:, :, 2]),
        used=readonly(keep),
    )
