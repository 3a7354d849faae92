"""Result of a pivot calibration, with the rejected poses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.pivot.quality import Verdict
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3

EXCLUDED, AWAY = "excluded by hand", "away from the common tip"


@dataclass(frozen=True, slots=True)
class RejectedPose:
    """One pose that does not count, and why."""

    index: int
    residual_mm: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class PivotFit:
    """Tip of a body in its marker frame, and the place it swung about."""

    tip_marker: Vector3  # (3,) mm
    pivot_tracker: Vector3  # (3,) mm
    covariance: Floats  # (6, 6) mm^2 of tip (in marker), then pivot (in tracker)
    residuals_mm: Floats  # (n,) distance of the tip, mapped by each pose, from the pivot
    used: Bools  # (n,) False for poses that do not count
    rejected: tuple[RejectedPose, ...]  # those, and why
    rmse_mm: float  # of the residuals that were used
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip
    cone_deg: float  # half-angle covered by the lever
    marker_sigma_mm: float | None  # 3D RMS of one marker, estimated; only "ml"
    verdict: Verdict
    reasons: tuple[str, ...]  # why not good, and what to do about it


def rejected_poses(residuals: Floats, used: Bools, keep: Bools) -> tuple[RejectedPose, ...]:
    """Return every pose that does not count.

    Args:
        residuals: (n,) distance of the tip from the pivot in mm.
        used: (n,) which poses count.
        keep: (n,) which poses were not excluded by hand.
    """
    return tuple(
        RejectedPose(int(row), float(residuals[row]), AWAY if keep[row] else EXCLUDED)
        for row in np.flatnonzero(~used)
    )


def as_keep(exclude: ArrayLike | None, n: int) -> Bools:
    """Return the poses (n,) that may count.

    Raises:
        InvalidInputError: ``exclude`` is no mask of n poses.
    """
    if exclude is None:
        return np.ones(n, dtype=np.bool_)
    mask = np.asarray(exclude)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidInputError(f"exclude must be bool of shape ({n},), not {mask.shape}")
    return ~mask
