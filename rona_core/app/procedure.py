"""The procedure, once: its stages in order, which of them is next, and all one after the other.

Terminal, page, REST, tests and benchmarks take the stages from here.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace

from rona_core.app.declarations.declarations import Judgement, Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.messages import PlanMilling, RehearseMilling, StartBedSearch
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan, StartTiltScan
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.certificate_view import why_no_plan
from rona_core.app.steps.roll.messages import StartBasePlacement, StartRollSearch
from rona_core.app.steps.roll.step import advice
from rona_core.app.steps.scan.messages import StartProbeMountingCapture, StartScan
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.errors import CancelledError, InvalidInputError, RonaError
from rona_core.session.document import Session

StepProgress = Callable[[str, float], None]  # name of a stage, share done


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of the procedure: the message that does it and the part that it makes."""

    name: str
    message: Message
    makes: str  # name of the result, or "capture " and that of the capture, that it is judged by
    title: str  # words of a button
    offered: str = ""  # what it brings, where the procedure is complete without it
    seen_first: bool = False  # its step is looked at before it is started
    ends_weak: bool = False  # where what it makes is weak, the procedure ends short of its aim

    @property
    def step(self) -> str:
        """Name of the step of the list that it belongs to."""
        return REGISTRY.shown_in(type(self.message).__name__) or self.name

    def judgement(self, session: Session) -> Judgement:
        """Return the judgement of what it makes."""
        return judge_part(self.makes, session)

    def next_message(self, session: Session) -> Message | None:
        """Return what brings the stage forward now; None where a person must act.

        That is the remedy of its judgement, with the fields of the stage where it is its message
        with no other fields chosen.
        """
        remedy = self.judgement(session).remedy
        message = None if remedy is None else remedy.message
        return self.message if message == type(self.message)() else message

    def falls_short(self, session: Session) -> bool:
        """Return whether all is done and yet the procedure ends short of its aim here."""
        return self.ends_weak and self.judgement(session).state == "weak"

    def is_due(self, session: Session) -> bool:
        """Return whether a message of this very stage makes its part usable now."""
        kind = type(self.next_message(session))
        if kind is type(self.message):
            return True  # what follows a recording computes from it
        return any(result.name == self.makes for result in REGISTRY.results_of(kind.__name__))


PROCEDURE = (
    Stage("tool", StartToolCapture(), "tool", "Register the tool"),
    Stage("pointer", StartPointerCapture(), "pointer", "Calibrate the pointer"),
    Stage("surface", StartSurfaceCapture(), "surface", "Sweep the surface"),
    Stage("path", StartPathCapture(), "path", "Record the path"),
    Stage("smoothing", SmoothScanPath(), "smoothing", "Smooth the path"),
    Stage("roll", StartRollSearch(), "roll", "Plan the motion"),
    Stage(
        "gauge",
        StartProbeMountingCapture(),
        "mounting",
        "Record on gauge plate",
        offered="the place of the probe's face, the largest error of the outer map",
    ),
    Stage("scan", StartScan(), "capture scan", "Scan", seen_first=True),
    Stage("detection", StartMapping(), "detection", "Map the boundaries"),
    Stage(
        "tilts",
        StartTiltPlan(),
        "second",
        "Plan the tilted passes",
        offered="a way of the tilted probe over the whole region, where an upright one may miss "
        "the echo of the inner table",
    ),
    Stage(
        "tilted",
        StartTiltScan(),
        "capture second",
        "Scan with the probe tilted",
        offered="the inner boundary where an upright probe misses it, and fewer wrong echoes",
        seen_first=True,
    ),
    Stage("maps", StartMapping(), "maps", "Map the boundaries", ends_weak=True),
    Stage(
        "caliper",
        StartCaliperMeasurements(),
        "speed",
        "Measure with caliper",
        offered="the speed of sound of this bone in place of the published mean",
    ),
    Stage(
        "burr",
        StartBurrCapture(),
        "burr",
        "Register the burr",
        offered="the place of the burr's tip, so that more beds are safe",
    ),
    Stage("implant", StartBedSearch(), "bed", "Search the bed"),
    Stage(
        "milling",
        PlanMilling(),
        "milling",
        "Plan the milling",
        offered="a certified motion that mills the bed",
    ),
    Stage(
        "rehearsal",
        RehearseMilling(),
        "rehearsal",
        "Rehearse the milling",
        offered="the bone left after a rehearsal on the virtual patient",
    ),
)
Stages = tuple[Stage, ...]
OFFERED = tuple(stage.name for stage in PROCEDURE if stage.offered)


