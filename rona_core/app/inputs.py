"""What can be an input of a result, and what must be there before a message makes sense."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from rona_core.app.messages import (
    ApplyBasePlacement,
    BuildPath,
    BuildSurface,
    CalibrateDelayLine,
    CalibratePointer,
    CalibrateSono,
    CalibrateSoundSpeed,
    DeletePathPoint,
    DrawPattern,
    InsertPathPoint,
    KeepPathSample,
    MovePathPoint,
    RegisterTool,
    SmoothScanPath,
    StartBasePlacement,
    StartMapping,
    StartPathCapture,
    StartPointerCapture,
    StartRecordingImport,
    StartReferencePoints,
    StartRollSearch,
    StartScan,
    StartSecondPlan,
    StartSecondScan,
    StartSkullRegistration,
    StartSonoCalibration,
    StartSonoMapping,
    StartSonoScan,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session
from rona_core.session.reference import placed_reason
from rona_core.session.specimen import LoadedSkull


@dataclass(frozen=True, slots=True)
class Input:
    """One thing a result is computed from."""

    read: Callable[[Session], Any]  # None or () while it is missing
    wanted: str  # what to do to get it, for the message
    upstream: str | None = None  # the result or capture that may itself be stale
    optional: bool = False  # the result can do without it


def _value(name: str) -> Callable[[Session], Any]:
    def read(session: Session) -> Any:
        derived = getattr(session.results, name)
        return None if derived is None else derived.value

    return read


def _arm(session: Session) -> dict[str, Any]:
    """Return what a registration or a plan depends on: not how the probe is pressed on."""
    robot = session.setup.devices.robot
    scan_only = ("contact", "latency_ms")
    names = [f.name for f in fields(robot) if f.name not in scan_only]
    # it reads like the settings did before they knew of contact, so that older results stay valid
    return {"$type": type(robot).__name__, **{name: getattr(robot, name) for name in names}}


TOOL_CAPTURE = Input(lambda s: s.captures.tool, "record the tool motion (step 2)", "capture tool")
POINTER_CAPTURE = Input(
    lambda s: s.captures.pointer, "record the pivoting of the pointer (step 3)", "capture pointer"
)
SURFACE_CAPTURE = Input(
    lambda s: s.captures.surface, "slide the pointer over the skull (step 4)", "capture surface"
)
PATH_CAPTURE = Input(
    lambda s: s.captures.path, "demonstrate the scan path (step 5)", "capture path"
)
SECOND_CAPTURE = Input(
    lambda s: s.captures.second, "scan the gaps again (step 9)", "capture second"
)
SCAN_CAPTURE = Input(lambda s: s.captures.scan, "scan (step 8)", "capture scan")
TOOL = Input(_value("tool"), "register the tool (step 2)", "tool")
POINTER = Input(_value("pointer"), "calibrate the pointer (step 3)", "pointer")
SURFACE = Input(_value("surface"), "sample the surface (step 4)", "surface")
PATH = Input(_value("path"), "demonstrate the path (step 5)", "path")
SMOOTHING = Input(_value("smoothing"), "smooth the path (step 6)", "smoothing")
ROLL = Input(_value("roll"), "search the roll (step 7)", "roll")
PLACEMENT = Input(_value("placement"), "look for a place of the base (step 7)", "placement")
SONO_PIVOT = Input(
    lambda s: s.captures.sono_pivot, "pivot the SonoPointer (step 9)", "capture sono_pivot"
)
SONO_SPIN = Input(
    lambda s: s.captures.sono_spin, "turn the SonoPointer about its axis", "capture sono_spin"
)
SONO_SCAN = Input(lambda s: s.captures.sono_scan, "scan by hand (step 9)", "capture sono_scan")
SONO_CALIBRATION = Input(_value("sono"), "calibrate the SonoPointer (step 9)", "sono")
SONO_DETECTION = Input(_value("sono_detection"), "map the scan by hand", "sono_detection")
ANY_TOOL = Input(_value("tool"), "register the tool (step 2)", "tool", optional=True)
ANY_SURFACE = Input(_value("surface"), "sample the surface (step 4)", "surface", optional=True)
SKULL = Input(lambda s: s.setup.specimen, "load a skull (step 1)")
REGION = Input(lambda s: s.setup.region, "choose a region (step 1)")
DETECTION = Input(_value("detection"), "detect the boundaries (step 9)", "detection")
SECOND = Input(_value("second"), "plan the second pass (step 9)", "second")
ANY_SECOND = Input(lambda s: s.captures.second, "scan the gaps again (step 9)", optional=True)
ANY_SECOND_DETECTION = Input(_value("second_detection"), "detect the boundaries", optional=True)
MAPS = Input(_value("maps"), "compute the maps (step 9)", "maps")
ROBOT = Input(_arm, "choose a robot (step 1)")
REFERENCE = Input(lambda s: s.setup.use_base_marker, "choose the reference (step 1)")
EDITS = Input(lambda s: s.path_edits, "smooth the path (step 6)")
BOUNDARY_EDITS = Input(lambda s: s.boundary_edits.without("hand"), "scan (step 8)")
HAND_EDITS = Input(lambda s: s.boundary_edits.of("hand"), "scan by hand (step 9)")
FIRST_EDITS = Input(lambda s: s.boundary_edits.of("first"), "scan (step 8)")
OUTER_EDITS = Input(lambda s: s.boundary_edits.of("first", "outer"), "scan (step 8)")
REFERENCES = Input(
    lambda s: s.captures.references, "measure reference points (step 9)", "capture references"
)
BLOCK = Input(lambda s: s.captures.block, "take A-scans on the block (step 1)", "capture block")
PROBE = Input(lambda s: s.setup.devices.probe, "choose a probe (step 1)")

# message -> what must be there before it makes sense
NEEDS: dict[type, tuple[Input, ...]] = {
    StartToolCapture: (),
    RegisterTool: (TOOL_CAPTURE,),
    StartPointerCapture: (),
    CalibratePointer: (POINTER_CAPTURE,),
    StartSurfaceCapture: (TOOL, POINTER),
    BuildSurface: (SURFACE_CAPTURE, TOOL, POINTER),
    StartSkullRegistration: (SURFACE,),
    StartPathCapture: (TOOL, POINTER),
    BuildPath: (PATH_CAPTURE, TOOL, POINTER),
    DrawPattern: (SURFACE,),
    SmoothScanPath: (PATH, SURFACE),
    MovePathPoint: (SMOOTHING, SURFACE),
    InsertPathPoint: (SMOOTHING, SURFACE),
    DeletePathPoint: (SMOOTHING,),
    KeepPathSample: (PATH, SURFACE),
    StartRollSearch: (SMOOTHING,),
    StartBasePlacement: (SMOOTHING,),
    ApplyBasePlacement: (PLACEMENT,),
    StartScan: (ROLL,),
    StartMapping: (SCAN_CAPTURE, SURFACE),
    StartReferencePoints: (SCAN_CAPTURE, DETECTION),
    CalibrateSoundSpeed: (REFERENCES, DETECTION),
    CalibrateDelayLine: (BLOCK,),
    StartSecondPlan: (SCAN_CAPTURE, SURFACE, MAPS),
    StartSecondScan: (SECOND,),
    StartSonoCalibration: (),
    CalibrateSono: (SONO_PIVOT, SONO_SPIN),
    StartSonoScan: (SONO_CALIBRATION,),
    StartSonoMapping: (SONO_SCAN, SONO_CALIBRATION),
}


def missing(inputs: tuple[Input, ...], session: Session) -> str | None:
    """Return what to do first, or None if nothing is missing."""
    for item in inputs:
        if not item.optional and item.read(session) in (None, ()):
            return item.wanted
    return None


def require_inputs(message_type: type, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what the message needs."""
    wanted = missing(NEEDS.get(message_type, ()), session)
    if wanted is not None:
        raise StepBlockedError(f"{message_type.__name__} is blocked: first {wanted}")
    if message_type in (StartSurfaceCapture, StartPathCapture):
        reason = placed_reason(session)
        if reason is not None:
            raise StepBlockedError(f"{message_type.__name__} is blocked: {reason}")


def require_loaded(session: Session) -> LoadedSkull:
    """Return the loaded skull of a session.

    Raises:
        StepBlockedError: a simulated skull lies on the table.
    """
    skull = session.setup.specimen
    if not isinstance(skull, LoadedSkull):
        raise StepBlockedError(
            "the registration of the skull needs a loaded CT, mask or mesh: a simulated skull has "
            "no file to register to; load one in step 1"
        )
    return skull


def require_for(activity: Any, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what an activity needs."""
    kind = type(activity)
    if isinstance(activity, StartSkullRegistration):
        require_loaded(session)
    if isinstance(activity, StartRecordingImport):  # needs what the capture it stands for needs
        kind = {
            "pivot": StartPointerCapture,
            "surface": StartSurfaceCapture,
            "path": StartPathCapture,
        }[activity.purpose]
    require_inputs(kind, session)


def is_pattern(session: Session) -> bool:
    """Return whether the path is a pattern drawn by rule, not a demonstration."""
    path = session.results.path
    return path is not None and path.message == DrawPattern.__name__
