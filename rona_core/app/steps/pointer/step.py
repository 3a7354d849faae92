"""Pointer: calibration of the pointer's tip by pivoting."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Remedy
from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.handling import capture_hand, compute_result, record
from rona_core.app.steps.pointer.derivation import POINTER, POINTER_CAPTURE, calibrate
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses, StartPointerCapture
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.errors import StepBlockedError
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


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


def exclude_poses(message: ExcludePoses, session: Session) -> Session:
    """Carry out `ExcludePoses`."""
    derived = session.results.get(message.step)
    kind = {"tool": RegisterTool, "pointer": CalibratePointer}[message.step]
    if derived is None:
        raise StepBlockedError(f"first calibrate (step {message.step})")
    rows = tuple(sorted(message.indices))
    arguments = {**derived.arguments, "exclude": list(rows)}
    return compute_result(message_from(kind.__name__, arguments), session)


def _summary(session: Session) -> str:
    held = session.results.pointer
    if held is None:
        return ""
    pointer = held.value
    expected = FIGURES["pointer_tip_sigma_mm"].words(pointer.tip_sigma_mm)
    return f"{pointer.dof}D, {pointer.n_used} poses, expected error {expected}"


STEP = declare.Step(
    "pointer",
    commands=(
        declare.Command(CalibratePointer, compute_result, needs=(POINTER_CAPTURE,)),
        declare.Command(
            ExcludePoses, exclude_poses, done="the poses of a calibration were chosen by hand"
        ),
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
            done="the pivoting of the pointer was recorded",
        ),
    ),
    results=(
        declare.Result.of(
            "pointer",
            CalibratePointer,
            calibrate,
            "calibrate the pointer (step 3)",
            judged=by_verdict(
                Remedy("pivot the pointer again (step 3)", StartPointerCapture()), used=True
            ),
            done="the calibration of the pointer was computed",
        ),
    ),
    line=declare.StepLine(
        "Pointer",
        _summary,
        StartPointerCapture,
        leaves=lambda session: (POINTER_CAPTURE, POINTER),
    ),
)
