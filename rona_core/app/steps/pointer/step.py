"""Pointer: calibration of the pointer's tip by pivoting."""

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
from rona_core.app.dependencies.step_states import stopped_early
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.messages.serialization import message_from
from rona_core.app.runtime.handling import compute_result
from rona_core.app.runtime.recording import capture_hand
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses, StartPointerCapture
from rona_core.app.steps.setup.capture_parts import pointer_part, tracker_part
from rona_core.app.steps.tool.derivation import excluded_mask
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.errors import StepBlockedError
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


def capture_pivot(
    activity: StartPointerCapture, session: Session, tools: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer pivots about its tip."""
    operator = tools.rig.operator
    if not activity.by_hand:
        return capture_hand(
            "pointer",
            session,
            tools,
            lambda: operator.pivot(cone_deg=activity.cone_deg, duration_s=activity.duration_s),
        )
    try:
        return capture_hand(
            "pointer",
            session,
            tools,
            lambda: operator.pivot_by_hand(duration_s=activity.duration_s),
            lambda: not operator.in_hand(),
        )
    finally:
        operator.finish()


def record_pivot(
    activity: StartPointerCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record the pivoting of the pointer, then calibrate it."""
    capture = capture_pivot(activity, session, context)
    stored = StoreCapture("pointer", capture)
    return (stored,) if capture.partial else (stored, CalibratePointer())


def derive_pointer(session: Session, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: they tell too little.
    """
    capture = require_result(session.captures.pointer, "record the pivoting of the pointer")
    geometry = GEOMETRIES[capture.pointer]
    return calibrate_pointer(
        capture.marker.Ts_tracker_marker,
        pointer=capture.pointer,
        dof=geometry.dof,
        method=message.method,
        positions_pointermarker=geometry.positions_marker,
        exclude=excluded_mask(message.exclude, len(capture.marker.times_s)),
    )


def exclude_poses(message: ExcludePoses, session: Session) -> Session:
    """Carry out `ExcludePoses`."""
    derived = session.results.get(message.step)
    kind = {"tool": RegisterTool, "pointer": CalibratePointer}[message.step]
    if derived is None:
        raise StepBlockedError(f"ExcludePoses is blocked: first calibrate (step {message.step})")
    rows = tuple(sorted(message.indices))
    arguments = {**derived.arguments, "exclude": list(rows)}
    return compute_result(message_from(kind.__name__, arguments), session)


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
