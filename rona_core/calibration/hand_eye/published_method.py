"""Published registration of robot and tracker: tip from a pivot, rotation from two lines.

The robot pivots its tool about the tip, then translates it along tool x and tool y. How certain
the result is, is estimated by repeating it on simulated noise (parametric bootstrap).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.hand_eye import HandEyeFit
from rona_core.calibration.hand_eye.residuals import (
    TIP_VARIANCE_MM2,
    TURN_VARIANCE_RAD2,
    Observations,
)
from rona_core.calibration.pivot.pivot_calibration import PivotFit, solve_pivot
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
