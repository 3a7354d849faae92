"""Robot-world/hand-eye calibration by weighted least squares over poses seen by both.

    T_base_tip = T_base_tracker T_tracker_toolmarker T_toolmarker_tip

Every pose takes part with its turn and its shift, weighted by what its markers and the robot can
know (Gauss-Newton on the deviation of both unknown poses), from any motion with two axes of turn.
Gross errors are found by least median of squares and dropped; what is left gives the size of the
noise and the joint covariance of the two poses.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.hand_eye.initial_guess import first_guess
from rona_core.calibration.hand_eye.quality import require_two_axes
from rona_core.calibration.hand_eye.residuals import (
    Observations,
    jacobians,
    moved,
    observe,
    residuals,
    robot_covariances,
    tangent_at_tracker,
)
from rona_core.calibration.hand_eye.robust_weights import (
    DOF,
    GROSS,
    sigma_by_mean,
    sigma_by_median,
    spectrum,
)
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_points, readonly
from rona_core.geometry.pose import Pose, Poses

UNKNOWNS = 12
MIN_POSES = 4
MIN_SHARE = 0.6  # of the poses that must agree
MAX_SIGMA_MM = 5.0  # of a marker; ten times that of a poor tracker
MAX_STEPS = 50
SETTLE_STEPS = 20  # after these the choice of poses stays
STEP_TOLERANCE = 1e-12  # of turns in rad, and of shifts in metres
MM_PER_RAD = 1e3
TURNS = np.tile(np.repeat((True, False), 3), 2)
MIN_WIDTH = 0.01  # width over length of the marker plate
TOOL_MARKERS = GEOMETRIES["toolmarker"].positions_marker
TYPICAL = MarkerNoise()


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeFit:
    """Tracker in ``base`` and tip in ``toolmarker``, with the errors they share.

    ``covariance`` is that of the deviation (12,): of ``T_base_tracker``, then of
    ``T_toolmarker_tip``, each (rx, ry, rz, tx, ty, tz) in rad and mm, see
    geometry/pose_covariance.py.
    """

    T_base_tracker: Pose
    T_toolmarker_tip: Pose
    covariance: Floats  # (12, 12)
    center_base: Floats  # (3,) mean of the robot's tip positions that were used
    marker_sigma_mm: float  # 3D RMS error of one marker, estimated from the residuals
    chi_square: (
        float  # over its degrees of freedom: 1, or less where the robot errs less than assumed
    )
    residuals: Floats  # (n, 6) measured minus expected marker pose in tracker: rad, mm of centroid
    distances: Floats  # (n,) size of these in deviations, as the model expects them
    used: Bools  # (n,) False for gross errors

    @property
    def rejected(self) -> tuple[int, ...]:
        """Return the numbers of the poses that were dropped."""
        return tuple(int(i) for i in np.flatnonzero(~self.used))


def solve_hand_eye(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    *,
    positions_toolmarker: ArrayLike = TOOL_MARKERS,
    noise: MarkerNoise = TYPICAL,
) -> HandEyeFit:
    """Return tracker in ``base`` and tip in ``toolmarker`` from poses seen by both.

    Args:
        Ts_base_tip: Tool tip as the robot knows it, n >= 4 poses with turns about two axes.
        Ts_tracker_toolmarker: Tool marker as the tracker sees it, the same n poses.
        positions_toolmarker: Markers (m, 3), m >= 3, not on one line.
        noise: Of one marker; its size is taken from the residuals.

    Raises:
        InvalidInputError: different numbers of poses, or too few.
        DegenerateGeometryError: the tool stood still or turned about one axis only (the message
            names what stays open), or fewer than 60 % of the poses agree.
    """
    n = len(Ts_base_tip)
    if len(Ts_tracker_toolmarker) != n:
        raise InvalidInputError(
            f"robot and tracker must have as many poses: {n} and {len(Ts_tracker_toolmarker)}"
        )
    if n < MIN_POSES:
        raise InvalidInputError(f"a registration needs at least {MIN_POSES} poses, not {n}")
    positions = _as_markers(positions_toolmarker)
    require_two_axes(Ts_base_tip.rotations, Ts_tracker_toolmarker.rotations)
    observations = observe(Ts_base_tip, Ts_tracker_toolmarker, positions, noise)
    return _refine(observations, *first_guess(Ts_base_tip, Ts_tracker_toolmarker))


def _refine(observations: Observations, T_base_tracker: Pose, T_toolmarker_tip: Pose) -> HandEyeFit:
    """Iterate weights, choice of poses and both unknowns until none of them changes."""
    used = np.ones(len(observations), dtype=np.bool_)
    for step in range(MAX_STEPS):
        e = residuals(observations, T_base_tracker, T_toolmarker_tip)
        robot = robot_covariances(observations, T_base_tracker, T_toolmarker_tip)
        sizes = spectrum(e, observations.unit_covariances, robot)
        before = used
        if step < SETTLE_STEPS:
            # the unknowns take their share of what is left over
            rough = sigma_by_median(sizes) / np.sqrt(1.0 - UNKNOWNS / (DOF * len(observations)))
            used = sizes.distances(rough) <= GROSS
            _require_agreement(used)
        sigma = sigma_by_mean(sizes, used, UNKNOWNS)
        center = observations.Ts_base_tip.translations[used].mean(axis=0)
        J = jacobians(observations, T_base_tracker, T_toolmarker_tip, e[:, :3], center)[used]
        weighted = np.linalg.inv(sigma**2 * observations.unit_covariances + robot)[used] @ J
        information = np.einsum("nij,nik->jk", J, weighted)
        change = -np.linalg.solve(information, np.einsum("nij,ni->j", weighted, e[used]))
        size = max(np.abs(change[TURNS]).max(), np.abs(change[~TURNS]).max() / MM_PER_RAD)
        if size < STEP_TOLERANCE and np.array_equal(before, used):
            break
        T_base_tracker, T_toolmarker_tip = moved(T_base_tracker, T_toolmarker_tip, change, center)
    else:
        raise DegenerateGeometryError(
            "robot and tracker find no registration that stays: the poses tell too little"
        )
    distances = sizes.distances(sigma)
    chi_square = float(distances[used].sum() / (DOF * used.sum() - UNKNOWNS))
    _require_belief(sigma * np.sqrt(max(1.0, chi_square)))
    change = tangent_at_tracker(T_base_tracker, center)
    covariance = chi_square * change @ np.linalg.inv(information) @ change.T
    return HandEyeFit(
        T_base_tracker=T_base_tracker,
        T_toolmarker_tip=T_toolmarker_tip,
        covariance=readonly((covariance + covariance.T) / 2.0),
        center_base=readonly(center),
        marker_sigma_mm=float(sigma),
        chi_square=chi_square,
        residuals=readonly(e),
        distances=readonly(np.sqrt(distances)),
        used=readonly(used),
    )


def _require_agreement(used: Bools) -> None:
    if used.sum() < max(MIN_POSES, MIN_SHARE * len(used)):
        raise DegenerateGeometryError(
            f"only {int(used.sum())} of {len(used)} poses agree on where the tracker and the tip "
            "are: the marker or the tracker has moved, or another tool was tracked"
        )


def _require_belief(sigma_mm: float) -> None:
    if sigma_mm > MAX_SIGMA_MM:
        raise DegenerateGeometryError(
            f"robot and tracker do not agree: single markers would be off by {sigma_mm:.1f} mm; "
            "the marker or the tracker has moved, or the two were not read at the same time"
        )


def _as_markers(positions_toolmarker: ArrayLike) -> Floats:
    """Return the markers (m, 3) after checking that they determine a turn."""
    positions = as_points(positions_toolmarker, at_least=3, name="positions_toolmarker")
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    if spread[1] <= MIN_WIDTH * spread[0]:
        raise DegenerateGeometryError("the markers lie on one line: the turn about it is unseen")
    return positions
