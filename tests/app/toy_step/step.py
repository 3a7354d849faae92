"""A step that only the tests know: a capture and a result that no field of the session is for."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.declarations.inputs import given, inputs
from rona_core.app.dependencies.staleness import capture_input, capture_setup_digest, result_input
from rona_core.app.runtime.handling import begin, compute_result, record
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.setup.capture_parts import SCAN_SPEED
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


def capture(activity: StartToyCapture, session: Session, context: ActivityContext) -> ToyCapture:
    ordinal = begin(session, context)
    readings = readonly(np.arange(activity.n, dtype=np.float64))
    return ToyCapture(ordinal, capture_setup_digest("toy", session), readings)


TOY_CAPTURE, TOY = capture_input("toy"), result_input("toy line")


@inputs()
class ToyInputs:
    taken: ToyCapture = given(TOY_CAPTURE, "capture")
    speed_mm_per_s: float = given(SCAN_SPEED, "speed")


def derive(known: ToyInputs, message: FitToyLine) -> ToyLine:
    return ToyLine(readonly(message.slope * known.speed_mm_per_s * known.taken.readings))


STEP = declare.Step(
    "toy",
    commands=(declare.Command(FitToyLine, compute_result, needs=(TOY_CAPTURE,)),),
    activities=(
        declare.Activity(
            StartToyCapture, record("toy", capture, FitToyLine), "Reading the toy", makes=("toy",)
        ),
    ),
    captures=(
        declare.Capture(
            "toy", "read the toy", (parts.robot,), types=(ToyCapture,), done="the toy was read"
        ),
    ),
    results=(
        declare.Result.of(
            "toy line", FitToyLine, derive, "fit the toy line", done="the toy line was fitted"
        ),
    ),
    line=declare.StepLine(
        "Toy",
        lambda session: "" if session.results.get("toy line") is None else "a line",
        StartToyCapture,
        leaves=lambda session: (TOY_CAPTURE, TOY),
    ),
)
