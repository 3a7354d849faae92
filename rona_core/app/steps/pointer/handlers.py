"""Handlers of the pointer calibration."""

from rona_core.app.messages.serialization import message_from
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session


def exclude_poses(message: ExcludePoses, session: Session) -> Session:
    """Carry out `ExcludePoses`."""
    derived = session.results.get(message.step)
    kind = {"tool": RegisterTool, "pointer": CalibratePointer}[message.step]
    if derived is None:
        raise StepBlockedError(f"ExcludePoses is blocked: first calibrate (step {message.step})")
    rows = tuple(sorted(message.indices))
    arguments = {**derived.arguments, "exclude": list(rows)}
    return compute_result(message_from(kind.__name__, arguments), session)
