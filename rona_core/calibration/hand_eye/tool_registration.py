"""Registration of robot and tracker: tracker in ``base`` and tip in ``toolmarker``.

The robot pivots its tool about the tip, then translates it along tool x and tool y. By default all
poses are solved together; the published method (a pivot and two lines) stays for comparison.

Published registration of robot and tracker: tip from a pivot, rotation from two lines. The robot
pivots its tool about the tip, then translates it along tool x and tool y. How certain the result
is, is estimated by repeating it on simulated noise (parametric bootstrap).
"""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.hand_eye import (
    FLOOR_MM,
    TIP_VARIANCE_MM2,
    TOOL_MARKERS,
    TURN_VARIANCE_RAD2,
    TYPICAL,
    HandEyeFit,
    Observations,
    observe,
    solve_hand_eye,
)
from rona_core.calibration.hand_eye.quality import judge_registration, registration_sigma_mm
from rona_core.calibration.hand_eye.reference_markers import BaseReference
from rona_core.calibration.pivot.motion_extent import cap_half_angle_deg
from rona_core.calibration.pivot.pivot_calibration import PivotFit, as_keep, solve_pivot
from rona_core.calibration.timing.time_offset import TimeOffset
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import deviation_between, rotation_vectors
from rona_core.geometry.rigid_fit import LineFit, fit_line_direction

MIN_PIVOT_POSES = 6
MIN_LINE_POSES = 2
MIN_TRAVEL_MM = 10.0
MAX_TURN_DEG = 2.0  # of the tool during a translation
MAX_AXIS_DEG = 10.0  # between a translation and the tool axis it should follow, or off 90 degrees
PHASES = ("pivot", "x", "y")
DRAWS = 60
MIN_DRAWS = 30  # that must find a registration
SEED = 20070411


@dataclass(frozen=True, slots=True, eq=False)
class PaperFit:
    """Tracker in ``base``, tip in ``toolmarker``, and the pivot and lines they come from."""

    T_base_tracker: Pose
    T_toolmarker_tip: Pose
    pivot: PivotFit
    lines_tracker: tuple[LineFit, LineFit]
    used: Bools  # (n,) False for poses that lie far off


def solve_paper(Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses, phases: Ints) -> PaperFit:
    """Return the registration by the method of the RONA paper.

    Args:
        Ts_base_tip: Tool tip as the robot knows it, n poses.
        Ts_tracker_toolmarker: Tool marker as the tracker sees it, the same n poses.
        phases: (n,) 0 pivot about the tip, 1 translation along tool x, 2 along tool y.

    Raises:
        InvalidInputError: too few poses of a phase.
        DegenerateGeometryError: the pivot or a translation does not determine its part.
    """
    for phase, (name, least) in enumerate(
        zip(PHASES, (MIN_PIVOT_POSES, MIN_LINE_POSES, MIN_LINE_POSES), strict=True)
    ):
        count = int((phases == phase).sum())
        if count < least:
            raise InvalidInputError(f"phase {phase} ({name}) has {count} poses, {least} are needed")
    pivot = solve_pivot(
        Ts_tracker_toolmarker.select(phases == 0),
        dof=6,
        method="sphere",
        at_least=MIN_PIVOT_POSES,
    )
    lines_base: list[LineFit] = []
    lines_tracker: list[LineFit] = []
    for axis in (0, 1):
        rows = phases == axis + 1
        base, tracker = _axis_lines(
            Ts_base_tip.select(rows), Ts_tracker_toolmarker.select(rows), axis
        )
        lines_base.append(base)
        lines_tracker.append(tracker)
    x, y = (line.direction for line in lines_tracker)
    axes_angle_deg = angle_deg(x, y)
    if abs(axes_angle_deg - 90.0) > MAX_AXIS_DEG:
        raise DegenerateGeometryError(
            f"the two measured tool directions are {axes_angle_deg:.1f} degrees apart, not 90"
        )
    R_base_tracker = _rotation([line.direction for line in lines_base], [x, y])
    # every pose says something about the rest, once the rotation and the tip are known
    tips_base = Ts_base_tip.translations
    offsets = tips_base - (Ts_tracker_toolmarker @ pivot.tip_marker) @ R_base_tracker.T
    distance = np.linalg.norm(offsets - np.median(offsets, axis=0), axis=1)
    kept = distance <= 6.0 * np.median(distance) + 1e-6  # without gross errors
    T_base_tracker = Pose(R_base_tracker, offsets[kept].mean(axis=0))
    Ts_base_toolmarker = T_base_tracker @ Ts_tracker_toolmarker
    turned = (Ts_base_toolmarker.inv() @ Ts_base_tip).select(kept).mean()
    return PaperFit(
        T_base_tracker=T_base_tracker,
        T_toolmarker_tip=Pose(turned.rotation, pivot.tip_marker),
        pivot=pivot,
        lines_tracker=(lines_tracker[0], lines_tracker[1]),
        used=readonly(kept),
    )


