"""What figures there are: their words, units and limits.

What each figure means is said in ``docs/metrics.md``; limits are goals of this program.
"""

from dataclasses import dataclass
from typing import Literal

from rona_core.calibration.hand_eye.quality import REGISTRATION_TITLE

Sense = Literal["at most", "at least"]


@dataclass(frozen=True, slots=True)
class FigureKind:
    """One figure: its words, unit, decimals, limit and what the paper reports."""

    title: str
    of: str  # the result or capture that it judges
    unit: str = ""  # empty for counts and shares
    decimals: int = 0
    limit: float | None = None
    sense: Sense = "at most"
    paper: float | None = None


# where each limit comes from: docs/metrics.md, "Limits"
FIGURES: dict[str, FigureKind] = {
    "tool_tip_error_mm": FigureKind("Tool tip error", "tool", "mm", 2, 0.5),
    "tool_tip_sigma_mm": FigureKind("Tool tip, expected error", "tool", "mm", 2, 0.3),
    "tracker_registration_tre_mm": FigureKind(
        "Registration, TRE on the skull", "tool", "mm", 2, 1.0
    ),
    "tracker_registration_sigma_mm": FigureKind(REGISTRATION_TITLE, "tool", "mm", 2, 1.0),
    "pointer_tip_error_mm": FigureKind("Pointer tip error", "pointer", "mm", 2, 0.5),
    "pointer_tip_sigma_mm": FigureKind("Pointer tip, expected error", "pointer", "mm", 2, 0.5),
    "surface_points": FigureKind("Surface points", "surface"),
    "surface_rms_mm": FigureKind("Surface cloud, RMS", "surface", "mm", 2, 0.5, paper=2.5),
    "surface_sigma_predicted_mm": FigureKind(
        "Surface cloud, predicted RMS", "surface", "mm", 2, 0.5
    ),
    "surface_tip_3d_rms_mm": FigureKind("Pointer tip on surface, 3D RMS", "surface", "mm", 2),
    "skull_registration_tre_mm": FigureKind(
        "Loaded skull, TRE on the skull", "registration", "mm", 2, 1.5
    ),
    "skull_registration_sigma_mm": FigureKind(
        "Loaded skull, predicted", "registration", "mm", 2, 1.5
    ),
    "path_points_raw": FigureKind("Path points, demonstrated", "path", paper=307),
    "path_points_smoothed": FigureKind("Path points, smoothed", "smoothing", paper=90),
    "path_deviation_max_mm": FigureKind(
        "Max. path deviation", "smoothing", "mm", 2, 1.0, paper=1.0
    ),
    "path_deviation_raw_max_mm": FigureKind(
        "Path deviation from raw samples", "smoothing", "mm", 2
    ),
    "normal_error_median_deg": FigureKind("Normal error, median", "smoothing", "deg", 1, 1.0),
    "normal_error_p95_deg": FigureKind("Normal error, 95 %", "smoothing", "deg", 1, 2.5),
    "rolls_tried": FigureKind("Rolls tried", "roll"),
    "rolls_feasible": FigureKind("Rolls the robot can traverse", "roll", "", 0, 1.0, "at least"),
    "roll_mode": FigureKind("Roll", "roll"),
    "roll_variation_deg": FigureKind("Roll, variation along the path", "roll", "deg"),
    "min_joint_margin_deg": FigureKind(
        "Distance from joint limits", "roll", "deg", 1, 0.0, "at least"
    ),
    "min_clearance_mm": FigureKind("Least clearance of the robot", "roll", "mm", 1),
    "landmark_distance_mm": FigureKind(
        "Landmarks against the robot, RMS", "landmarks", "mm", 2, 2.0
    ),
    "landmark_sigma_mm": FigureKind("Landmarks, expected", "landmarks", "mm", 2),
    "scan_points": FigureKind("A-scans", "capture scan"),
    "second_pass_points": FigureKind("A-scans of further passes", "capture second"),
    "second_pass_reason": FigureKind("No second pass, because", ""),
    "references_reason": FigureKind("No reference points, because", ""),
    "bed_reason": FigureKind("No implant bed, because", ""),
    "milling_reason": FigureKind("Not milled, because", ""),
    "scan_duration_s": FigureKind("Scan duration", "roll", "s"),
    "contact_force_rms_n": FigureKind(
        "Force about its set point, RMS", "capture scan", "N", 2, 0.7
    ),
    "contact_force_peak_n": FigureKind("Largest force", "capture scan", "N", 1, 6.0),
    "head_shift_mm": FigureKind("Head, shift since step 4", "capture scan", "mm", 2),
    "head_shift_sigma_mm": FigureKind("Head, shift, predicted", "capture scan", "mm", 3, 0.05),
    "head_shift_error_mm": FigureKind("Head, shift, error", "capture scan", "mm", 3, 0.05),
    "head_motion_mm": FigureKind("Head, motion during the scan", "capture scan", "mm", 2, 0.35),
    "outer_rms_mm": FigureKind("Outer boundary, RMS", "maps", "mm", 2, 0.35, paper=0.35),
    "inner_rms_mm": FigureKind("Inner boundary, RMS", "maps", "mm", 2, 0.85, paper=0.85),
    "outer_same_robot_rms_mm": FigureKind("Outer boundary, same robot", "maps", "mm", 2),
    "outer_other_roll_rms_mm": FigureKind("Outer boundary, other roll", "maps", "mm", 2),
    "inner_same_robot_rms_mm": FigureKind("Inner boundary, same robot", "maps", "mm", 2),
    "thickness_bias_mm": FigureKind("Thickness, bias", "maps", "mm", 2),
    "thickness_rms_mm": FigureKind("Thickness, RMS", "maps", "mm", 2, 0.5, paper=0.5),
    "thickness_sigma_predicted_mm": FigureKind("Thickness, predicted", "detection", "mm", 2, 0.3),
    "scan_thickness_rms_mm": FigureKind(
        "Thickness of sure A-scans, RMS", "detection", "mm", 2, 0.3, paper=0.5
    ),
    "sound_speed_error_percent": FigureKind("Speed of sound, error", "detection", "%", 1, 4.0),
    "fused_outer_rms_mm": FigureKind("Outer boundary after fusion, RMS", "maps", "mm", 2, 0.35),
    "coverage_fraction": FigureKind("Coverage, outer", "maps", "", 2, 0.9, "at least"),
    "inner_coverage_fraction": FigureKind("Coverage, inner", "maps", "", 2, 0.9, "at least"),
    "inner_coverage_one_pass_fraction": FigureKind("Coverage, inner, first pass", "maps", "", 2),
    "detection_failure_fraction": FigureKind(
        "Wrong inner boundary, all A-scans", "detection", "", 2
    ),
    "unflagged_failure_fraction": FigureKind(
        "Wrong inner boundary, unflagged", "detection", "", 2, 0.02
    ),
    "flagged_fraction": FigureKind("Flagged A-scans", "detection", "", 2),
    "burr_tip_error_mm": FigureKind("Burr tip error", "burr", "mm", 2, 0.5),
    "burr_tip_sigma_mm": FigureKind("Burr tip, expected error", "burr", "mm", 2, 0.4),
    "bed_probability": FigureKind("Implant bed, probability", "bed", "", 3),
    "bed_residual_mm": FigureKind("Bone below the bed, by the maps", "bed", "mm", 2),
    "bed_residual_true_mm": FigureKind("Bone below the bed, true", "bed", "mm", 2),
    "rehearsal_residual_mm": FigureKind("Bone left, by the rehearsal", "rehearsal", "mm", 2),
    "rehearsal_residual_true_mm": FigureKind(
        "Bone left by a rehearsal, true", "rehearsal", "mm", 2
    ),
    "rehearsal_raised_mm": FigureKind("Rehearsal: floor above plan", "rehearsal", "mm", 2),
    "rehearsal_raised_s": FigureKind("Rehearsal: time of raised layers", "rehearsal", "s", 0),
    "rehearsal_implant_high_mm": FigureKind(
        "Rehearsal: implant over its seat", "rehearsal", "mm", 2
    ),
    "rehearsal_rock_mm": FigureKind("Rehearsal: rock of the implant", "rehearsal", "mm", 2),
    "sono_face_error_mm": FigureKind("By hand: face of the probe, error", "sono", "mm", 2, 0.5),
    "sono_axis_error_deg": FigureKind("By hand: axis of the probe, error", "sono", "deg", 2, 0.5),
    "sono_outer_rms_mm": FigureKind("By hand: outer boundary, RMS", "sono_maps", "mm", 2, 0.35),
    "sono_inner_rms_mm": FigureKind("By hand: inner boundary, RMS", "sono_maps", "mm", 2, 0.85),
    "sono_thickness_rms_mm": FigureKind(
        "By hand: thickness, RMS", "sono_maps", "mm", 2, 0.5, paper=0.5
    ),
    "sono_coverage_fraction": FigureKind(
        "By hand: coverage, outer", "sono_maps", "", 2, 0.9, "at least"
    ),
    "sono_inner_coverage_fraction": FigureKind(
        "By hand: coverage, inner", "sono_maps", "", 2, 0.9, "at least"
    ),
}
