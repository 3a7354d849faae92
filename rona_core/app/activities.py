"""What takes time or touches a device: each activity ends in messages for the session."""

from dataclasses import dataclass, fields, replace
from functools import singledispatch
from typing import Any

from rona_core.app import captures
from rona_core.app.dependencies.requirements import require_for, require_inputs
from rona_core.app.dependencies.staleness import input_digests
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
    StoreSkull,
    StoreSonoMaps,
    StoreSonoPivot,
    StoreSonoScan,
    StoreSonoSpin,
    StoreSurfaceCapture,
    StoreToolCapture,
)
from rona_core.app.messages.registry import (
    BuildPath,
    BuildSurface,
    CalibrateHandheldProbe,
    CalibratePointer,
    RegisterTool,
    StartBasePlacement,
    StartGapPlan,
    StartGapScan,
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
    StartMapping,
    StartPathCapture,
    StartPivotImport,
    StartPointerCapture,
    StartRecordingImport,
    StartReplay,
    StartRetract,
    StartRobotMove,
    StartRollSearch,
    StartScan,
    StartSkullImport,
    StartSkullRegistration,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.app.messages.serialization import plain_arguments
from rona_core.app.runtime.recompute import replay_report
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements, StartDelayLineCapture
from rona_core.app.steps.handheld.capture import capture_sono_calibration, capture_sono_scan
from rona_core.app.steps.handheld.derivation import derive_sono_mapping
from rona_core.app.steps.maps.derivation import derive_mapping, derive_roll, derive_second, lean
from rona_core.app.steps.pointer import import_recordings as imports
from rona_core.app.steps.roll.base_placement import derive_placement
from rona_core.app.steps.scan.capture import capture_scan
from rona_core.app.steps.surface.skull_registration import derive_registration
from rona_core.app.toolbox import Toolbox
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.session.document import Derived, Session

Messages = tuple[Any, ...]  # dispatched in this order when the activity ends


@dataclass(frozen=True, slots=True)
class Answer:
    """Instead of a message: what an activity found, for who asked; the session does not hold it."""

    value: Any


# Activities that move or read a device, or make a capture: one at a time. The others only compute.
DEVICE_ACTIVITIES = (
    StartToolCapture,
    StartPointerCapture,
    StartSurfaceCapture,
    StartPathCapture,
    StartRecordingImport,
    StartPivotImport,
    StartScan,
    StartGapScan,
    StartHandheldCalibration,
    StartHandheldScan,
    StartRobotMove,
    StartRetract,
    StartCaliperMeasurements,
    StartDelayLineCapture,
)

# those that record something, which has to fit into the session file
CAPTURE_ACTIVITIES = tuple(
    kind for kind in DEVICE_ACTIVITIES if kind not in (StartRobotMove, StartRetract)
)
# those that drive the robot, by name; the others use tracker, probe or hand alone
ROBOT_ACTIVITIES = frozenset(
    kind.__name__
    for kind in (StartToolCapture, StartScan, StartGapScan, StartRobotMove, StartRetract)
)


@singledispatch
def perform(activity: Any, session: Session, tools: Toolbox) -> Messages:
    """Carry out ``activity`` on a snapshot of the session and return what to store.

    Raises:
        RonaError: it is blocked, a device failed, or a computation was cancelled.
    """
    raise InvalidInputError(f"there is no activity {type(activity).__name__}")


@perform.register
def _(activity: StartSkullImport, session: Session, tools: Toolbox) -> Messages:
    names = [activity.file] + ([activity.inner_file] if activity.inner_file else [])
    for name in names:
        if not (tools.uploads / name).is_file():
            raise NotFoundError(f"there is no uploaded file {name!r}: upload it first")
    skull = tools.run(
        tools.import_skull,
        str(tools.uploads / activity.file),
        str(tools.uploads / activity.inner_file) if activity.inner_file else None,
        activity.threshold,
        activity.center_mesh_mm,
        activity.radius_mm,
    )
    return (StoreSkull(skull),)


@perform.register
def _(activity: StartToolCapture, session: Session, tools: Toolbox) -> Messages:
    capture = captures.capture_tool(activity, session, tools)
    return (StoreToolCapture(capture), *(() if capture.partial else (RegisterTool(),)))


@perform.register
def _(activity: StartPointerCapture, session: Session, tools: Toolbox) -> Messages:
    capture = captures.capture_pivot(activity, session, tools)
    return (StorePointerCapture(capture), *(() if capture.partial else (CalibratePointer(),)))


@perform.register
def _(activity: StartSurfaceCapture, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    capture = captures.capture_surface(activity, session, tools)
    stored = StoreSurfaceCapture(capture, activity.append)
    return (stored, *(() if capture.partial else (BuildSurface(),)))


@perform.register
def _(activity: StartSkullRegistration, session: Session, tools: Toolbox) -> Messages:
    require_for(activity, session)
    inputs = input_digests("registration", session)
    found = tools.run(derive_registration, lean(session), activity)
    return (StoreRegistration(found, plain_arguments(activity), inputs),)


@perform.register
def _(activity: StartPathCapture, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    capture = captures.capture_path(activity, session, tools)
    return (StorePathCapture(capture), *(() if capture.partial else (BuildPath(),)))


@perform.register
def _(activity: StartRecordingImport, session: Session, tools: Toolbox) -> Messages:
    require_for(activity, session)
    capture = imports.import_recording(activity, session, tools)
    stored, follows = {
        "pivot": (StorePointerCapture(capture), CalibratePointer()),
        "surface": (StoreSurfaceCapture(capture, activity.append), BuildSurface()),
        "path": (StorePathCapture(capture), BuildPath()),
    }[activity.purpose]
    return (stored,) if capture.partial else (stored, follows)


@perform.register
def _(activity: StartPivotImport, session: Session, tools: Toolbox) -> Messages:
    capture = imports.import_pivot(activity, session, tools)
    return (StorePointerCapture(capture), CalibratePointer())


@perform.register
def _(activity: StartRollSearch, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    inputs = input_digests("roll", session)
    plan = tools.run(derive_roll, lean(session), activity)
    return (StoreRobotPlan(plan, plain_arguments(activity), inputs),)


@perform.register
def _(activity: StartBasePlacement, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    inputs = input_digests("placement", session)
    placement = tools.run(derive_placement, lean(session), activity)
    return (StoreBasePlacement(placement, plain_arguments(activity), inputs),)


@perform.register
def _(activity: StartScan, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    return (StoreScanCapture(capture_scan(session, tools)),)


@perform.register
def _(activity: StartMapping, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    mapped = tools.run(derive_mapping, lean(session), activity)
    values, arguments, inputs = _digested(mapped, activity, session)
    return (StoreMaps(**values, arguments=arguments, inputs=inputs),)


def _digested(
    mapped: Any, activity: Any, session: Session
) -> tuple[dict[str, Any], dict[str, object], dict[str, dict[str, str]]]:
    """Return several results by name, what was asked for, and the digests of each one's inputs."""
    arguments = plain_arguments(activity)
    inputs: dict[str, dict[str, str]] = {}
    values = {f.name: getattr(mapped, f.name) for f in fields(mapped)}
    for name, value in values.items():  # each may depend on those before
        made = None
        if value is not None:
            inputs[name] = input_digests(name, session)
            made = Derived(value, type(activity).__name__, arguments, inputs[name])
        session = replace(session, results=replace(session.results, **{name: made}))
    return values, arguments, inputs


@perform.register
def _(activity: StartGapPlan, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    inputs = input_digests("second", session)
    second = tools.run(derive_second, lean(session), activity)
    return (StoreSecondPlan(second, plain_arguments(activity), inputs),)


@perform.register
def _(activity: StartGapScan, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    return (StoreSecondCapture(capture_scan(session, tools, "second")),)


@perform.register
def _(activity: StartHandheldCalibration, session: Session, tools: Toolbox) -> Messages:
    pivot, spin = capture_sono_calibration(activity, session, tools)
    if spin is None:
        return (StoreSonoPivot(pivot),)
    if spin.partial:  # the two count together
        return (StoreSonoPivot(replace(pivot, partial=True)), StoreSonoSpin(spin))
    return (StoreSonoPivot(pivot), StoreSonoSpin(spin), CalibrateHandheldProbe())


@perform.register
def _(activity: StartHandheldScan, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    return (StoreSonoScan(capture_sono_scan(activity, session, tools)),)


@perform.register
def _(activity: StartHandheldMapping, session: Session, tools: Toolbox) -> Messages:
    require_inputs(type(activity), session)
    mapped = tools.run(derive_sono_mapping, lean(session), activity)
    values, arguments, inputs = _digested(mapped, activity, session)
    return (StoreSonoMaps(**values, arguments=arguments, inputs=inputs),)


@perform.register
def _(activity: StartReplay, session: Session, tools: Toolbox) -> Messages:
    return (Answer(tools.run(replay_report, session)),)


@perform.register
def _(activity: StartRetract, session: Session, tools: Toolbox) -> Messages:
    captures.draw_probe_back(session, tools)
    return ()


@perform.register
def _(activity: StartRobotMove, session: Session, tools: Toolbox) -> Messages:
    captures.move_robot(activity, session, tools)
    return ()
