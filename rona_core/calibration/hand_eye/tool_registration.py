"""Registration of robot and tracker: tracker in ``base`` and tip in ``toolmarker``.

The robot pivots its tool about the tip, then translates it along tool x and tool y. By default all
poses are solved together; the published method (a pivot and two lines) stays for comparison.
"""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.hand_eye.base_marker import BaseReference
from rona_core.calibration.hand_eye.hand_eye import (
    TOOL_MARKERS,
    TYPICAL,
    HandEyeFit,
    solve_hand_eye,
)
from rona_core.calibration.hand_eye.published_method import angle_deg, bootstrap, solve_paper
from rona_core.calibration.hand_eye.quality import judge_registration, registration_sigma_mm
from rona_core.calibration.hand_eye.residuals import observe
from rona_core.calibration.hand_eye.robust_weights import FLOOR_MM
from rona_core.calibration.pivot.pivot_calibration import as_keep
from rona_core.calibration.pivot.sphere_fit import cap_half_angle_deg
from rona_core.calibration.timing.time_offset import TimeOffset
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.rigid_fit import LineFit, fit_line_direction

ToolMethod = Literal["joint", "paper"]
METHODS: tuple[ToolMethod, ...] = get_args(ToolMethod)
MIN_TRAVEL_MM = 10.0  # along a line, for its direction to be determined


@dataclass(frozen=True, slots=True, eq=False)
class ToolRegistration:
    """Tracker in ``base``, tip in ``toolmarker``, and what the data leave over."""

    method: str
    T_base_tracker: Pose
    T_toolmarker_tip: Pose
    pivot_rmse_mm: float | None  # scatter of the tip about its pivot; None without a pivot
    axes_angle_deg: float | None  # between the two measured directions; 90 if all were perfect
    line_rmse_mm: float | None  # distance of the marker from the two lines; None without them
    n_poses: int
    residuals_mm: Floats  # (n,) tip by the tracker, mapped to base, minus tip by the robot
    rmse_mm: float  # of those that were used
    cone_deg: float  # half-angle of the pivot
    travel_mm: tuple[float, float]  # along tool x and y
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip in toolmarker
    covariance: (
        Floats  # (12, 12) of T_base_tracker, then T_toolmarker_tip: geometry/pose_covariance.py
    )
    registration_sigma_mm: float  # predicted 3D RMS error in base of places 100 mm about the tips
    # 3D RMS error of one marker, estimated; at its bound the robot explains all residuals
    marker_sigma_mm: float = field(metadata={"least": FLOOR_MM})
    used: Bools  # (n,) False for poses excluded, or dropped as gross errors
    verdict: Literal["good", "weak", "bad"]
    reasons: tuple[str, ...]  # of a verdict that is not good, each with its remedy
    base: BaseReference | None = None  # the base marker meanwhile; None: it was not seen
    delay: TimeOffset | None = None  # of the tracker behind the robot; None: undetermined
    # (12, 12) the part of the covariance that more poses lessen; None: all of it
    random_covariance: Floats | None = field(default=None, metadata={"omit_empty": True})


def register_tool(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    phases: ArrayLike | None = None,
    *,
    method: ToolMethod = "joint",
    noise: MarkerNoise = TYPICAL,
    exclude: ArrayLike | None = None,
) -> ToolRegistration:
    """Return the registration of robot, tool and tracker from poses seen by both.

    Args:
        Ts_base_tip: Tool tip as the robot knows it, n poses.
        Ts_tracker_toolmarker: Tool marker as the tracker sees it, the same n poses.
        phases: (n,) 0 pivot about the tip, 1 translation along tool x, 2 along tool y. The method
            "joint" needs none: any motion with turns about two axes will do.
        method: "joint" (all poses together, weighted, robust) or "paper" (pivot and two lines).
        noise: Of one marker; its size is taken from the residuals.
        exclude: (n,) True for poses that must not count; they have a residual all the same.

    Raises:
        InvalidInputError: different numbers of poses, unknown phase or method, too few poses.
        DegenerateGeometryError: the motion does not determine the answer, or too few poses agree.
    """
    if method not in METHODS:
        raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    chosen = _as_phases(phases, Ts_base_tip, Ts_tracker_toolmarker, method)
    keep = as_keep(exclude, len(Ts_base_tip))
    robot_tips, markers = Ts_base_tip.select(keep), Ts_tracker_toolmarker.select(keep)
    paper = solve_paper(robot_tips, markers, chosen[keep]) if method == "paper" else None
    joint = solve_hand_eye(robot_tips, markers, noise=noise)
    if paper is None:
        joint = replace(joint, used=_among_all(joint.used, keep))
        return _from_joint(joint, Ts_base_tip, Ts_tracker_toolmarker, chosen, keep)
    observations = observe(robot_tips, markers, TOOL_MARKERS, noise)
    covariance = bootstrap(paper, observations, chosen[keep], joint)
    return _assemble(
        "paper",
        (paper.T_base_tracker, paper.T_toolmarker_tip),
        (covariance, joint.marker_sigma_mm, _among_all(paper.used, keep), keep),
        Ts_base_tip,
        Ts_tracker_toolmarker,
        pivot=(paper.pivot.rmse_mm, paper.pivot.cone_deg),
        lines=paper.lines_tracker,
    )


