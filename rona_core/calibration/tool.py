"""Register robot and tracker: find the tracker in ``base`` and the tip in ``toolmarker``.

The robot pivots its tool about the tip, then translates it along tool x and tool y. The pivot
gives the tip, the two directions give the rotation.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Floats, Ints, readonly
from rona_core.calibration.pivot import solve_pivot
from rona_core.calibration.pivot_fit import PivotFit
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.fit import LineFit, fit_line_direction
from rona_core.geometry.pose import Pose, Poses

MIN_PIVOT_POSES = 6
MIN_LINE_POSES = 2
MIN_TRAVEL_MM = 10.0
MAX_TURN_DEG = 2.0  # of the tool during a translation
MAX_AXIS_DEG = 10.0  # between a translation and the tool axis it should follow, or off 90 degrees
PHASES = ("pivot", "x", "y")


@dataclass(frozen=True, slots=True, eq=False)
class ToolRegistration:
    """Tracker in ``base``, tip in ``toolmarker``, and what the data leave over."""

    method: str
    T_base_tracker: Pose
    T_toolmarker_tip: Pose
    pivot_rmse_mm: float
    axes_angle_deg: float  # between the two measured directions; 90 if all were perfect
    line_rmse_mm: float  # distance of the marker from the two lines
    n_poses: int
    residuals_mm: Floats  # (n,) tip by the tracker, mapped to base, minus tip by the robot
    rmse_mm: float  # of these
    cone_deg: float  # half-angle of the pivot
    travel_mm: tuple[float, float]  # along tool x and y
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip in toolmarker


def register_tool(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    phases: ArrayLike,
    *,
    method: Literal["paper"] = "paper",
) -> ToolRegistration:
    """Return the registration of robot, tool and tracker from poses seen by both.

    Args:
        Ts_base_tip: Tool tip as the robot knows it, n poses.
        Ts_tracker_toolmarker: Tool marker as the tracker sees it, the same n poses.
        phases: (n,) 0 pivot about the tip, 1 translation along tool x, 2 along tool y.
        method: "paper".

    Raises:
        InvalidInputError: different numbers of poses, unknown phase or method, too few poses.
        DegenerateGeometryError: the pivot or a translation does not determine its part.
    """
    if method != "paper":
        raise InvalidInputError(f"method must be paper, not {method!r}")
    chosen = _as_phases(phases, Ts_base_tip, Ts_tracker_toolmarker)
    pivot = solve_pivot(
        Ts_tracker_toolmarker.select(chosen == 0),
        dof=6,
        method="sphere",
        at_least=MIN_PIVOT_POSES,
    )
    lines_base, lines_tracker = [], []
    for axis in (0, 1):
        rows = chosen == axis + 1
        base, tracker = _axis_lines(
            Ts_base_tip.select(rows), Ts_tracker_toolmarker.select(rows), axis
        )
        lines_base.append(base)
        lines_tracker.append(tracker)
    x, y = (line.direction for line in lines_tracker)
    axes_angle_deg = _angle_deg(x, y)
    if abs(axes_angle_deg - 90.0) > MAX_AXIS_DEG:
        raise DegenerateGeometryError(
            f"the two measured tool directions are {axes_angle_deg:.1f} degrees apart, not 90"
        )
    R_base_tracker = _rotation([line.direction for line in lines_base], [x, y])
    return _assemble(
        Ts_base_tip, Ts_tracker_toolmarker, R_base_tracker, pivot, lines_tracker, axes_angle_deg
    )


def _assemble(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    R_base_tracker: Floats,
    pivot: PivotFit,
    lines_tracker: list[LineFit],
    axes_angle_deg: float,
) -> ToolRegistration:
    """Average what every pose says about the rest, once the rotation and the tip are known."""
    tips_base = Ts_base_tip.translations
    tips_tracker = Ts_tracker_toolmarker @ pivot.tip_marker
    offsets = tips_base - tips_tracker @ R_base_tracker.T
    distance = np.linalg.norm(offsets - np.median(offsets, axis=0), axis=1)
    kept = distance <= 6.0 * np.median(distance) + 1e-6  # without gross errors
    T_base_tracker = Pose(R_base_tracker, offsets[kept].mean(axis=0))
    Ts_base_toolmarker = T_base_tracker @ Ts_tracker_toolmarker
    turned = (Ts_base_toolmarker.inv() @ Ts_base_tip).select(kept).mean()
    residuals = np.linalg.norm(T_base_tracker @ tips_tracker - tips_base, axis=1)
    line_rmse_mm = float(np.sqrt(np.mean([line.rms_mm**2 for line in lines_tracker])))
    return ToolRegistration(
        method="paper",
        T_base_tracker=T_base_tracker,
        T_toolmarker_tip=Pose(turned.rotation, pivot.tip_marker),
        pivot_rmse_mm=pivot.rmse_mm,
        axes_angle_deg=axes_angle_deg,
        line_rmse_mm=line_rmse_mm,
        n_poses=len(residuals),
        residuals_mm=readonly(residuals),
        rmse_mm=float(np.sqrt((residuals**2).mean())),
        cone_deg=pivot.cone_deg,
        travel_mm=(lines_tracker[0].length_mm, lines_tracker[1].length_mm),
        tip_sigma_mm=pivot.tip_sigma_mm,
    )


def _as_phases(phases: ArrayLike, Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses) -> Ints:
    """Return the phases (n,) after checking that they fit the poses."""
    values = np.asarray(phases)
    n = len(Ts_base_tip)
    if len(Ts_tracker_toolmarker) != n or values.shape != (n,):
        raise InvalidInputError(
            f"robot poses, marker poses and phases must be as many: {n}, "
            f"{len(Ts_tracker_toolmarker)} and shape {values.shape}"
        )
    if not np.isin(values, (0, 1, 2)).all():
        raise InvalidInputError("phases must be 0 (pivot), 1 (along x) or 2 (along y)")
    for phase, (name, least) in enumerate(
        zip(PHASES, (MIN_PIVOT_POSES, MIN_LINE_POSES, MIN_LINE_POSES), strict=True)
    ):
        count = int((values == phase).sum())
        if count < least:
            raise InvalidInputError(f"phase {phase} ({name}) has {count} poses, {least} are needed")
    return values.astype(np.int64)


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
    turn_deg = max(np.rad2deg(mean.angle_to_rad(pose)) for pose in Ts_base_tip)
    if turn_deg > MAX_TURN_DEG:
        raise DegenerateGeometryError(
            f"the tool turned by {turn_deg:.1f} degrees while it moved along {name}"
        )
    base = fit_line_direction(Ts_base_tip.translations)
    tool_axis = mean.rotation[:, axis]
    if base.direction @ tool_axis < 0:
        base = _reversed(base)
    off_deg = _angle_deg(base.direction, tool_axis)
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


def _angle_deg(a: Floats, b: Floats) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
