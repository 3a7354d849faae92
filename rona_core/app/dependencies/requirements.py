"""What must be there, and fresh, before a message makes sense; why it is blocked otherwise."""

from typing import Any

from rona_core.app.dependencies.base_reference import placed_reason
from rona_core.app.dependencies.inputs import (
    BLOCK,
    DETECTION,
    MAPS,
    PATH,
    PATH_CAPTURE,
    PLACEMENT,
    POINTER,
    POINTER_CAPTURE,
    REFERENCES,
    ROLL,
    SCAN_CAPTURE,
    SECOND,
    SMOOTHING,
    SONO_CALIBRATION,
    SONO_PIVOT,
    SONO_SCAN,
    SONO_SPIN,
    SURFACE,
    SURFACE_CAPTURE,
    TOOL,
    TOOL_CAPTURE,
    Input,
    missing,
    require_loaded,
)
from rona_core.app.dependencies.staleness import stale_reason, stale_root
from rona_core.app.messages.registry import (
    COMMANDS,
    ApplyBasePlacement,
    BuildPath,
    BuildSurface,
    CalibrateDelayLine,
    CalibrateHandheldProbe,
    CalibratePointer,
    CalibrateSoundSpeed,
    ChooseRoll,
    DeletePathPoint,
    GenerateScanPattern,
    InsertPathPoint,
    MovePathPoint,
    PinPathSample,
    RegisterTool,
    SmoothScanPath,
    StartBasePlacement,
    StartCaliperMeasurements,
    StartGapPlan,
    StartGapScan,
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
    StartMapping,
    StartPathCapture,
    StartPointerCapture,
    StartRecordingImport,
    StartRollSearch,
    StartScan,
    StartSkullRegistration,
    StartSurfaceCapture,
    StartToolCapture,
)
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session

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
    GenerateScanPattern: (SURFACE,),
    SmoothScanPath: (PATH, SURFACE),
    MovePathPoint: (SMOOTHING, SURFACE),
    InsertPathPoint: (SMOOTHING, SURFACE),
    DeletePathPoint: (SMOOTHING,),
    PinPathSample: (PATH, SURFACE),
    StartRollSearch: (SMOOTHING,),
    StartBasePlacement: (SMOOTHING,),
    ApplyBasePlacement: (PLACEMENT,),
    ChooseRoll: (ROLL,),
    StartScan: (ROLL,),
    StartMapping: (SCAN_CAPTURE, SURFACE),
    StartCaliperMeasurements: (SCAN_CAPTURE, DETECTION),
    CalibrateSoundSpeed: (REFERENCES, DETECTION),
    CalibrateDelayLine: (BLOCK,),
    StartGapPlan: (SCAN_CAPTURE, SURFACE, MAPS),
    StartGapScan: (SECOND,),
    StartHandheldCalibration: (),
    CalibrateHandheldProbe: (SONO_PIVOT, SONO_SPIN),
    StartHandheldScan: (SONO_CALIBRATION,),
    StartHandheldMapping: (SONO_SCAN, SONO_CALIBRATION),
}
# These look themselves at what is stale, or change what is to be computed anew anyway.
OF_STALE = (
    MovePathPoint,
    InsertPathPoint,
    DeletePathPoint,
    PinPathSample,
    ApplyBasePlacement,
)


def blocked_reason(message_type: type, session: Session) -> str | None:
    """Return what is to be done before a message of this type makes sense; None: nothing."""
    inputs = NEEDS.get(message_type, ())
    wanted = missing(inputs, session)
    if wanted is not None:
        return f"first {wanted}"
    if message_type in (StartSurfaceCapture, StartPathCapture):
        reason = placed_reason(session)
        if reason is not None:
            return reason
    if message_type not in OF_STALE:
        # to compute anew from a capture that is stale changes nothing: the result is stale, too
        again = message_type.__name__ in COMMANDS
        behind = tuple(i for i in inputs if not (again and _is_capture(i)))
        if (reason := _stale_before(behind, session)) is not None:
            return reason
    return plan_reason(session) if message_type is StartScan else None


def _is_capture(item: Input) -> bool:
    return item.upstream is not None and item.upstream.startswith("capture ")


def _stale_before(inputs: tuple[Input, ...], session: Session) -> str | None:
    """Return which stale input is to be made again first, and why; None where all are fresh."""
    if session.results.roll is None:  # a file too old to hold the plan: its scan can be mapped
        inputs = tuple(item for item in inputs if item is not SCAN_CAPTURE)
    root = stale_root(inputs, session)
    if root is None or root.upstream is None:
        return None
    return f"first {root.wanted} again: {stale_reason(root.upstream, session)}"


def plan_reason(session: Session) -> str | None:
    """Return why the planned motion cannot be driven; None where it can, or there is none."""
    searched = session.results.roll
    if searched is None:
        return None
    if searched.value.mode == "none":
        return "first find a roll that the robot can traverse (step 7)"
    certificate = searched.value.certificate
    if certificate is not None and not certificate.certified:
        return "the verifier refuses the motion (step 7): choose another roll"
    return None


def require_inputs(message_type: type, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what the message needs, or has it stale."""
    reason = blocked_reason(message_type, session)
    if reason is not None:
        raise StepBlockedError(f"{message_type.__name__} is blocked: {reason}")


def require_for(activity: Any, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what an activity needs, or has it stale."""
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
