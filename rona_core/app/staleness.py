"""What each result is computed from, and whether that has changed since."""

from dataclasses import replace
from typing import Any

from rona_core.app.inputs import (
    ANY_SECOND,
    ANY_SECOND_DETECTION,
    ANY_SURFACE,
    ANY_TOOL,
    BLOCK,
    BOUNDARY_EDITS,
    DETECTION,
    EDITS,
    FIRST_EDITS,
    HAND_EDITS,
    OUTER_EDITS,
    PATH,
    PATH_CAPTURE,
    POINTER,
    POINTER_CAPTURE,
    PROBE,
    REFERENCE,
    REFERENCES,
    REGION,
    ROBOT,
    SCAN_CAPTURE,
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
    TOOL,
    TOOL_CAPTURE,
    Input,
    missing,
)
from rona_core.app.messages import DrawPattern
from rona_core.devices.settings import ROOM_C, TrackerSettings
from rona_core.errors import StepBlockedError
from rona_core.robot.obstacles import Obstacles
from rona_core.session.codec import digest
from rona_core.session.document import PointerCapture, ScanCapture, Session
from rona_core.session.imported import is_imported
from rona_core.session.surroundings import obstacles_of
from rona_core.ultrasound.delay_line import DelayLine
from rona_core.ultrasound.sound_speed import SpeedCalibration

BY_HAND = ("sono_pivot", "sono_spin", "sono_scan")  # with the probe in the hand
SCANS = {"scan": "roll", "second": "capture scan"}  # capture -> what it rests on
PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


OBSTACLES = Input(lambda s: session_obstacles(s), "say what stands around the robot (step 1)")

KNOWN_LINE = Input(lambda s: usable_line(s), "calibrate the delay line (step 1)", optional=True)
KNOWN_SPEED = Input(lambda s: usable_speed(s), "calibrate the speed (step 9)", optional=True)

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
    "roll": {"smoothing": SMOOTHING, "robot": ROBOT, "obstacles": OBSTACLES},
    "placement": {"smoothing": SMOOTHING, "robot": ROBOT, "obstacles": OBSTACLES},
    "line": {"block": BLOCK, "probe": PROBE},
    "detection": {"capture": SCAN_CAPTURE, "probe": PROBE, "line": KNOWN_LINE},
    "second": {
        "detection": DETECTION,
        "correction by hand": FIRST_EDITS,
        "capture": SCAN_CAPTURE,
        "surface": SURFACE,
        "robot": ROBOT,
        "obstacles": OBSTACLES,
    },
    "second_detection": {
        "capture": SECOND_CAPTURE,
        "detection": DETECTION,
        "correction by hand": OUTER_EDITS,
        "scan": SCAN_CAPTURE,
        "robot": ROBOT,
        "probe": PROBE,
        "line": KNOWN_LINE,
    },
    "speed": {
        "references": REFERENCES,
        "detection": DETECTION,
        "capture": SCAN_CAPTURE,
        "robot": ROBOT,
    },
    "maps": {
        "detection": DETECTION,
        "second": ANY_SECOND,
        "second_detection": ANY_SECOND_DETECTION,
        "correction by hand": BOUNDARY_EDITS,
        "capture": SCAN_CAPTURE,
        "surface": SURFACE,
        "robot": ROBOT,
        "speed": KNOWN_SPEED,
    },
    "sono": {"pivot": SONO_PIVOT, "spin": SONO_SPIN},
    "sono_detection": {
        "capture": SONO_SCAN,
        "calibration": SONO_CALIBRATION,
        "tool": ANY_TOOL,
        "probe": PROBE,
        "line": KNOWN_LINE,
    },
    "sono_maps": {
        "detection": SONO_DETECTION,
        "correction by hand": HAND_EDITS,
        "calibration": SONO_CALIBRATION,
        "capture": SONO_SCAN,
        "tool": ANY_TOOL,
        "surface": ANY_SURFACE,
        "reference": REFERENCE,
        "speed": KNOWN_SPEED,
    },
}
PATTERN_INPUTS = {"surface": SURFACE}  # of a path that nobody demonstrated
RESULTS = tuple(RESULT_INPUTS)  # in the order in which they follow from one another


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


def capture_setup_digest(kind: str, session: Session) -> str:
    """Return a digest of the part of the set-up that a capture of this kind depends on."""
    setup, devices = session.setup, session.setup.devices
    robot = devices.robot
    seen: list[Any] = [setup.seed]
    if kind in ("tool", "pointer", "surface", "path", *BY_HAND):
        seen += [devices.tracker.profile, devices.tracker.rate_hz, *_faults(devices.tracker)]
    if kind in ("tool", "surface", "path", "references", "sono_scan", *SCANS):
        seen += [robot.model, robot.base_shift_mm, robot.base_turn_deg]
    if kind in ("tool", *SCANS):
        seen += [robot.errors]
        seen += [robot.latency_ms] if robot.latency_ms else []  # nothing for older captures
    if kind in ("pointer", "surface", "path"):
        seen += [devices.pointer]
    if kind in ("surface", "path", "references", "sono_scan", *SCANS):
        seen += [digest(setup.specimen), digest(setup.region)]
    if kind == "block":  # whatever the line is used at later: its temperature was measured
        seen += [digest(replace(devices.probe, line_temperature_c=ROOM_C, pitch_mm=1.0))]
    if kind == "sono_scan":
        seen += [digest(setup.bone), digest(devices.probe)]
    if kind in SCANS:
        plan = None if session.results.roll is None else session.results.roll.value
        # the second pass looks into gaps of the first: it counts as long as that one does
        before = plan if kind == "scan" else session.captures.scan
        seen += [digest(setup.bone), digest(devices.probe)]
        seen += ["" if before is None else digest(before)]
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
        nothing = value in (None, ())
        if key not in derived.inputs:  # made by a version that did not know of it
            if nothing and item.optional:
                continue
            return f"the {name} result was computed without {key}: compute it again"
        lost = nothing and not item.optional
        if lost or digest_of(value) != derived.inputs.get(key):
            return f"{key} has changed since the {name} result was computed"
    return None


def _stale_capture(kind: str, session: Session) -> str | None:
    held = getattr(session.captures, kind)
    captures = held if isinstance(held, tuple) else (held,)
    now = capture_setup_digest(kind, session)
    if any(_is_of_another(capture, now, session) for capture in captures):
        return f"the set-up or plan has changed since the {kind} capture was taken"
    if kind in SCANS and held is not None:
        return stale_reason(SCANS[kind], session)
    return None


def _is_of_another(capture: Any, now: str, session: Session) -> bool:
    if isinstance(capture, PointerCapture) and is_imported(capture):
        return capture.pointer != session.setup.devices.pointer  # all that it depends on
    return capture is not None and capture.setup_digest != now
