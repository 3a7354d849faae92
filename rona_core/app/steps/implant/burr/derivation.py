"""Registration of the burr from the recorded turns of the spindle about its tip."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.declarations.figures import limit_of
from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.judge import usable
from rona_core.app.dependencies.references import TRACKER_FIELD
from rona_core.app.dependencies.staleness import capture_input
from rona_core.app.steps.implant.burr.messages import RegisterBurr
from rona_core.app.steps.setup.capture_parts import MODEL, ROBOT_ERRORS
from rona_core.app.steps.tool.derivation import (
    TOOL,
    excluded_mask,
    tool_dwells,
    worse_half,
)
from rona_core.calibration.hand_eye.hand_eye import TOOL_MARKERS
from rona_core.calibration.hand_eye.seated_tip import SeatedTip, solve_seated_tip
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.pivot.maximum_likelihood import PivotMotion, tip_sensitivity
from rona_core.calibration.pivot.pivot_calibration import solve_pivot
from rona_core.calibration.tracking_error import LearnedField, TrackerErrorField
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import ROBOT_ACCURACY_MM, link_errors
from rona_core.session.captures import ToolCapture


@dataclass(frozen=True, slots=True, eq=False)
class BurrRegistration:
    """The registered tip of the burr against the drawing, and how sure it is."""

    offset_tip: Vector3  # (3,) mm in ``tip``, off where the robot's drawing has it
    covariance: Floats  # (3, 3) mm^2 of it: chance, chuck, and what the robot does the same always
    tip_sigma_mm: float  # predicted 3D standard deviation
    seat_base: Vector3  # (3,) mm
    residuals_mm: Floats  # (n,) distance of the tip from the seat
    rmse_mm: float  # of those used
    cone_deg: float  # over which the spindle was turned
    used: Bools  # (n,)
    tracker_mm: float | None  # from where the marker puts the tip; None: the tracker does not tell
    tracker_sigma_mm: float | None  # predicted 3D standard deviation of that distance
    verdict: Literal["good", "weak", "bad"]
    reasons: tuple[str, ...]  # of a verdict that is not good, each with its remedy


BURR_CAPTURE: Input[ToolCapture] = capture_input("burr")
KNOWN_BURR: Input[BurrRegistration] = Input(
    lambda s: usable("burr", s), "register the burr (step 10)", optional=True, part="burr"
)


@inputs(implied=("errors of the robot", "field of the tracker"))
class BurrInputs:
    """What the tip of the burr is registered from."""

    capture: ToolCapture = given(BURR_CAPTURE, "capture")
    tool: ToolRegistration = given(TOOL, "tool")
    robot: str = given(MODEL, "robot")
    errors: bool = given(ROBOT_ERRORS, "errors of the robot")
    field: TrackerErrorField = given(TRACKER_FIELD, "field of the tracker")


# Assumed, per axis: a shank in a collet runs out by some hundredths of a millimetre, and the pin
# that was registered does so as the burr does that takes its place.
CHUCK_MM = 0.06
# predicted error of a good registration, and of one of use at all
GOOD_MM, WEAK_MM = limit_of("burr_tip_sigma_mm"), 1.0
SCATTER_MM = 0.5  # of a tip that stayed in its seat; robots repeat ten times better
FURTHEST_MM = 3.0  # a spindle so far off its drawing is not clamped as it should be
SIGNIFICANT_SIGMAS = 2.5  # 3D: robot and tracker this far apart do not speak of one tip


def register_burr(known: BurrInputs, message: RegisterBurr) -> BurrRegistration:
    """Return where the seat held the tip, with its error, beside where the tracker puts it.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: the tracker saw the marker at none, or the spindle hardly turned.
    """
    model = robot_model(known.robot)
    qs_rad, markers, _ = tool_dwells(known.capture, model)
    tips = model.forward(qs_rad) @ model.T_flange_tip
    found = solve_seated_tip(tips, excluded_mask(message.exclude, len(tips)))
    by_links = _by_links(known, qs_rad, found)
    covariance = found.covariance + by_links @ by_links.T + CHUCK_MM**2 * np.eye(3)
    sigma_mm = float(np.sqrt(np.trace(covariance)))
    seen = _by_tracker(known, markers.select(found.used))
    distance_mm = distance_sigma_mm = None
    if seen is not None:
        offset, of_tracker = seen
        distance_mm = float(np.linalg.norm(offset - found.offset_tip))
        distance_sigma_mm = float(np.sqrt(np.trace(of_tracker + found.covariance)))
    verdict, reasons = _judge(found, sigma_mm, distance_mm, distance_sigma_mm)
    return BurrRegistration(
        offset_tip=found.offset_tip,
        covariance=readonly(covariance),
        tip_sigma_mm=sigma_mm,
        seat_base=found.seat_base,
        residuals_mm=found.residuals_mm,
        rmse_mm=found.rmse_mm,
        cone_deg=found.cone_deg,
        used=found.used,
        tracker_mm=distance_mm,
        tracker_sigma_mm=distance_sigma_mm,
        verdict=verdict,
        reasons=reasons,
    )


def _by_links(known: BurrInputs, qs_rad: Floats, found: SeatedTip) -> Floats:
    """Return what errors of the links do to the offset (3, 36), as the robot is stated."""
    model = robot_model(known.robot)
    accuracy_mm = ROBOT_ACCURACY_MM if known.errors else 0.0
    links = link_errors(model, qs_rad[found.used], model.T_flange_tip, accuracy_mm)
    moved = np.einsum("knj,njl->kl", found.by_robot[:, found.used], links[:, 3:])
    return worse_half(moved, moved)


def _by_tracker(known: BurrInputs, markers: Poses) -> tuple[Floats, Floats] | None:
    """Return the offset (3,) by the marker, and its covariance (3, 3); None without one.

    The marker swings about the seat, and step 2 says where the drawn tip is in it. What the links
    of the robot do to step 2 they do to the seated tip, too, so it is not in the covariance.
    """
    try:
        swung = solve_pivot(markers, dof=6, method="ml", at_least=5, positions_marker=TOOL_MARKERS)
    except RonaError:
        return None
    motion = PivotMotion(
        markers.select(swung.used), TOOL_MARKERS, 6, swung.tip_marker, swung.pivot_tracker
    )
    moved = tip_sensitivity(motion)
    field, tool = LearnedField(known.field), known.tool
    spread = swung.covariance[:3, :3] + field.propagate(moved.tip, moved.points_tracker)
    T_tip_toolmarker = tool.T_toolmarker_tip.inv()
    R = T_tip_toolmarker.rotation
    random = tool.covariance if tool.random_covariance is None else tool.random_covariance
    return T_tip_toolmarker @ swung.tip_marker, R @ (spread + random[9:, 9:]) @ R.T


def _judge(
    found: SeatedTip, sigma_mm: float, distance_mm: float | None, distance_sigma_mm: float | None
) -> tuple[Literal["good", "weak", "bad"], tuple[str, ...]]:
    """Return the verdict, and the reasons with their remedies."""
    reasons: list[str] = []
    if sigma_mm > GOOD_MM:
        reasons.append(
            f"the tip is expected to be off by {sigma_mm:.2f} mm, {GOOD_MM} are good: turn it "
            "further in its seat"
        )
    slipped = found.rmse_mm > SCATTER_MM
    if slipped:
        reasons.append(f"the tip left its seat by {found.rmse_mm:.2f} mm (RMS): turn it again")
    off_mm = float(np.linalg.norm(found.offset_tip))
    if off_mm > FURTHEST_MM:
        reasons.append(f"the tip is {off_mm:.1f} mm off its drawing: look how it is clamped")
    if distance_mm is not None and distance_mm > SIGNIFICANT_SIGMAS * (distance_sigma_mm or 0.0):
        reasons.append(
            f"the tracker puts the tip {distance_mm:.2f} mm elsewhere: look whether the marker "
            "has moved, and register the tool again (step 2)"
        )
    if slipped or off_mm > FURTHEST_MM or sigma_mm > WEAK_MM:
        return "bad", tuple(reasons)
    return ("weak" if reasons else "good"), tuple(reasons)
