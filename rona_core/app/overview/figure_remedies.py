"""What to do about a figure that misses its limit: a message, and the gain expected of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rona_core.app.declarations.declarations import Message, Remedy
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import CAPTURE, stale_reason
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.handheld.messages import StartHandheldCalibration, StartHandheldScan
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.messages import StartTiltPlan
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.messages import StartBasePlacement
from rona_core.app.steps.scan.landmarks.messages import StartLandmarkCapture
from rona_core.app.steps.scan.messages import StartProbeMountingCapture, StartScan
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.surface.step import MORE_POINTS
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.mapping.accuracy.error_terms import BudgetRow, CellSigma
from rona_core.mapping.accuracy.map_terms import MORE_PASSES, POINTS
from rona_core.mapping.accuracy.probe_place import GAUGE
from rona_core.session.document import Session

Find = Callable[[Session], Remedy | None]
LEAST_GAIN = 0.1  # share of an expected error: less is not worth a click


def _of_part(part: str, otherwise: Remedy) -> Find:
    """Return what finds the remedy of a result or capture, or another where that is usable."""
    return lambda session: judge_part(part, session).remedy or otherwise


def _always(words: str, message: Message) -> Find:
    return lambda session: Remedy(words, message)


def _tilted_first(otherwise: Find) -> Find:
    """Return what finds the tilted passes as long as some are not scanned, else something else."""

    def find(session: Session) -> Remedy | None:
        for part in ("second", f"{CAPTURE}second"):
            found = judge_part(part, session)
            if not found.holds and found.remedy is not None:
                return found.remedy
        return otherwise(session)

    return find


def _reference_points(session: Session) -> Remedy:
    more = judge_part("speed", session).holds
    words = f"measure {'more' if more else 'three'} reference points with the caliper (step 9)"
    return Remedy(words, StartCaliperMeasurements(append=more))


def _of_budget(*names: str) -> Find:
    """Return what finds the message that lowers the expected error of maps most.

    What it brings is named at best: as if the causes that it lowers were gone.
    """

    def find(session: Session) -> Remedy | None:
        if stale_reason("maps", session) is not None:
            return judge_part("maps", session).remedy
        accuracy = map_accuracy(session)
        if accuracy is None:
            return None
        parts: list[CellSigma] = [getattr(accuracy, name) for name in names]
        rows = [row for part in parts for row in part.budget]
        now_mm = _together_mm(rows)
        best: Remedy | None = None
        least_mm = (1.0 - LEAST_GAIN) * now_mm
        for asked, lower in LOWERS.items():
            then_mm = _together_mm([row for row in rows if row.remedy != asked])
            remedy = lower(session)
            if remedy is not None and then_mm < least_mm:
                words = f"{remedy.words}: expected error {now_mm:.2f} mm, {then_mm:.2f} at best"
                best, least_mm = replace(remedy, words=words), then_mm
        if best is not None:
            return best
        largest = max(rows, key=lambda row: row.sigma_mm, default=None)
        return Remedy(largest.remedy) if largest is not None and largest.remedy else None

    return find


def _together_mm(rows: list[BudgetRow]) -> float:
    return float(np.sqrt(sum(row.sigma_mm**2 for row in rows)))


# remedy of a cause of errors -> what does it now
LOWERS: dict[str, Find] = {
    GAUGE: _always("record the probe on the gauge plate (step 8)", StartProbeMountingCapture()),
    POINTS: _reference_points,
    MORE_PASSES: _tilted_first(lambda session: None),
}
REGISTER = _of_part(
    "tool",
    Remedy("register the tool with twice the poses (step 2)", StartToolCapture(n_pivot=60)),
)
CALIBRATE = _of_part(
    "pointer", Remedy("pivot the pointer for longer (step 3)", StartPointerCapture(duration_s=60.0))
)
SWEEP = _always(
    "slide the pointer over the surface once more (step 4)", StartSurfaceCapture(append=True)
)
ALIGN = _of_part("registration", MORE_POINTS)
WHOLE_REGION = _always("record a path over the whole region (step 5)", StartPathCapture())
MOVE = _always("search a better place of the robot's base (step 7)", StartBasePlacement())
SCAN = _always("scan again (step 8)", StartScan())
BURR = _of_part("burr", Remedy("register the burr again (step 10)", StartBurrCapture()))
HAND = _of_part(
    "sono", Remedy("calibrate the SonoPointer again (step 9)", StartHandheldCalibration())
)
HAND_SCAN = _always("scan by hand once more (step 9)", StartHandheldScan())
REMEDIES: dict[str, Find] = {
    "tool_tip_error_mm": REGISTER,
    "tool_tip_sigma_mm": REGISTER,
    "tracker_registration_tre_mm": REGISTER,
    "tracker_registration_sigma_mm": REGISTER,
    "pointer_tip_error_mm": CALIBRATE,
    "pointer_tip_sigma_mm": CALIBRATE,
    "surface_rms_mm": SWEEP,
    "surface_sigma_predicted_mm": SWEEP,
    "skull_registration_tre_mm": ALIGN,
    "skull_registration_sigma_mm": ALIGN,
    "path_deviation_max_mm": _always("smooth the path again (step 6)", SmoothScanPath()),
    "normal_error_median_deg": SWEEP,
    "normal_error_p95_deg": SWEEP,
    "rolls_feasible": MOVE,
    "min_joint_margin_deg": MOVE,
    "landmark_distance_mm": _of_part(
        "landmarks", Remedy("touch the landmarks again (step 8)", StartLandmarkCapture())
    ),
    "contact_force_rms_n": SCAN,
    "contact_force_peak_n": SCAN,
    "head_shift_sigma_mm": SCAN,
    "head_shift_error_mm": SCAN,
    "head_motion_mm": SCAN,
    "outer_rms_mm": _of_budget("outer"),
    "fused_outer_rms_mm": _of_budget("outer"),
    "inner_rms_mm": _tilted_first(_of_budget("outer", "thickness")),
    "thickness_rms_mm": _tilted_first(_of_budget("thickness")),
    "thickness_sigma_predicted_mm": _of_budget("thickness"),
    "scan_thickness_rms_mm": _reference_points,
    "sound_speed_error_percent": _reference_points,
    "coverage_predicted_fraction": WHOLE_REGION,
    "coverage_fraction": WHOLE_REGION,
    "inner_coverage_fraction": _tilted_first(
        _of_part(
            "maps",
            Remedy("plan further tilted passes (step 9)", StartTiltPlan()),
        )
    ),
    "unflagged_failure_fraction": _tilted_first(_reference_points),
    "burr_tip_error_mm": BURR,
    "burr_tip_sigma_mm": BURR,
    "sono_face_error_mm": HAND,
    "sono_axis_error_deg": HAND,
    "sono_outer_rms_mm": HAND_SCAN,
    "sono_inner_rms_mm": HAND_SCAN,
    "sono_thickness_rms_mm": HAND_SCAN,
    "sono_coverage_fraction": HAND_SCAN,
    "sono_inner_coverage_fraction": HAND_SCAN,
}


def figure_remedy(key: str, session: Session) -> Remedy | None:
    """Return what to do about a figure that misses its limit; None where nothing is known to help.

    Args:
        key: Of the figure.
        session: That it is of.
    """
    find = REMEDIES.get(key)
    return None if find is None else find(session)
