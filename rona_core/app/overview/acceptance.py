"""The figures of a session beside their limits and the paper's: what passes and what does not.

What each figure means is said in ``docs/metrics.md``; limits are goals of this program.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.inputs import CAPTURE
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.scan.head_view import unwatched
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull

Verdict = Literal["pass", "review", "fail", "none"]  # none: no limit, or no value yet
Sense = Literal["at most", "at least"]
REVIEW_SHARE = 0.5  # a figure that misses its limit by up to this share is for review


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


@dataclass(frozen=True, slots=True)
class QualityRow:
    """One figure of a session and its verdict; one of a stale result has no value."""

    key: str
    title: str
    value: float | int | str | bool | None
    unit: str
    decimals: int
    limit: float | None
    sense: Sense
    verdict: Verdict
    paper: float | None
    step: str  # that it judges
    reason: str = ""  # why it does not pass, where that is known
    stale_reason: str | None = None  # why it is left out

    @property
    def sentence(self) -> str:
        """Say in words what it is, beside its limit."""
        if not isinstance(self.value, int | float) or isinstance(self.value, bool):
            return f"{self.title}: {self.reason or self.value}"
        words = f"{self.title} {self.value:.{self.decimals}f} {self.unit}".rstrip()
        if self.limit is not None:
            words += f" (limit {self.limit:.{self.decimals}f})"
        return f"{words}: {self.reason}" if self.reason else words


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the figures of a step come to: the worst verdict, and those that do not pass."""

    verdict: Verdict
    missed: tuple[QualityRow, ...]  # the worst first


