"""The figures of a session beside their limits and the paper's: what passes and what does not.

What each figure means is said in ``docs/metrics.md``; limits are goals of this program.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rona_core.session.document import Session

Verdict = Literal["pass", "review", "fail", "none"]  # none: no limit, or no value yet
Sense = Literal["at most", "at least"]
REVIEW_SHARE = 0.5  # a figure that misses its limit by up to this share is for review


@dataclass(frozen=True, slots=True)
class FigureKind:
    """One figure: its words, unit, decimals, limit and what the paper reports."""

    title: str
    unit: str  # empty for counts and shares
    decimals: int
    limit: float | None = None
    sense: Sense = "at most"
    paper: float | None = None


@dataclass(frozen=True, slots=True)
class QualityRow:
    """One figure of a session and its verdict."""

    key: str
    title: str
    value: float | int | str | bool | None
    unit: str
    decimals: int
    limit: float | None
    sense: Sense
    verdict: Verdict
    paper: float | None


FIGURES: dict[str, FigureKind] = {
    "tool_tip_error_mm": FigureKind("Tool tip error", "mm", 2, 0.5),
    "tool_tip_sigma_mm": FigureKind("Tool tip, random error", "mm", 2, 0.3),
    "tracker_registration_tre_mm": FigureKind("Registration, TRE on the skull", "mm", 2, 1.0),
    "pointer_tip_error_mm": FigureKind("Pointer tip error", "mm", 2, 0.5),
    "pointer_tip_sigma_mm": FigureKind("Pointer tip, random error", "mm", 2, 0.5),
    "surface_points": FigureKind("Surface points", "", 0),
    "surface_rms_mm": FigureKind("Surface cloud, RMS", "mm", 2, 1.5, paper=2.5),
    "surface_sigma_predicted_mm": FigureKind("Surface cloud, predicted RMS", "mm", 2, 1.5),
    "surface_tip_3d_rms_mm": FigureKind("Pointer tip on the surface, 3D RMS", "mm", 2),
    "skull_registration_tre_mm": FigureKind("Loaded skull, TRE on the skull", "mm", 2, 1.5),
    "skull_registration_sigma_mm": FigureKind("Loaded skull, predicted", "mm", 2, 1.5),
    "path_points_raw": FigureKind("Path points, demonstrated", "", 0, paper=307),
    "path_points_smoothed": FigureKind("Path points, smoothed", "", 0, paper=90),
    "path_deviation_max_mm": FigureKind("Path deviation K1", "mm", 2, 1.0, paper=1.0),
    "path_deviation_raw_max_mm": FigureKind("Path deviation from raw samples", "mm", 2),
    "normal_error_median_deg": FigureKind("Normal error, median", "deg", 1, 5.0),
    "normal_error_p95_deg": FigureKind("Normal error, 95 %", "deg", 1, 10.0),
    "rolls_tried": FigureKind("Rolls tried", "", 0),
    "rolls_feasible": FigureKind("Rolls the robot can traverse", "", 0, 1.0, "at least"),
    "roll_mode": FigureKind("Roll", "", 0),
    "roll_variation_deg": FigureKind("Roll, variation along the path", "deg", 0),
    "min_joint_margin_deg": FigureKind("Distance from joint limits", "deg", 1, 0.0, "at least"),
    "min_clearance_mm": FigureKind("Least clearance of the robot", "mm", 1),
    "scan_points": FigureKind("A-scans", "", 0),
    "second_pass_points": FigureKind("A-scans of the second pass", "", 0),
    "second_pass_reason": FigureKind("No second pass, because", "", 0),
    "scan_duration_s": FigureKind("Scan duration", "s", 0),
    "contact_force_rms_n": FigureKind("Force about its set point, RMS", "N", 2, 0.7),
    "contact_force_peak_n": FigureKind("Largest force", "N", 1, 6.0),
    "outer_rms_mm": FigureKind("Outer boundary, RMS", "mm", 2, 0.6, paper=0.35),
    "inner_rms_mm": FigureKind("Inner boundary, RMS", "mm", 2, 1.2),
    "outer_same_robot_rms_mm": FigureKind("Outer boundary, same robot", "mm", 2),
    "inner_same_robot_rms_mm": FigureKind("Inner boundary, same robot", "mm", 2),
    "thickness_bias_mm": FigureKind("Thickness, bias", "mm", 2),
    "thickness_rms_mm": FigureKind("Thickness, RMS", "mm", 2, 1.0, paper=0.5),
    "thickness_sigma_predicted_mm": FigureKind("Thickness, predicted", "mm", 2, 0.3),
    "scan_thickness_rms_mm": FigureKind("Thickness of sure A-scans, RMS", "mm", 2, 0.3, paper=0.5),
    "sound_speed_error_percent": FigureKind("Speed of sound, error", "%", 1, 4.0),
    "fused_outer_rms_mm": FigureKind("Outer boundary after fusion, RMS", "mm", 2, 0.6),
    "coverage_fraction": FigureKind("Coverage, outer", "", 2, 0.9, "at least"),
    "inner_coverage_fraction": FigureKind("Coverage, inner", "", 2, 0.3, "at least"),
    "inner_coverage_one_pass_fraction": FigureKind("Coverage, inner, first pass", "", 2),
    "detection_failure_fraction": FigureKind("Wrong inner boundary, all A-scans", "", 2),
    "unflagged_failure_fraction": FigureKind("Wrong inner boundary, unflagged", "", 2, 0.1),
    "flagged_fraction": FigureKind("Flagged A-scans", "", 2),
    "sono_face_error_mm": FigureKind("By hand: face of the probe, error", "mm", 2, 0.5),
    "sono_axis_error_deg": FigureKind("By hand: axis of the probe, error", "deg", 2, 0.5),
    "sono_outer_rms_mm": FigureKind("By hand: outer boundary, RMS", "mm", 2, 0.6),
    "sono_inner_rms_mm": FigureKind("By hand: inner boundary, RMS", "mm", 2, 1.2),
    "sono_thickness_rms_mm": FigureKind("By hand: thickness, RMS", "mm", 2, 1.0, paper=0.5),
    "sono_coverage_fraction": FigureKind("By hand: coverage, outer", "", 2, 0.9, "at least"),
    "sono_inner_coverage_fraction": FigureKind("By hand: coverage, inner", "", 2, 0.3, "at least"),
}


def quality_rows(
    figures: Mapping[str, Any], session: Session | None = None
) -> tuple[QualityRow, ...]:
    """Return a row for every figure, in the order of the procedure.

    Args:
        figures: Values by key; a key that is missing or None has no value yet.
        session: Whose smoothing tolerance limits the path deviation.
    """
    rows: list[QualityRow] = []
    for key, kind in FIGURES.items():
        limit = kind.limit
        if key == "path_deviation_max_mm" and session is not None:
            limit = _tolerance_mm(session, limit)
        if key == "rolls_feasible" and figures.get("roll_mode") == "variable":
            limit = None  # a roll that varies does what no constant one may be able to
        value = figures.get(key)
        rows.append(
            QualityRow(
                key=key,
                title=kind.title,
                value=value,
                unit=kind.unit,
                decimals=kind.decimals,
                limit=limit,
                sense=kind.sense,
                verdict=verdict(value, limit, kind.sense),
                paper=kind.paper,
            )
        )
    return tuple(rows)


def verdict(value: object, limit: float | None, sense: Sense) -> Verdict:
    """Return whether a value keeps its limit, nearly does, or does not."""
    if limit is None or not isinstance(value, int | float) or isinstance(value, bool):
        return "none"
    if sense == "at most":
        near, within = limit * (1.0 + REVIEW_SHARE), abs(value) <= limit * (1.0 + 1e-9)
        return "pass" if within else "review" if abs(value) <= near else "fail"
    near = limit * (1.0 - REVIEW_SHARE)
    return "pass" if value >= limit else "review" if value >= near else "fail"


def _tolerance_mm(session: Session, otherwise: float | None) -> float | None:
    smoothing = session.results.smoothing
    tolerance = None if smoothing is None else smoothing.arguments.get("tolerance_mm")
    return float(tolerance) if isinstance(tolerance, int | float) else otherwise
