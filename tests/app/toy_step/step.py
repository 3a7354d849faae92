"""A step that only the tests know: a capture and a result that no field of the session is for."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations.declarations import (
    Activity,
    ActivityContext,
    Capture,
    Command,
    Message,
    Result,
    Step,
    StepLine,
)
from rona_core.app.dependencies.inputs import capture_input, require_result, result_input
from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.runtime.handling import compute_result
from rona_core.app.runtime.recording import begin
from rona_core.app.steps.setup.capture_parts import robot_part
from rona_core.app.steps.setup.inputs import SCAN_SPEED
from rona_core.geometry.arrays import Floats, readonly
from rona_core.session.document import Session
from tests.app.toy_step.messages import FitToyLine, StartToyCapture


@dataclass(frozen=True, slots=True, eq=False)
class ToyCapture:
    ordinal: int
    setup_digest: str
    readings: Floats  # (n,)
    partial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ToyLine:
    fitted: Floats  # (n,)


def record(
    activity: StartToyCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    ordinal = begin(session, context)
    readings = readonly(np.arange(activity.n, dtype=np.float64))
    capture = ToyCapture(ordinal, capture_setup_digest("toy", session), readings)
    return (StoreCapture("toy", capture), FitToyLine())


def derive(session: Session, message: FitToyLine) -> ToyLine:
    capture = require_result(session.captures.get("toy"), "read the toy")
    speed = session.setup.devices.robot.scan_speed_mm_per_s
    return ToyLine(readonly(message.slope * speed * capture.readings))


TOY_CAPTURE, TOY = capture_input("toy"), result_input("toy line")
STEP = Step(
    "toy",
    commands=(Command(FitToyLine, compute_result, needs=(TOY_CAPTURE,)),),
    activities=(
        Activity(StartToyCapture, record, "Reading the toy", uses_devices=True, records=True),
    ),
    captures=(Capture("toy", "read the toy", (robot_part,), types=(ToyCapture,)),),
    results=(
        Result(
            "toy line",
            FitToyLine,
            derive,
            {"capture": TOY_CAPTURE, "speed": SCAN_SPEED},
            "fit the toy line",
            types=(ToyLine,),
        ),
    ),
    line=StepLine(
        "Toy",
        lambda session: "" if session.results.get("toy line") is None else "a line",
        StartToyCapture,
        leaves=lambda session: (TOY_CAPTURE, TOY),
    ),
)