# where each limit comes from: docs/metrics.md, "Limits"
FIGURES: dict[str, FigureKind] = {
    "tool_tip_error_mm": FigureKind("Tool tip error", "tool", "mm", 2, 0.5),
    "tool_tip_sigma_mm": FigureKind("Tool tip, expected error", "tool", "mm", 2, 0.3),
    "tracker_registration_tre_mm": FigureKind(
        "Registration, TRE on the skull", "tool", "mm", 2, 1.0
    ),
    "tracker_registration_sigma_mm": FigureKind("Registration, expected", "tool", "mm", 2, 1.0),
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
    "path_deviation_max_mm": FigureKind("Path deviation K1", "smoothing", "mm", 2, 1.0, paper=1.0),
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
    "scan_points": FigureKind("A-scans", "capture scan"),
    "second_pass_points": FigureKind("A-scans of the second pass", "capture second"),
    "second_pass_reason": FigureKind("No second pass, because", ""),
    "references_reason": FigureKind("No reference points, because", ""),
    "bed_reason": FigureKind("No implant bed, because", ""),
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
    "bed_probability": FigureKind("Implant bed, probability", "bed", "", 3),
    "bed_residual_mm": FigureKind("Bone below the bed, by the maps", "bed", "mm", 2),
    "bed_residual_true_mm": FigureKind("Bone below the bed, true", "bed", "mm", 2),
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
CALIBRATED = {"tool_tip_sigma_mm": "tool", "pointer_tip_sigma_mm": "pointer"}
OWN_WORD: dict[str, Verdict] = {"good": "pass", "weak": "review", "bad": "fail"}
WORST_FIRST: tuple[Verdict, ...] = ("fail", "review", "pass", "none")
CONTRADICTED = "the caliper contradicts the echoes, so the inner map may be of another boundary"
VOXELS = (
    "the skull comes from voxels: where its surface runs along them their terraces remain, and "
    "its normals are off by several degrees"
)


def quality_rows(
    figures: Mapping[str, Any], session: Session | None = None
) -> tuple[QualityRow, ...]:
    """Return a row for every figure, in the order of the procedure.

    The step list, the notes of the panels and the table of figures all speak from these rows.

    Args:
        figures: Values by key; a key that is missing or None has no value yet.
        session: Whose smoothing tolerance limits the path deviation, whose calibrations have a say
            of their own, and whose stale results have no figures: they would be compared with the
            truth of another set-up.
    """
    if session is not None:
        figures = {**figures, **_known_at_once(session)}
    return tuple(_row(key, figures.get(key), figures, session) for key in FIGURES)


def _known_at_once(session: Session) -> dict[str, float]:
    """Return figures that the session tells without the truth, which takes seconds to ask."""
    results, known = session.results, dict[str, float]()
    if results.tool is not None:
        known["tool_tip_sigma_mm"] = results.tool.value.tip_sigma_mm
    if results.pointer is not None:
        known["pointer_tip_sigma_mm"] = results.pointer.value.tip_sigma_mm
    if results.smoothing is not None:
        known["path_deviation_max_mm"] = float(results.smoothing.value.from_filtered_mm.max())
    return known


def _row(
    key: str,
    value: float | int | str | bool | None,
    figures: Mapping[str, Any],
    session: Session | None,
) -> QualityRow:
    kind = FIGURES[key]
    limit, stale, reason = kind.limit, None, ""
    if key == "path_deviation_max_mm" and session is not None:
        limit = _tolerance_mm(session, limit)
    if key == "rolls_feasible" and figures.get("roll_mode") == "variable":
        limit = None  # a roll that varies does what no constant one may be able to
    if session is not None and kind.of and value is not None:
        stale = stale_reason(kind.of, session)
    value = None if stale else value
    judged = verdict(value, limit, kind.sense)
    if session is not None and value is not None:
        judged, reason = _with_own_word(key, judged, session)
    if session is not None and key == "head_motion_mm" and (why := unwatched(session)) is not None:
        judged, reason = "review", why
    return QualityRow(
        key=key,
        title=kind.title,
        value=value,
        unit=kind.unit,
        decimals=kind.decimals,
        limit=limit,
        sense=kind.sense,
        verdict=judged,
        paper=kind.paper,
        step=_step_of(kind.of),
        reason=reason,
        stale_reason=stale,
    )


def _step_of(part: str) -> str:
    """Return the step of the procedure that lists a result or capture; nothing is of the maps."""
    name = part.removeprefix(CAPTURE)
    listed = (step for step in REGISTRY.step_names if name in sum(REGISTRY.parts_of(step), ()))
    return next(listed, "maps")


def _with_own_word(key: str, judged: Verdict, session: Session) -> tuple[Verdict, str]:
    """Return the verdict with what the session itself says of the figure, and why."""
    if key in CALIBRATED:
        held = session.results.get(CALIBRATED[key])
        if held is not None and OWN_WORD[held.value.verdict] != "pass":
            return worst((judged, OWN_WORD[held.value.verdict])), "; ".join(held.value.reasons)
    speed = session.results.speed
    if key == "thickness_sigma_predicted_mm" and speed is not None:
        if speed.value.verdict == "bad" and stale_reason("speed", session) is None:
            return "fail", f"{CONTRADICTED}: {'; '.join(speed.value.reasons)}"
    specimen = session.setup.specimen
    voxels = isinstance(specimen, LoadedSkull) and specimen.kind in ("mask", "ct")
    if key.startswith("normal_error") and voxels and judged in ("review", "fail"):
        return judged, VOXELS
    return judged, ""


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst of some verdicts; "none" where there are none."""
    found = set(verdicts)
    for one in WORST_FIRST:
        if one in found:
            return one
    return "none"


def judgement(rows: Iterable[QualityRow], step: str) -> Judgement:
    """Return what the figures of a step come to."""
    own = [row for row in rows if row.step == step]
    missed = [row for row in own if row.verdict in ("fail", "review")]
    missed.sort(key=lambda row: WORST_FIRST.index(row.verdict))
    return Judgement(worst(row.verdict for row in own), tuple(missed))


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
    """Return the bound of K1; None where the path was smoothed within a bound of another kind."""
    smoothing = session.results.smoothing
    if smoothing is None:
        return otherwise
    tolerance = smoothing.arguments.get("tolerance_mm")
    if smoothing.arguments.get("metric", "k1") != "k1":
        return None
    return float(tolerance) if isinstance(tolerance, int | float) else otherwise
