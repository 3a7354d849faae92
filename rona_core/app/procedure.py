"""The whole procedure as a list of messages, for the terminal, for tests and for benchmarks."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rona_core.app.messages.registry import (
    COMMANDS,
    SmoothScanPath,
    StartBasePlacement,
    StartGapPlan,
    StartGapScan,
    StartMapping,
    StartPathCapture,
    StartPointerCapture,
    StartRollSearch,
    StartScan,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.roll.base_placement import advice
from rona_core.devices.protocols import Cancel, never, silent
from rona_core.errors import CancelledError, RonaError
from rona_core.robot.planning.plan import RobotPlan

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
    ("second", StartGapPlan()),
    ("second", StartGapScan()),
    ("second", StartMapping()),
)
SPARED = "second"  # the procedure is complete without it: there may be no gap, or no way to it


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run of the procedure ended."""

    completed: bool
    failed_step: str | None = None
    reason: str | None = None
    second_pass_reason: str | None = None  # why the gaps were not scanned again


def unwatched(step: str, share: float) -> None:
    """Nobody watches the steps."""


def run_procedure(
    bench: Workbench,
    *,
    progress: StepProgress = unwatched,
    cancel: Cancel = never,
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
            if step == SPARED:
                progress(step, 1.0)
                return Ending(True, second_pass_reason=str(error))
            return Ending(False, step, str(error))
        reason = _unfinished(step, bench)
        if reason is not None:
            return Ending(False, step, f"{reason}. {_base_move(bench, cancel)}")
        progress(step, 1.0)
    return Ending(True)


def _unfinished(step: str, bench: Workbench) -> str | None:
    """Return why a step that ran left nothing to go on with, or None."""
    if step != "roll" or bench.session.results.roll is None:
        return None
    return why_no_plan(bench.session.results.roll.value)


def _base_move(bench: Workbench, cancel: Cancel) -> str:
    """Return which move of the robot's base would help; the search has a bound of its own."""
    try:
        bench.run(StartBasePlacement(), silent, cancel)
    except CancelledError:
        raise
    except RonaError as error:
        return f"Move the robot base or change the path; where to, is not known: {error}"
    found = bench.session.results.placement
    return "Change the path" if found is None else advice(found.value)


def _varying(plan: RobotPlan) -> str:
    """Return what became of a roll that varies, where one was looked for."""
    return "" if plan.varying is None else f"; {plan.varying.sentence}"


def why_no_plan(plan: RobotPlan) -> str | None:
    """Return why a plan cannot be executed, or None if it can."""
    if plan.may_move:
        return None
    if plan.mode == "none":
        stopped = [verdict for verdict in plan.verdicts if not verdict.feasible]
        causes = Counter(verdict.reason for verdict in stopped)
        counts = [f"{count} by {cause}" for cause, count in causes.most_common()]
        if plan.n_feasible:
            counts.append(f"{plan.n_feasible} with less room were not tried")
        told = ""
        if stopped:
            furthest = max(stopped, key=lambda verdict: verdict.index)
            told = f"; the one that gets furthest: {furthest.sentence}"
        if refused := plan.refused:
            told = f"; tried first: {refused.sentence}{told}"
        return (
            f"none of {len(plan.verdicts)} rolls works ({', '.join(counts)}){told}{_varying(plan)}"
        )
    failures = plan.certificate.failures() if plan.certificate is not None else ()
    return "the verifier refuses the plan: " + "; ".join(check.sentence for check in failures)
