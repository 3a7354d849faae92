"""Inputs of the registration of the burr, and what others take from it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.judge import judge_part, usable
from rona_core.app.dependencies.references import TRACKER_FIELD
from rona_core.app.dependencies.staleness import capture_input
from rona_core.app.steps.setup.capture_parts import MODEL, ROBOT_ERRORS
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.geometry.arrays import Bools, Floats, Vector3
from rona_core.mapping.accuracy.probe_place import SEAT_MM
from rona_core.session.captures import ToolCapture
from rona_core.session.document import Session


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


UNKNOWN = (
    f"Not registered: the burr may be off by {SEAT_MM:g} mm along each axis, so fewer beds fit."
)


def burr_words(session: Session) -> str:
    """Return what is known of the burr's tip, and whether it is used; empty if not registered."""
    held = session.results.get("burr")
    if held is None:
        return ""
    found: BurrRegistration = held.value
    x, y, z = found.offset_tip.tolist()
    words = (
        f"Tip {np.linalg.norm(found.offset_tip):.2f} mm off its drawing (x {x:+.2f}, y {y:+.2f}, "
        f"z {z:+.2f}), expected error "
        f"{FIGURES['burr_tip_sigma_mm'].words(found.tip_sigma_mm)}"
    )
    judgement = judge_part("burr", session)
    sentence = judgement.beside(words)
    return f"{sentence} The milling is corrected." if judgement.holds else sentence
