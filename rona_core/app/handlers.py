"""What each message does to a session: pure functions from a session to the next."""

from dataclasses import fields, replace
from functools import singledispatch
from typing import Any

from rona_core.app.derive import SHORT
from rona_core.app.derive_scan import derive_chosen_roll
from rona_core.app.inputs import input_digests, require_inputs, stale_reason
from rona_core.app.messages import (
    BuildPath,
    BuildSurface,
    CalibratePointer,
    ChooseRoll,
    ClearSurface,
    DrawPattern,
    ExcludePoses,
    MoveTracker,
    RegisterTool,
    RenameSession,
    SetPointer,
    SetProbe,
    SetReference,
    SetRegion,
    SetRobot,
    SetSeed,
    SetToolVisible,
    SetTracker,
    SmoothScanPath,
    UseSimulatedSkull,
)
from rona_core.app.outcomes import (
    StoreMaps,
    StorePathCapture,
    StorePointerCapture,
    StoreRegistration,
    StoreRobotPlan,
    StoreScanCapture,
    StoreSkull,
    StoreSurfaceCapture,
    StoreToolCapture,
)
from rona_core.app.path_commands import PathChange
from rona_core.app.path_edits import edited
from rona_core.app.plain import message_from, plain_arguments
from rona_core.devices.settings import (
    DeviceSettings,
    ProbeSettings,
    TrackerPlace,
)
from rona_core.errors import InvalidInputError, StaleResultError, StepBlockedError
from rona_core.path.edits import PathEdits
from rona_core.robot.model import robot_model
from rona_core.session.document import Capture, Derived, RegionChoice, Session
from rona_core.session.specimen import SimulatedSkull


@singledispatch
def handle(message: Any, session: Session) -> Session:
    """Return the session after ``message``; the one that came in stays as it was.

    Raises:
        RonaError: the message does not fit the session.
    """
    raise InvalidInputError(f"there is no handler for {type(message).__name__}")


# ------------------------------------------------------------------ set-up


@handle.register
def _(message: RenameSession, session: Session) -> Session:
    return replace(session, name=message.name.strip())


@handle.register
def _(message: SetSeed, session: Session) -> Session:
    return replace(session, setup=replace(session.setup, seed=message.seed))


@handle.register
def _(message: UseSimulatedSkull, session: Session) -> Session:
    skull, region = SimulatedSkull(side=message.side), RegionChoice()
    return replace(session, setup=replace(session.setup, specimen=skull, region=region))


@handle.register
def _(message: SetRegion, session: Session) -> Session:
    region = RegionChoice(message.center_mesh_mm, message.radius_mm)
    return replace(session, setup=replace(session.setup, region=region))


def _with_devices(session: Session, devices: DeviceSettings) -> Session:
    return replace(session, setup=replace(session.setup, devices=devices))


@handle.register
def _(message: SetTracker, session: Session) -> Session:
    devices = session.setup.devices
    chosen = {part.name: getattr(message, part.name) for part in fields(message)}
    tracker = replace(devices.tracker, **chosen)
    return _with_devices(session, replace(devices, tracker=tracker))


@handle.register
def _(message: MoveTracker, session: Session) -> Session:
    devices = session.setup.devices
    place = TrackerPlace(message.shift_mm, message.turn_deg)
    return _with_devices(session, replace(devices, tracker=replace(devices.tracker, place=place)))


@handle.register
def _(message: SetReference, session: Session) -> Session:
    setup = replace(session.setup, use_base_marker=message.use_base_marker)
    return replace(session, setup=setup)


@handle.register
def _(message: SetToolVisible, session: Session) -> Session:
    devices = session.setup.devices
    hidden = set(devices.tracker.hidden_tools) - {message.tool}
    if not message.visible:
        hidden.add(message.tool)
    tracker = replace(devices.tracker, hidden_tools=tuple(sorted(hidden)))
    return _with_devices(session, replace(devices, tracker=tracker))


