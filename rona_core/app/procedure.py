"""The whole procedure as a list of messages, for the terminal, for tests and for benchmarks."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rona_core.app.messages import (
    COMMANDS,
    SmoothScanPath,
    StartMapping,
    StartPathCapture,
    StartPointerCapture,
    StartRollSearch,
    StartScan,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.app.workbench import Workbench
from rona_core.devices.protocols import Cancel
from rona_core.errors import CancelledError, RonaError

StepProgress = Callable[[str, float], None]  # step, share done

PROCEDURE: tuple[tuple[str, Any], ...] = (
    ("tool", StartToolCapture()),
    ("pointer", StartPointerCapture()),
    ("surface", StartSurfaceCapture()),
    ("path", StartPathCapture()),
    ("smoothing", SmoothScanPath()),
    ("roll", StartRollSearch()),
    ("scan", StartScan()),
    ("maps", StartMapping()),
)


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run of the procedure ended."""

    completed: bool
    failed_step: str | None = None
    reason: str | None = None


def run_procedure(
    bench: Workbench,
    *,
    progress: StepProgress = lambda step, share: None,
    cancel: Cancel = lambda: False,
    messages: tuple[tuple[str, Any], ...] = PROCEDURE,
) -> Ending:
    """Carry out all steps after set-up, one after the other; stop where one cannot be done.

    Raises:
        CancelledError: somebody cancelled.
    """
    for step, message in messages:
        if cancel():
            raise CancelledError(f"cancelled before step {step}")
        progress(step, 0.0)
        try:
            if type(message).__name__ in COMMANDS:
                bench.dispatch(message)
            else:
                bench.run(message, lambda share, step=step: progress(step, share), cancel)
        except CancelledError:
            raise
        except RonaError as error:
            return Ending(False, step, str(error))
        reason = _unfinished(step, bench)
        if reason is not None:
            return Ending(False, step, reason)
        progress(step, 1.0)
    return Ending(True)


def _unfinished(step: str, bench: Workbench) -> str | None:
    """Return why a step that ran left nothing to go on with, or None."""
    if step != "roll" or bench.session.results.roll is None:
        return None
    plan = bench.session.results.roll.value
    if plan.mode == "none":
        return plan.refusal()
    if plan.trajectory is None or plan.certificate is None:
        return "no trajectory was planned"
    if not plan.certificate.certifies(plan.trajectory):
        return f"the verifier refuses the plan: {plan.certificate.refusal()}"
    return None
