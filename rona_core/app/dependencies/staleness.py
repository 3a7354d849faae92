"""What each result is computed from, and whether that has changed since."""

from functools import lru_cache
from typing import Any

from rona_core.app.dependencies.capture_setup import SCANS, capture_setup_digest
from rona_core.app.dependencies.inputs import (
    ANY_SECOND,
    ANY_SECOND_DETECTION,
    ANY_SURFACE,
    ANY_TOOL,
    BASE,
    BLOCK,
    BLOCK_PROBE,
    BOUNDARY_EDITS,
    DETECTION,
    EDITS,
    FIRST_EDITS,
    HAND_EDITS,
    HAND_PROBE,
    HAND_REFERENCE,
    MODEL,
    OUTER_EDITS,
    PATH,
    PATH_CAPTURE,
    PATH_REFERENCE,
    POINTER,
    POINTER_CAPTURE,
    PROBE,
    RADIUS,
    REFERENCES,
    REGION,
    ROLL,
    SCAN_CAPTURE,
    SCAN_SPEED,
    SECOND_CAPTURE,
    SKULL,
    SMOOTHING,
    SONO_CALIBRATION,
    SONO_DETECTION,
    SONO_PIVOT,
    SONO_SCAN,
    SONO_SPIN,
    SURFACE,
    SURFACE_CAPTURE,
    SURFACE_REFERENCE,
    TOOL,
    TOOL_CAPTURE,
    Input,
    missing,
)
from rona_core.app.dependencies.obstacles import obstacles_of
from rona_core.app.messages.registry import GenerateScanPattern
from rona_core.errors import StepBlockedError
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.session.codec import digest
from rona_core.session.document import STEPS, PointerCapture, ScanCapture, Session
from rona_core.session.imported import is_imported
from rona_core.ultrasound.acoustic_calibration.delay_line import DelayLine
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration

# by their digest, which is the same whatever processor computed them
OBSTACLES = Input(
    lambda s: session_obstacles(s).digest(),
    "say what stands around the robot (step 1)",
    earlier=lambda s: session_obstacles(s),
)

KNOWN_LINE = Input(lambda s: usable_line(s), "calibrate the delay line (step 1)", optional=True)
KNOWN_SPEED = Input(lambda s: usable_speed(s), "calibrate the speed (step 9)", optional=True)

DRIVEN = {"robot": MODEL, "scan speed": SCAN_SPEED, "obstacles": OBSTACLES}  # what plans rest on
# result -> the names and kinds of its inputs
RESULT_INPUTS: dict[str, dict[str, Input]] = {
    "tool": {"capture": TOOL_CAPTURE, "robot": MODEL},
    "pointer": {"capture": POINTER_CAPTURE},
    "surface": {
        "capture": SURFACE_CAPTURE,
        "tool": TOOL,
        "pointer": POINTER,
        "reference": SURFACE_REFERENCE,
    },
    "registration": {"surface": SURFACE, "skull": SKULL, "region": REGION},
    "path": {
        "capture": PATH_CAPTURE,
        "tool": TOOL,
        "pointer": POINTER,
        "reference": PATH_REFERENCE,
    },
    "smoothing": {"path": PATH, "surface": SURFACE, "edits": EDITS},
    "roll": {"smoothing": SMOOTHING, **DRIVEN},
    "placement": {"smoothing": SMOOTHING, "base": BASE, **DRIVEN},
    "line": {"block": BLOCK, "probe": BLOCK_PROBE},
    "detection": {"capture": SCAN_CAPTURE, "probe": PROBE, "line": KNOWN_LINE},
    "second": {
        "detection": DETECTION,
        "correction by hand": FIRST_EDITS,
        "capture": SCAN_CAPTURE,
        "surface": SURFACE,
        **DRIVEN,
    },
    "second_detection": {
        "capture": SECOND_CAPTURE,
        "detection": DETECTION,
        "correction by hand": OUTER_EDITS,
        "scan": SCAN_CAPTURE,
        "robot": MODEL,
        "probe": PROBE,
        "line": KNOWN_LINE,
    },
    "speed": {
        "references": REFERENCES,
        "detection": DETECTION,
        "capture": SCAN_CAPTURE,
        "robot": MODEL,
    },
    "maps": {
        "detection": DETECTION,
        "second": ANY_SECOND,
        "second_detection": ANY_SECOND_DETECTION,
        "correction by hand": BOUNDARY_EDITS,
        "capture": SCAN_CAPTURE,
        "surface": SURFACE,
        "robot": MODEL,
        "speed": KNOWN_SPEED,
    },
    "sono": {"pivot": SONO_PIVOT, "spin": SONO_SPIN},
    "sono_detection": {
        "capture": SONO_SCAN,
        "calibration": SONO_CALIBRATION,
        "tool": ANY_TOOL,
        "probe": HAND_PROBE,
        "line": KNOWN_LINE,
    },
    "sono_maps": {
        "detection": SONO_DETECTION,
        "correction by hand": HAND_EDITS,
        "calibration": SONO_CALIBRATION,
        "capture": SONO_SCAN,
        "tool": ANY_TOOL,
        "surface": ANY_SURFACE,
        "reference": HAND_REFERENCE,
        "speed": KNOWN_SPEED,
    },
}
PATTERN_INPUTS = {"surface": SURFACE, "region": RADIUS}  # of a path that nobody demonstrated
RESULTS = tuple(RESULT_INPUTS)  # in the order in which they follow from one another


