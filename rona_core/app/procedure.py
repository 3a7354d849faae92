"""The whole procedure as a list of messages, for the terminal, for tests and for benchmarks."""

from collections.abc import Callable
from dataclasses import dataclass

from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.messages import PlanMilling, RehearseMilling, StartBedSearch
from rona_core.app.steps.maps.messages import StartGapPlan, StartGapScan, StartMapping
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.base_placement import advice
from rona_core.app.steps.roll.messages import StartBasePlacement, StartRollSearch
from rona_core.app.steps.roll.plan_reasons import why_no_plan
from rona_core.app.steps.scan.messages import StartProbeMountingCapture, StartScan
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.devices.protocols import Cancel, never, silent
from rona_core.errors import CancelledError, RonaError

StepProgress = Callable[[str, float], None]  # step, share done

Messages = tuple[tuple[str, Message], ...]  # with the step of each

PROCEDURE: Messages = (
    ("tool", StartToolCapture()),
    ("pointer", StartPointerCapture()),
    ("surface", StartSurfaceCapture()),
    ("path", StartPathCapture()),
    ("smoothing", SmoothScanPath()),
    ("roll", StartRollSearch()),
    ("scan", StartProbeMountingCapture()),
    ("scan", StartScan()),
    ("maps", StartMapping()),
    ("second", StartGapPlan()),
    ("second", StartGapScan()),
    ("references", StartCaliperMeasurements()),
    ("maps", StartMapping()),
)
WITHOUT_REFERENCES = tuple(step for step in PROCEDURE if step[0] != "references")
# what may follow
IMPLANT: Messages = (
    ("implant", StartBurrCapture()),
    ("implant", StartBedSearch()),
    ("milling", PlanMilling()),
    ("milling", RehearseMilling()),
)
# The procedure is complete without these: there may be no gap, or no way to it, and no place that
# is thick and sure enough for a caliper, and an implant may be larger than what was scanned.
SPARED = ("second", "references", "implant", "milling")


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run of the procedure ended."""

    completed: bool
    failed_step: str | None = None
    reason: str | None = None
    second_pass_reason: str | None = None  # why the gaps were not scanned again
    references_reason: str | None = None  # why nothing was measured with a caliper
    bed_reason: str | None = None  # why no implant bed was searched
    milling_reason: str | None = None  # why its milling was not planned or rehearsed


def unwatched(step: str, share: float) -> None:
    """Nobody watches the steps."""


def run_procedure(
    bench: Workbench,
    *,
    progress: StepProgress = unwatched,
    cancel: Cancel = never,
    messages: Messages = PROCEDURE,
) -> Ending:
    """Carry out all steps after set-up, one after the other; stop where one cannot be done.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    spared: dict[str, str] = {}  # step, why it was not done
    for step, message in messages:
        if step in spared:
            continue
        if cancel():
            raise CancelledError(f"cancelled before step {step}")
        progress(step, 0.0)
        try:
            if type(message).__name__ in REGISTRY.command_types:
                bench.dispatch(message)
            else:
                bench.run(message, lambda share, step=step: progress(step, share), cancel)
        except CancelledError:
            raise
        except RonaError as error:
            if step in SPARED:
                progress(step, 1.0)
                spared[step] = str(error)
                continue
            return Ending(False, step, str(error))
        reason = _unfinished(step, bench)
        if reason is not None:
            return Ending(False, step, f"{reason}. {_base_move(bench, cancel)}")
        progress(step, 1.0)
    return Ending(
        True,
        second_pass_reason=spared.get("second"),
        references_reason=spared.get("references"),
        bed_reason=spared.get("implant"),
        milling_reason=spared.get("milling"),
    )


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