def _among_all(used: Bools, keep: Bools) -> Bools:
    """Return which of all poses (n,) are used, from which of those kept (k,) are."""
    rows = np.zeros(len(keep), dtype=np.bool_)
    rows[keep] = used
    return readonly(rows)


def _from_joint(
    joint: HandEyeFit, Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses, phases: Ints, keep: Bools
) -> ToolRegistration:
    """Return the registration with the figures of the pivot and the lines, where there are any."""
    tip = joint.T_toolmarker_tip.translation
    pivot = joint.used & (phases == 0)
    scatter = None
    if pivot.sum() > 1:
        tips_tracker = Ts_tracker_toolmarker.select(pivot) @ tip
        scatter = _rms(np.linalg.norm(tips_tracker - tips_tracker.mean(axis=0), axis=1))
    turning = pivot if scatter is not None else joint.used
    levers = Ts_tracker_toolmarker.rotations[turning] @ (tip / max(np.linalg.norm(tip), 1e-9))
    translations = Ts_tracker_toolmarker.translations
    lines = [
        fit_line_direction(translations[rows])
        for rows in (joint.used & (phases == phase) for phase in (1, 2))
        if rows.sum() > 1 and np.ptp(translations[rows], axis=0).max() > MIN_TRAVEL_MM
    ]
    return _assemble(
        "joint",
        (joint.T_base_tracker, joint.T_toolmarker_tip),
        (joint.covariance, joint.marker_sigma_mm, joint.used, keep),
        Ts_base_tip,
        Ts_tracker_toolmarker,
        pivot=(scatter, cap_half_angle_deg(levers)),
        lines=(lines[0], lines[1]) if len(lines) == 2 else None,
    )


def _assemble(
    method: ToolMethod,
    poses: tuple[Pose, Pose],
    certainty: tuple[Floats, float, Bools, Bools],
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    *,
    pivot: tuple[float | None, float],
    lines: tuple[LineFit, LineFit] | None,
) -> ToolRegistration:
    """Return the registration with the residuals of the tip and the verdict."""
    T_base_tracker, T_toolmarker_tip = poses
    covariance, sigma_mm, used, keep = certainty
    tips_base = T_base_tracker @ (Ts_tracker_toolmarker @ T_toolmarker_tip.translation)
    residuals_mm = np.linalg.norm(tips_base - Ts_base_tip.translations, axis=1)
    center_base = Ts_base_tip.translations[used].mean(axis=0)
    tip_sigma_mm = float(np.sqrt(np.trace(covariance[9:, 9:])))
    error_mm = registration_sigma_mm(T_base_tracker, covariance[:6, :6], center_base)
    verdict, reasons = judge_registration(
        tip_sigma_mm, error_mm, sigma_mm, used[keep], Ts_base_tip.rotations[used]
    )
    axes = None if lines is None else angle_deg(lines[0].direction, lines[1].direction)
    return ToolRegistration(
        method=method,
        T_base_tracker=T_base_tracker,
        T_toolmarker_tip=T_toolmarker_tip,
        pivot_rmse_mm=pivot[0],
        axes_angle_deg=axes,
        line_rmse_mm=None if lines is None else _rms(np.array([line.rms_mm for line in lines])),
        n_poses=len(residuals_mm),
        residuals_mm=readonly(residuals_mm),
        rmse_mm=_rms(residuals_mm[used]),
        cone_deg=pivot[1],
        travel_mm=(0.0, 0.0) if lines is None else (lines[0].length_mm, lines[1].length_mm),
        tip_sigma_mm=tip_sigma_mm,
        covariance=readonly(covariance),
        registration_sigma_mm=error_mm,
        marker_sigma_mm=sigma_mm,
        used=readonly(used),
        verdict=verdict,
        reasons=reasons,
    )


def _as_phases(
    phases: ArrayLike | None, Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses, method: ToolMethod
) -> Ints:
    """Return the phases (n,), -1 where there are none, after checking that they fit the poses."""
    n = len(Ts_base_tip)
    if phases is None and method == "paper":
        raise InvalidInputError('the method "paper" needs to know the phase of each pose')
    values = np.full(n, -1) if phases is None else np.asarray(phases)
    if len(Ts_tracker_toolmarker) != n or values.shape != (n,):
        raise InvalidInputError(
            f"robot poses, marker poses and phases must be as many: {n}, "
            f"{len(Ts_tracker_toolmarker)} and shape {values.shape}"
        )
    if phases is not None and not np.isin(values, (0, 1, 2)).all():
        raise InvalidInputError("phases must be 0 (pivot), 1 (along x) or 2 (along y)")
    return values.astype(np.int64)


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))
