"""The pointer on the landmarks, recorded, and where the robot's tip touched them."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.references import REGISTERED, Registered, found_again
from rona_core.app.dependencies.staleness import capture_input, capture_setup_digest, result_input
from rona_core.app.runtime.handling import capture_hand
from rona_core.app.steps.pointer.derivation import EVIDENCE, POINTER, Evidence
from rona_core.app.steps.scan.landmarks.messages import StartLandmarkCapture
from rona_core.app.steps.setup.capture_parts import reference_input
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.landmark_check import LandmarkCheck
from rona_core.geometry.arrays import Floats, readonly
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session

SETTLE_S = (
    0.1  # after the pointer has come to a landmark, and before it leaves, frames do not count
)


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkCapture:
    """The pointer held on n landmarks, and the robot's joint angles with its tip in each."""

    ordinal: int
    setup_digest: str
    stroke: PointerCapture
    names: tuple[str, ...]
    qs_rad: Floats  # (n, 6) as the robot's controller keeps them
    dwell_start_s: Floats  # (n,)
    dwell_end_s: Floats  # (n,)
    partial: bool = False


def capture_landmarks(
    activity: StartLandmarkCapture, session: Session, context: ActivityContext
) -> LandmarkCapture:
    """Record the pointer marker while the pointer rests on one landmark after the other."""
    taught: list[tuple[tuple[str, ...], Floats]] = []

    def touch() -> float:
        taught.append(context.rig.bench.taught_landmarks())
        return context.rig.operator.touch(
            taught[0][0], dwell_s=activity.dwell_s, travel_s=activity.travel_s
        )

    stroke = capture_hand("landmarks", session, context, touch)
    ((names, qs_rad),) = taught
    each_s = activity.travel_s + activity.dwell_s
    starts_s: Floats = activity.travel_s + each_s * np.arange(len(names), dtype=np.float64)
    return LandmarkCapture(
        ordinal=stroke.ordinal,
        setup_digest=capture_setup_digest("landmarks", session),
        stroke=stroke,
        names=names,
        qs_rad=readonly(qs_rad),
        dwell_start_s=readonly(starts_s + SETTLE_S),
        dwell_end_s=readonly(starts_s + activity.dwell_s - SETTLE_S),
        partial=stroke.partial,
    )


LANDMARKS_CAPTURE: Input[LandmarkCapture] = capture_input("landmarks")
CHECK: Input[LandmarkCheck] = result_input("landmarks", optional=True)


def _found_again(session: Session) -> bool:
    held = LANDMARKS_CAPTURE.read(session)
    return held is None or found_again(session, (held.stroke,))


@inputs(
    implied=(
        "robot",
        "errors of the robot",
        "place of the tracker",
        "field of the tracker",
        "capture of the tool",
        "capture of the pointer",
    ),
    free=("use of the base marker",),
)
class LandmarkInputs:
    """What tracker, pointer and robot are compared from."""

    capture: LandmarkCapture = given(LANDMARKS_CAPTURE, "capture")
    registered: Registered = given(REGISTERED)
    pointer: PointerCalibration = given(POINTER, "pointer")
    found_again: bool = given(reference_input(_found_again), "reference")
    evidence: Evidence = given(EVIDENCE)


@inputs()
class OverrideInputs:
    """What a verification is overridden for."""

    check: LandmarkCheck | None = given(CHECK, "landmarks")
    tool: ToolRegistration = given(TOOL, "tool")
    pointer: PointerCalibration = given(POINTER, "pointer")
