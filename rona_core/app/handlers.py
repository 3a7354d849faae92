"""What each other message does to a session: pure functions from a session to the next."""

from dataclasses import replace
from typing import Any

from rona_core.app.dependencies.inputs import need
from rona_core.app.dependencies.requirements import require_inputs
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.derive import SHORT
from rona_core.app.messages.outcomes import (
    StoreBasePlacement,
    StoreMaps,
    StorePathCapture,
    StorePointerCapture,
    StoreRegistration,
    StoreRobotPlan,
    StoreScanCapture,
    StoreSecondCapture,
    StoreSecondPlan,
    StoreSonoMaps,
    StoreSonoPivot,
    StoreSonoScan,
    StoreSonoSpin,
    StoreSurfaceCapture,
    StoreToolCapture,
)
from rona_core.app.messages.registry import (
    ApplyBasePlacement,
    BuildPath,
    BuildSurface,
    CalibrateHandheldProbe,
    CalibratePointer,
    ChooseRoll,
    ClearSurface,
    ExcludePoses,
    GenerateScanPattern,
    RegisterTool,
    SetRobot,
    SmoothScanPath,
)
from rona_core.app.messages.serialization import message_from, plain_arguments
from rona_core.app.steps.maps.derivation import derive_chosen_roll
from rona_core.app.steps.path.handlers import edited
from rona_core.app.steps.path.messages import PathChange
from rona_core.app.steps.roll.base_placement import require_move
from rona_core.app.steps.setup.handlers import handle, robot_choice
from rona_core.errors import StaleResultError, StepBlockedError
from rona_core.path.manual_edits import PathEdits
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.document import Capture, Derived, Session
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits

# ------------------------------------------------------------------ captures: always kept


def captured(session: Session, capture: Capture, **parts: Any) -> Session:
    """Return the session with a capture in its place, and in the archive.

    One that was stopped early takes no place of a whole one that is not stale: the archive alone
    has it then, and all that rests on the whole one stays as it was.
    """
    archive = (*session.archive, capture)
    if capture.partial and all(_stands(name, session) for name in parts):
        return replace(session, archive=archive)
    return replace(session, captures=replace(session.captures, **parts), archive=archive)


def _stands(name: str, session: Session) -> bool:
    """Return whether there is a whole capture of this name that is not stale."""
    held = getattr(session.captures, name)
    captures = held if isinstance(held, tuple) else (held,)
    whole = all(capture is not None and not capture.partial for capture in captures)
    return bool(captures) and whole and stale_reason(f"capture {name}", session) is None


def _without_edits(before: Session, after: Session, edits: BoundaryEdits) -> Session:
    """Return ``after`` with what is left of the edits, where it has another capture."""
    return after if after.captures is before.captures else replace(after, boundary_edits=edits)


@handle.register
def _(message: StoreToolCapture, session: Session) -> Session:
    return captured(session, message.capture, tool=message.capture)


@handle.register
def _(message: StorePointerCapture, session: Session) -> Session:
    return captured(session, message.capture, pointer=message.capture)


@handle.register
def _(message: StoreSurfaceCapture, session: Session) -> Session:
    earlier = session.captures.surface if message.append else ()
    return captured(session, message.capture, surface=(*earlier, message.capture))


@handle.register
def _(message: StorePathCapture, session: Session) -> Session:
    return captured(session, message.capture, path=message.capture)


@handle.register
def _(message: StoreScanCapture, session: Session) -> Session:
    after = captured(session, message.capture, scan=message.capture)
    return _without_edits(session, after, session.boundary_edits.of("hand"))  # not of these


@handle.register
def _(message: StoreSonoPivot, session: Session) -> Session:
    return captured(session, message.capture, sono_pivot=message.capture)


@handle.register
def _(message: StoreSonoSpin, session: Session) -> Session:
    return captured(session, message.capture, sono_spin=message.capture)


@handle.register
def _(message: StoreSonoScan, session: Session) -> Session:
    after = captured(session, message.capture, sono_scan=message.capture)
    return _without_edits(session, after, session.boundary_edits.without("hand"))


@handle.register
def _(message: ClearSurface, session: Session) -> Session:
    return replace(session, captures=replace(session.captures, surface=()))


# ------------------------------------------------------------------ results


@handle.register(RegisterTool)
@handle.register(CalibratePointer)
@handle.register(BuildSurface)
@handle.register(SmoothScanPath)
@handle.register(CalibrateHandheldProbe)
def _(message: Any, session: Session) -> Session:
    return computed(message, session)


@handle.register(BuildPath)
@handle.register(GenerateScanPattern)
def _(message: Any, session: Session) -> Session:
    return replace(computed(message, session), path_edits=PathEdits())  # those of another path