def bootstrap(fit: PaperFit, observations: Observations, phases: Ints, noise: HandEyeFit) -> Floats:
    """Return the covariance (12, 12) of a registration.

    The registration is repeated with new errors of robot and tracker; its scatter is the answer.
    The order and meaning of the rows are those of ``HandEyeFit``.

    Args:
        fit: The registration.
        observations: What it was made from.
        phases: (n,) as for ``solve_paper``.
        noise: The joint solve of the same poses, whose residuals give the size of the errors.

    Raises:
        DegenerateGeometryError: most of the repetitions find no registration.
    """
    T_base_tracker, T_toolmarker_tip = fit.T_base_tracker, fit.T_toolmarker_tip
    # where even the robot's stated error is more than the residuals show, it shrinks to them
    share = float(np.sqrt(min(1.0, noise.chi_square)))
    sigma_mm = noise.marker_sigma_mm
    T_tracker_base, T_tip_toolmarker = T_base_tracker.inv(), T_toolmarker_tip.inv()
    spread = share * sigma_mm * np.linalg.cholesky(observations.unit_covariances)
    rng = np.random.default_rng(SEED)
    found: list[Floats] = []
    for _ in range(DRAWS):
        # the robot goes somewhat astray, the tracker sees that, and sees it somewhat wrong
        exact = T_tracker_base @ _disturbed_robot(observations, share, rng) @ T_tip_toolmarker
        d = np.einsum("nij,nj->ni", spread, rng.normal(size=(len(observations), 6)))
        poses = _disturbed(exact, d, observations.centroid_toolmarker)
        try:
            again = solve_paper(observations.Ts_base_tip, poses, phases)
        except DegenerateGeometryError:
            continue
        found.append(
            np.concatenate(
                (
                    deviation_between(T_base_tracker, again.T_base_tracker),
                    deviation_between(T_toolmarker_tip, again.T_toolmarker_tip),
                )
            )
        )
    if len(found) < MIN_DRAWS:
        raise DegenerateGeometryError(
            f"with noise of {sigma_mm:.2g} mm at each marker, {DRAWS - len(found)} of {DRAWS} "
            "repetitions find no registration: pivot further, use more poses"
        )
    all_found = np.array(found)
    return all_found.T @ all_found / len(found)


def _disturbed(poses: Poses, deviations: Floats, center_marker: Floats) -> Poses:
    """Return poses turned about, and shifted with, a point of their own by deviations (n, 6)."""
    turns = Rotation.from_rotvec(deviations[:, :3]).as_matrix()
    centers = poses @ center_marker + deviations[:, 3:]
    rotations = turns @ poses.rotations
    return Poses(rotations, centers - rotations @ center_marker)


def _disturbed_robot(observations: Observations, share: float, rng: np.random.Generator) -> Poses:
    deviations = rng.normal(size=(len(observations), 6))
    shift, turn = share * np.sqrt((TIP_VARIANCE_MM2, TURN_VARIANCE_RAD2))
    return _disturbed(
        observations.Ts_base_tip, deviations * np.repeat((turn, shift), 3), np.zeros(3)
    )


def _axis_lines(
    Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses, axis: int
) -> tuple[LineFit, LineFit]:
    """Return the line of one translation in ``base`` and in ``tracker``, both along tool +axis."""
    name = PHASES[axis + 1]
    travel = float(np.linalg.norm(np.ptp(Ts_base_tip.translations, axis=0)))
    if travel < MIN_TRAVEL_MM:
        raise DegenerateGeometryError(
            f"the tool moved only {travel:.2g} mm along {name}, {MIN_TRAVEL_MM:.0f} are needed"
        )
    mean = Ts_base_tip.mean()
    turns = rotation_vectors(mean.rotation.T @ Ts_base_tip.rotations)
    turn_deg = float(np.rad2deg(np.linalg.norm(turns, axis=1).max()))
    if turn_deg > MAX_TURN_DEG:
        raise DegenerateGeometryError(
            f"the tool turned by {turn_deg:.1f} degrees while it moved along {name}"
        )
    base = fit_line_direction(Ts_base_tip.translations)
    tool_axis = mean.rotation[:, axis]
    if base.direction @ tool_axis < 0:
        base = _reversed(base)
    off_deg = angle_deg(base.direction, tool_axis)
    if off_deg > MAX_AXIS_DEG:
        raise DegenerateGeometryError(
            f"the translation along {name} runs {off_deg:.1f} degrees off that tool axis"
        )
    tracker = fit_line_direction(Ts_tracker_toolmarker.translations)
    # both saw the same motion, so progress along the two lines must agree in sign
    progress_base = (Ts_base_tip.translations - base.point) @ base.direction
    progress_tracker = (Ts_tracker_toolmarker.translations - tracker.point) @ tracker.direction
    if progress_base @ progress_tracker < 0:
        tracker = _reversed(tracker)
    return base, tracker


def _reversed(line: LineFit) -> LineFit:
    return LineFit(line.point, readonly(-line.direction), line.rms_mm, line.length_mm)


def _rotation(directions_base: list[Floats], directions_tracker: list[Floats]) -> Floats:
    """Return the rotation tracker -> base that fits two pairs of directions best (Wahba)."""
    b, a = np.array(directions_base), np.array(directions_tracker)
    u, _, vt = np.linalg.svd(b.T @ a)
    return (u * (1.0, 1.0, np.linalg.det(u @ vt))) @ vt


def angle_deg(a: Floats, b: Floats) -> float:
    """Return the angle between two directions."""
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


ToolMethod = Literal["joint", "paper"]
METHODS: tuple[ToolMethod, ...] = get_args(ToolMethod)


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
