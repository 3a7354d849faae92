"""Pointer: calibration of the pointer's tip by pivoting."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Remedy
from rona_core.app.dependencies.base_reference import error_field
from rona_core.app.dependencies.inputs import capture_input, require_result, result_input
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.messages.serialization import message_from
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.runtime.recording import capture_hand
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses, StartPointerCapture
from rona_core.app.steps.pointer.pivot_report import calibrate_imported
from rona_core.app.steps.pointer.tracker_field import with_tracker_field
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.derivation import excluded_mask
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.errors import StepBlockedError
from rona_core.session.captures import PointerCapture, is_imported
from rona_core.session.document import Session

POINTER_CAPTURE, POINTER = capture_input("pointer"), result_input("pointer")


def capture_pivot(
    activity: StartPointerCapture, session: Session, context: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer pivots about its tip."""
    operator = context.rig.operator
    if not activity.by_hand:
        return capture_hand(
            "pointer",
            session,
            context,
            lambda: operator.pivot(cone_deg=activity.cone_deg, duration_s=activity.duration_s),
        )
    try:
        return capture_hand(
            "pointer",
            session,
            context,
            lambda: operator.pivot_by_hand(duration_s=activity.duration_s),
            lambda: not operator.in_hand(),
        )
    finally:
        operator.finish()


def derive_pointer(session: Session, message: CalibratePointer) -> PointerCalibration:
    """Calibrate the pointer from its pivoting.

    Raises:
        InvalidInputError: too few poses, or one to be left out that there is not.
        DegenerateGeometryError: they tell too little.
    """
    capture = require_result(session.captures.pointer, "record the pivoting of the pointer")
    geometry = GEOMETRIES[capture.pointer]
    exclude = excluded_mask(message.exclude, len(capture.marker.times_s))
    if is_imported(capture):
        made = calibrate_imported(capture, method=message.method, exclude=exclude)
    else:
        made = calibrate_pointer(
            capture.marker.Ts_tracker_marker,
            pointer=capture.pointer,
            dof=geometry.dof,
            method=message.method,
            positions_pointermarker=geometry.positions_marker,
            exclude=exclude,
        )
    return with_tracker_field(made, capture, error_field(session.setup.devices.tracker))


def exclude_poses(message: ExcludePoses, session: Session) -> Session:
    """Carry out `ExcludePoses`."""
    derived = session.results.get(message.step)
    kind = {"tool": RegisterTool, "pointer": CalibratePointer}[message.step]
    if derived is None:
        raise StepBlockedError(f"ExcludePoses is blocked: first calibrate (step {message.step})")
    rows = tuple(sorted(message.indices))
    arguments = {**derived.arguments, "exclude": list(rows)}
    return compute_result(message_from(kind.__name__, arguments), session)


def _summary(session: Session) -> str:
    held = session.results.pointer
    if held is None:
        return ""
    pointer = held.value
    return f"{pointer.dof}D, {pointer.n_used} poses, expected error {pointer.tip_sigma_mm:.2f} mm"


STEP = declare.Step(
    "pointer",
    commands=(
        declare.Command(CalibratePointer, compute_result, needs=(POINTER_CAPTURE,)),
        declare.Command(ExcludePoses, exclude_poses),
    ),
    activities=(
        declare.Activity(
            StartPointerCapture,
            record("pointer", capture_pivot, CalibratePointer),
            "Pivoting the pointer",
            makes=("pointer",),
        ),
    ),
    captures=(
        declare.Capture(
            "pointer",
            "record the pivoting of the pointer (step 3)",
            (parts.tracker, parts.pointer),
        ),
    ),
    results=(
        declare.Result(
            "pointer",
            CalibratePointer,
            derive_pointer,
            {"capture": POINTER_CAPTURE},
            "calibrate the pointer (step 3)",
            judged=by_verdict(
                Remedy("pivot the pointer again (step 3)", StartPointerCapture()), used=True
            ),
        ),
    ),
    line=declare.StepLine(
        "Pointer",
        _summary,
        StartPointerCapture,
        leaves=lambda session: (POINTER_CAPTURE, POINTER),
    ),
)
