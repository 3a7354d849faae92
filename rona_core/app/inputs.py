"""What each capture and each result depends on, and whether that has changed since."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

from rona_core.app.messages import (
    BuildPath,
    BuildSurface,
    CalibratePointer,
    DeletePathPoint,
    DrawPattern,
    InsertPathPoint,
    KeepPathSample,
    MovePathPoint,
    RegisterTool,
    SmoothScanPath,
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
from rona_core.devices.settings import TrackerSettings
from rona_core.errors import StepBlockedError
from rona_core.session.codec import digest
from rona_core.session.document import PointerCapture, Session
from rona_core.session.imported import is_imported
from rona_core.session.reference import placed_reason
from rona_core.session.specimen import LoadedSkull

PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


@dataclass(frozen=True, slots=True)
class Input:
    """One thing a result is computed from."""

    read: Callable[[Session], Any]  # None or () while it is missing
    wanted: str  # what to do to get it, for the message
    upstream: str | None = None  # the result or capture that may itself be stale


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
SCAN_CAPTURE = Input(lambda s: s.captures.scan, "scan (step 8)", "capture scan")
TOOL = Input(_value("tool"), "register the tool (step 2)", "tool")
POINTER = Input(_value("pointer"), "calibrate the pointer (step 3)", "pointer")
SURFACE = Input(_value("surface"), "sample the surface (step 4)", "surface")
PATH = Input(_value("path"), "demonstrate the path (step 5)", "path")
SMOOTHING = Input(_value("smoothing"), "smooth the path (step 6)", "smoothing")
ROLL = Input(_value("roll"), "search the roll (step 7)", "roll")
SKULL = Input(lambda s: s.setup.specimen, "load a skull (step 1)")
REGION = Input(lambda s: s.setup.region, "choose a region (step 1)")
DETECTION = Input(_value("detection"), "detect the boundaries (step 9)", "detection")
ROBOT = Input(_arm, "choose a robot (step 1)")
REFERENCE = Input(lambda s: s.setup.use_base_marker, "choose the reference (step 1)")
EDITS = Input(lambda s: s.path_edits, "smooth the path (step 6)")
PROBE = Input(lambda s: s.setup.devices.probe, "choose a probe (step 1)")

# result -> the names and kinds of its inputs
RESULT_INPUTS: dict[str, dict[str, Input]] = {
    "tool": {"capture": TOOL_CAPTURE, "robot": ROBOT},
    "pointer": {"capture": POINTER_CAPTURE},
    "surface": {
        "capture": SURFACE_CAPTURE,
        "tool": TOOL,
        "pointer": POINTER,
        "reference": REFERENCE,
    },
    "registration": {"surface": SURFACE, "skull": SKULL, "region": REGION},
    "path": {
        "capture": PATH_CAPTURE,
        "tool": TOOL,
        "pointer": POINTER,
        "reference": REFERENCE,
    },
    "smoothing": {"path": PATH, "surface": SURFACE, "edits": EDITS},
    "roll": {"smoothing": SMOOTHING, "robot": ROBOT},
    "detection": {"capture": SCAN_CAPTURE, "probe": PROBE},
    "maps": {
        "detection": DETECTION,
        "capture": SCAN_CAPTURE,
        "surface": SURFACE,
        "robot": ROBOT,
    },
}
PATTERN_INPUTS = {"surface": SURFACE}  # of a path that nobody demonstrated
RESULTS = tuple(RESULT_INPUTS)  # in the order in which they follow from one another

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
    StartScan: (ROLL,),
    StartMapping: (SCAN_CAPTURE, SURFACE),
}


def missing(inputs: tuple[Input, ...], session: Session) -> str | None:
    """Return what to do first, or None if nothing is missing."""
    for item in inputs:
        if item.read(session) in (None, ()):
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


def inputs_of(result: str, message: str) -> dict[str, Input]:
    """Return what a result depends on that a message of this name makes."""
    return PATTERN_INPUTS if message == DrawPattern.__name__ else RESULT_INPUTS[result]


def input_digests(result: str, session: Session, message: str = "") -> dict[str, str]:
    """Return the digest of every input of a result as the session holds them now.

    Args:
        result: Its name.
        session: Holds the inputs.
        message: Name of the message that makes it, where it can be made of different things.

    Raises:
        StepBlockedError: an input is missing.
    """
    inputs = inputs_of(result, message)
    wanted = missing(tuple(inputs.values()), session)
    if wanted is not None:
        raise StepBlockedError(f"{result} cannot be computed: first {wanted}")
    return {name: digest_of(item.read(session)) for name, item in inputs.items()}


def digest_of(value: Any) -> str:
    """Return the digest of a value, or of each value in a tuple of them."""
    if isinstance(value, tuple):
        return digest([digest(item) for item in value])
    return digest(value)


def capture_setup_digest(kind: str, session: Session) -> str:
    """Return a digest of the part of the set-up that a capture of this kind depends on."""
    setup, devices = session.setup, session.setup.devices
    robot = devices.robot
    seen: list[Any] = [setup.seed]
    if kind in ("tool", "pointer", "surface", "path"):
        seen += [devices.tracker.profile, devices.tracker.rate_hz, *_faults(devices.tracker)]
    if kind in ("tool", "surface", "path", "scan"):
        seen += [robot.model, robot.base_shift_mm, robot.base_turn_deg]
    if kind in ("tool", "scan"):
        seen += [robot.errors]
        seen += [robot.latency_ms] if robot.latency_ms else []  # nothing for older captures
    if kind in ("pointer", "surface", "path"):
        seen += [devices.pointer]
    if kind in ("surface", "path", "scan"):
        seen += [digest(setup.specimen), digest(setup.region)]
    if kind == "scan":
        plan = session.results.roll
        seen += [digest(devices.probe), "" if plan is None else digest(plan.value)]
        seen += [] if robot.contact is None else [digest(robot.contact)]
    return digest(seen)


def _faults(tracker: TrackerSettings) -> list[str]:
    """Return a digest of what else a capture depends on; nothing for captures of schema 1.

    Where the tracker stands is not among it: a stroke stays valid where it was taken.
    """
    rest = replace(
        tracker,
        profile=PLAIN.profile,
        rate_hz=PLAIN.rate_hz,
        hidden_tools=(),
        place=PLAIN.place,
    )
    return [] if rest == PLAIN else [digest(rest)]


def stale_reason(name: str, session: Session) -> str | None:
    """Return why a result (``"roll"``) or capture (``"capture scan"``) is stale, or None."""
    if name.startswith("capture "):
        return _stale_capture(name.removeprefix("capture "), session)
    derived = getattr(session.results, name)
    if derived is None:
        return None
    for key, item in inputs_of(name, derived.message).items():
        if item.upstream is not None and (reason := stale_reason(item.upstream, session)):
            return reason
        value = item.read(session)
        if value in (None, ()) or digest_of(value) != derived.inputs.get(key):
            return f"{key} has changed since the {name} result was computed"
    return None


def _stale_capture(kind: str, session: Session) -> str | None:
    held = getattr(session.captures, kind)
    captures = held if isinstance(held, tuple) else (held,)
    now = capture_setup_digest(kind, session)
    if any(_is_of_another(capture, now, session) for capture in captures):
        return f"the set-up or plan has changed since the {kind} capture was taken"
    if kind == "scan" and held is not None:
        return stale_reason("roll", session)
    return None


def _is_of_another(capture: Any, now: str, session: Session) -> bool:
    if isinstance(capture, PointerCapture) and is_imported(capture):
        return capture.pointer != session.setup.devices.pointer  # all that it depends on
    return capture is not None and capture.setup_digest != now