@handle.register(PathChange)
def _(message: Any, session: Session) -> Session:
    require_inputs(type(message), session)
    changed = replace(session, path_edits=edited(message, session))
    smooth = session.results.smoothing
    if smooth is None or stale_reason("smoothing", session) is not None:
        return changed
    return computed(message_from(smooth.message, smooth.arguments), changed)


def computed(message: Any, session: Session) -> Session:
    """Return the session with the result that a command asks for.

    Raises:
        StepBlockedError: an input is missing.
    """
    require_inputs(type(message), session)
    name, derive = SHORT[type(message)]
    inputs = input_digests(name, session, type(message).__name__)
    value = derive(session, message)
    made = Derived(value, type(message).__name__, plain_arguments(message), inputs)
    return replace(session, results=replace(session.results, **{name: made}))


@handle.register
def _(message: ExcludePoses, session: Session) -> Session:
    derived = getattr(session.results, message.step)
    kind = {"tool": RegisterTool, "pointer": CalibratePointer}[message.step]
    if derived is None:
        raise StepBlockedError(f"ExcludePoses is blocked: first calibrate (step {message.step})")
    rows = tuple(sorted(message.indices))
    return handle(kind(method=derived.arguments["method"], exclude=rows), session)


@handle.register
def _(message: StoreRegistration, session: Session) -> Session:
    _require_unchanged("registration", message.inputs, session)
    made = Derived(
        message.registration, "StartSkullRegistration", message.arguments, message.inputs
    )
    return replace(session, results=replace(session.results, registration=made))


@handle.register
def _(message: StoreRobotPlan, session: Session) -> Session:
    _require_unchanged("roll", message.inputs, session)
    made = Derived(message.plan, "StartRollSearch", message.arguments, message.inputs)
    return replace(session, results=replace(session.results, roll=made))


@handle.register
def _(message: StoreBasePlacement, session: Session) -> Session:
    _require_unchanged("placement", message.inputs, session)
    made = Derived(message.placement, "StartBasePlacement", message.arguments, message.inputs)
    return replace(session, results=replace(session.results, placement=made))


@handle.register
def _(message: ApplyBasePlacement, session: Session) -> Session:
    require_inputs(type(message), session)
    reason = stale_reason("placement", session)
    if reason is not None:
        raise StaleResultError(f"{reason}: look for a place of the base again (step 7)")
    robot = require_move(session, message.place)
    return handle(SetRobot(**robot_choice(robot)), session)


@handle.register
def _(message: ChooseRoll, session: Session) -> Session:
    require_inputs(type(message), session)
    searched: Derived[RobotPlan] = need(session.results.roll, "plan the motion (step 7)")
    plan = derive_chosen_roll(session, searched.value, message.index, message.branch)
    arguments = {**searched.arguments, "chosen": message.index, "branch": message.branch}
    made = Derived(plan, searched.message, arguments, searched.inputs)
    return replace(session, results=replace(session.results, roll=made))


@handle.register
def _(message: StoreMaps, session: Session) -> Session:
    names = ("detection", "second_detection", "maps")
    return _with_mapped(session, message, "StartMapping", names)


@handle.register
def _(message: StoreSonoMaps, session: Session) -> Session:
    names = ("sono_detection", "sono_maps")
    return _with_mapped(session, message, "StartHandheldMapping", names)


def _with_mapped(
    session: Session, message: StoreMaps | StoreSonoMaps, made_by: str, names: tuple[str, ...]
) -> Session:
    for name in names:  # each may depend on those before
        value = getattr(message, name)
        made = None
        if value is not None:
            _require_unchanged(name, message.inputs[name], session)
            made = Derived(value, made_by, message.arguments, message.inputs[name])
        session = replace(session, results=replace(session.results, **{name: made}))
    return session


@handle.register
def _(message: StoreSecondPlan, session: Session) -> Session:
    _require_unchanged("second", message.inputs, session)
    made = Derived(message.second, "StartGapPlan", message.arguments, message.inputs)
    return replace(session, results=replace(session.results, second=made))


@handle.register
def _(message: StoreSecondCapture, session: Session) -> Session:
    after = captured(session, message.capture, second=message.capture)
    return _without_edits(session, after, session.boundary_edits.without("second"))


def _require_unchanged(name: str, inputs: dict[str, str], session: Session) -> None:
    now = input_digests(name, session)
    changed = sorted(key for key in now if now[key] != inputs.get(key))
    if changed:
        raise StaleResultError(
            f"the {name} result is not stored: {', '.join(changed)} changed while it was computed; "
            "start it again"
        )
