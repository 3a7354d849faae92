"""Pointer: calibration of the pointer's tip by pivoting."""

from rona_core.app.declarations.declarations import (
    Activity,
    Capture,
    Command,
    Result,
    Step,
    StepLine,
)
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.dependencies.step_states import stopped_early
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.pointer.captures import record_pivot
from rona_core.app.steps.pointer.derivation import derive_pointer
from rona_core.app.steps.pointer.handlers import exclude_poses
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses, StartPointerCapture
from rona_core.app.steps.setup.capture_parts import pointer_part, tracker_part
from rona_core.session.document import Session

POINTER_CAPTURE, POINTER = capture_input("pointer"), result_input("pointer")


def _summary(session: Session) -> str:
    held = session.results.pointer
    if held is None:
        return ""
    pointer = held.value
    return f"{pointer.dof}D, {pointer.n_used} poses, random error {pointer.tip_sigma_mm:.2f} mm"


STEP = Step(
    "pointer",
    commands=(
        Command(CalibratePointer, compute_result, needs=(POINTER_CAPTURE,)),
        Command(ExcludePoses, exclude_poses),
    ),
    activities=(
        Activity(
            StartPointerCapture,
            record_pivot,
            "Pivoting the pointer",
            uses_devices=True,
            records=True,
        ),
    ),
    captures=(
        Capture(
            "pointer",
            "record the pivoting of the pointer (step 3)",
            (tracker_part, pointer_part),
        ),
    ),
    results=(
        Result(
            "pointer",
            CalibratePointer,
            derive_pointer,
            {"capture": POINTER_CAPTURE},
            "calibrate the pointer (step 3)",
        ),
    ),
    line=StepLine(
        "Pointer",
        _summary,
        StartPointerCapture,
        leaves=lambda session: (POINTER_CAPTURE, POINTER),
        partial=lambda session: stopped_early("pointer", session),
    ),
)