@handle.register
def _(message: SetRobot, session: Session) -> Session:
    robot_model(message.model)  # refuses an unknown name
    settings = replace(
        session.setup.devices.robot,
        model=message.model,
        errors=message.errors,
        scan_speed_mm_per_s=message.scan_speed_mm_per_s,
        base_shift_mm=message.base_shift_mm,
        base_turn_deg=message.base_turn_deg,
    )
    return _with_devices(session, replace(session.setup.devices, robot=settings))


@handle.register
def _(message: SetProbe, session: Session) -> Session:
    settings = ProbeSettings(
        name=message.name,
        excitation=message.excitation,
        front_snr_db=message.front_snr_db,
        pitch_mm=message.pitch_mm,
    )
    return _with_devices(session, replace(session.setup.devices, probe=settings))


@handle.register
def _(message: SetPointer, session: Session) -> Session:
    return _with_devices(session, replace(session.setup.devices, pointer=message.kind))


@handle.register
def _(message: StoreSkull, session: Session) -> Session:
    region = RegionChoice(None, message.skull.radius_mm)
    return replace(session, setup=replace(session.setup, specimen=message.skull, region=region))


# ------------------------------------------------------------------ captures: always kept


def _captured(session: Session, capture: Capture, **parts: Any) -> Session:
    captures = replace(session.captures, **parts)
    return replace(session, captures=captures, archive=(*session.archive, capture))


@handle.register
def _(message: StoreToolCapture, session: Session) -> Session:
    return _captured(session, message.capture, tool=message.capture)


@handle.register
def _(message: StorePointerCapture, session: Session) -> Session:
    return _captured(session, message.capture, pointer=message.capture)


@handle.register
def _(message: StoreSurfaceCapture, session: Session) -> Session:
    earlier = session.captures.surface if message.append else ()
    return _captured(session, message.capture, surface=(*earlier, message.capture))


@handle.register
def _(message: StorePathCapture, session: Session) -> Session:
    return _captured(session, message.capture, path=message.capture)


@handle.register
def _(message: StoreScanCapture, session: Session) -> Session:
    return _captured(session, message.capture, scan=message.capture)


@handle.register
def _(message: ClearSurface, session: Session) -> Session:
    return replace(session, captures=replace(session.captures, surface=()))


# ------------------------------------------------------------------ results


@handle.register(RegisterTool)
@handle.register(CalibratePointer)
@handle.register(BuildSurface)
@handle.register(SmoothScanPath)
def _(message: Any, session: Session) -> Session:
    return computed(message, session)


@handle.register(BuildPath)
@handle.register(DrawPattern)
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
def _(message: ChooseRoll, session: Session) -> Session:
    searched = session.results.roll
    if searched is None:
        raise StepBlockedError("ChooseRoll is blocked: first search the roll (step 7)")
    plan = derive_chosen_roll(session, searched.value, message.index)
    arguments = {**searched.arguments, "chosen": message.index}
    made = Derived(plan, searched.message, arguments, searched.inputs)
    return replace(session, results=replace(session.results, roll=made))


@handle.register
def _(message: StoreMaps, session: Session) -> Session:
    _require_unchanged("detection", message.detection_inputs, session)
    made = Derived(message.detection, "StartMapping", message.arguments, message.detection_inputs)
    session = replace(session, results=replace(session.results, detection=made))
    _require_unchanged("maps", message.maps_inputs, session)
    maps = Derived(message.maps, "StartMapping", message.arguments, message.maps_inputs)
    return replace(session, results=replace(session.results, maps=maps))


def _require_unchanged(name: str, inputs: dict[str, str], session: Session) -> None:
    now = input_digests(name, session)
    changed = sorted(key for key in now if now[key] != inputs.get(key))
    if changed:
        raise StaleResultError(
            f"the {name} result is not stored: {', '.join(changed)} changed while it was computed; "
            "start it again"
        )