def stages(until: str, *messages: Message, skip: Collection[str] = ()) -> Stages:
    """Return the stages up to one, some of them with other fields of their messages.

    Args:
        until: Name of the last stage.
        messages: Take the place of the messages of their type.
        skip: Names of stages that are left out.

    Raises:
        InvalidInputError: no such stage, or a message of none of them.
    """
    names = [stage.name for stage in PROCEDURE]
    for name in (until, *skip):
        if name not in names:
            raise InvalidInputError(f"there is no stage {name!r}: it is one of {', '.join(names)}")
    chosen = tuple(s for s in PROCEDURE[: names.index(until) + 1] if s.name not in skip)
    for message in messages:
        if not any(type(stage.message) is type(message) for stage in chosen):
            raise InvalidInputError(f"no stage up to {until} sends {type(message).__name__}")
        chosen = tuple(
            replace(stage, message=message) if type(stage.message) is type(message) else stage
            for stage in chosen
        )
    return chosen


TO_MAPS = stages("caliper")  # which the maps are made anew with


def next_stage(
    session: Session, skipped: Collection[str] = (), among: Stages = PROCEDURE
) -> Stage | None:
    """Return the first stage whose part is not usable, else one that is too weak; None: all done.

    An offered stage is passed over where it was skipped, or where another one is to come first.
    """
    for stage in among:
        if stage.judgement(session).holds:
            continue
        if not stage.offered or (stage.name not in skipped and stage.is_due(session)):
            return stage
    return next((stage for stage in among if stage.falls_short(session)), None)


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run of the procedure ended."""

    completed: bool
    failed_step: str | None = None  # name of the stage
    reason: str | None = None
    code: str | None = None  # of the error, else the state of what is not usable
    left_out: Mapping[str, str] = field(default_factory=dict)  # offered stages that failed, and why


def unwatched(step: str, share: float) -> None:
    """Show no progress."""


def run_procedure(
    bench: Workbench,
    among: Stages,
    *,
    progress: StepProgress = unwatched,
) -> Ending:
    """Carry out all stages after set-up, one after the other; stop where one cannot be done.

    An offered stage that fails is left out.

    Raises:
        CancelledError: Stop was pressed.
    """
    left: dict[str, str] = {}
    while (stage := next_stage(bench.session, left, among)) is not None:
        if stage.falls_short(bench.session):
            found = stage.judgement(bench.session)
            return Ending(False, stage.name, _words(found), found.state, left)
        progress(stage.name, 0.0)
        failure = _carry_out(stage, bench, progress)
        if failure is not None and not stage.offered:
            return Ending(False, stage.name, *failure, left)
        progress(stage.name, 1.0)
        if failure is not None:
            left[stage.name] = failure[0]
    return Ending(True, left_out=left)


def _carry_out(stage: Stage, bench: Workbench, progress: StepProgress) -> tuple[str, str] | None:
    """Bring a stage forward; return why what it makes is not usable then and its code, or None.

    What is recorded in several parts is recorded part by part, each of which changes the judgement.
    """
    before, found = None, stage.judgement(bench.session)
    while found != before and not found.holds:
        before = found
        try:
            _send(stage, bench, progress)
        except CancelledError:
            raise
        except RonaError as error:
            return str(error), error.code
        found = stage.judgement(bench.session)
    if found.holds:
        return None
    plan = bench.session.results.roll
    if stage.name == "roll" and plan is not None and (why := why_no_plan(plan.value)) is not None:
        return f"{why}. {_base_move(bench)}", found.state
    return _words(found), found.state


def _words(found: Judgement) -> str:
    """Return why something is not usable or weak, and what is best done next."""
    return found.reason if found.remedy is None else f"{found.reason}. Next: {found.remedy.words}"


def _send(stage: Stage, bench: Workbench, progress: StepProgress) -> None:
    """Send the message that brings a stage forward, if there is one."""
    bad = stage.judgement(bench.session).state == "bad"
    message = None if bad else stage.next_message(bench.session)
    if message is not None and type(message).__name__ in REGISTRY.command_types:
        bench.dispatch(message)
    elif message is not None:
        bench.run(message, lambda share: progress(stage.name, share))


def _base_move(bench: Workbench) -> str:
    """Return which move of the robot's base would help; the search has a bound of its own."""
    try:
        bench.run(StartBasePlacement())
    except CancelledError:
        raise
    except RonaError as error:
        return f"Move the robot base or change the path; where to, is not known: {error}"
    found = bench.session.results.placement
    return "Change the path" if found is None else advice(found.value)