def inputs_of(result: str, message: str) -> dict[str, Input]:
    """Return what a result depends on that a message of this name makes."""
    return PATTERN_INPUTS if message == GenerateScanPattern.__name__ else RESULT_INPUTS[result]


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


def session_obstacles(session: Session) -> Obstacles:
    """Return what the robot is to keep away from, by all results that are not stale."""
    return obstacles_of(session, lambda name: stale_reason(name, session) is None)


def usable_second(session: Session) -> ScanCapture | None:
    """Return the capture of the second pass, unless it is of another plan or set-up."""
    capture = session.captures.second
    return None if capture is None or stale_reason("capture second", session) else capture


def usable_line(session: Session) -> DelayLine | None:
    """Return the calibrated delay line, unless it is stale or bad."""
    held = session.results.line
    if held is None or held.value.verdict == "bad" or stale_reason("line", session):
        return None
    return held.value


def usable_speed(session: Session) -> SpeedCalibration | None:
    """Return the calibrated speed of sound, unless it is stale or bad."""
    held = session.results.speed
    if held is None or held.value.verdict == "bad" or stale_reason("speed", session):
        return None
    return held.value


@lru_cache(maxsize=128)  # a few sessions: they never change, and each result asks those before it
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
        nothing = value in (None, ())
        if key not in derived.inputs:  # made by a version that did not know of it
            if nothing and item.optional:
                continue
            return f"the {name} result was computed without {key}: compute it again"
        lost = nothing and not item.optional
        if lost or not _is_as_held(item, value, derived.inputs.get(key), session):
            return f"{key} has changed since the {name} result was computed"
    return None


def _is_as_held(item: Input, value: Any, held: str | None, session: Session) -> bool:
    """Return whether an input still has the digest that a result remembers of it."""
    if held == digest_of(value):
        return True
    return item.earlier is not None and held == digest_of(item.earlier(session))


def stale_root(inputs: tuple[Input, ...], session: Session) -> Input | None:
    """Return what is to be done again first, for inputs that may be stale; None if none is.

    It is stale itself, not for the sake of something before it, and belongs to the earliest step.
    """
    found = [root for item in inputs for root in _stale_roots(item, session)]
    return min(found, key=lambda root: _place(root.upstream or ""), default=None)


def _stale_roots(item: Input, session: Session) -> list[Input]:
    name = item.upstream
    if name is None or stale_reason(name, session) is None:
        return []
    before: tuple[Input, ...] = ()
    if name in ("capture scan", "capture second"):
        before = (ROLL if name == "capture scan" else SCAN_CAPTURE,)
    elif derived := getattr(session.results, name, None):
        before = tuple(inputs_of(name, derived.message).values())
    roots = [root for one in before for root in _stale_roots(one, session)]
    return roots or [item]


def _place(name: str) -> int:
    """Return where in the procedure a result or capture comes; what is of no step comes last."""
    step = name.removeprefix("capture ")
    return STEPS.index(step) if step in STEPS else len(STEPS)


def _stale_capture(kind: str, session: Session) -> str | None:
    held = getattr(session.captures, kind)
    captures = held if isinstance(held, tuple) else (held,)
    now = capture_setup_digest(kind, session)
    known = (now, capture_setup_digest(kind, session, whole_probe=True))
    if any(_is_of_another(capture, known, session) for capture in captures):
        return f"the set-up or plan has changed since the {kind} capture was taken"
    if kind in SCANS and held is not None:
        return stale_reason(SCANS[kind], session)
    return None


def _is_of_another(capture: Any, known: tuple[str, ...], session: Session) -> bool:
    if isinstance(capture, PointerCapture) and is_imported(capture):
        return capture.pointer != session.setup.devices.pointer  # all that it depends on
    return capture is not None and capture.setup_digest not in known
