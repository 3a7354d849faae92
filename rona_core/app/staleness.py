"""Whether what a capture or a result rests on has changed since."""

from dataclasses import replace
from typing import Any

from rona_core.app.inputs import digest_of, inputs_of
from rona_core.devices.settings import TrackerSettings
from rona_core.session.codec import digest
from rona_core.session.document import PointerCapture, ScanCapture, Session
from rona_core.session.imported import is_imported

SCANS = {"scan": "roll", "second": "capture scan"}  # capture -> what it rests on
PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


def usable_second(session: Session) -> ScanCapture | None:
    """Return the capture of the second pass, unless it is of another plan or set-up."""
    capture = session.captures.second
    return None if capture is None or stale_reason("capture second", session) else capture


def capture_setup_digest(kind: str, session: Session) -> str:
    """Return a digest of the part of the set-up that a capture of this kind depends on."""
    setup, devices = session.setup, session.setup.devices
    robot = devices.robot
    seen: list[Any] = [setup.seed]
    if kind in ("tool", "pointer", "surface", "path"):
        seen += [devices.tracker.profile, devices.tracker.rate_hz, *_faults(devices.tracker)]
    if kind in ("tool", "surface", "path", *SCANS):
        seen += [robot.model, robot.base_shift_mm, robot.base_turn_deg]
    if kind in ("tool", *SCANS):
        seen += [robot.errors]
    if kind in ("pointer", "surface", "path"):
        seen += [devices.pointer]
    if kind in ("surface", "path", *SCANS):
        seen += [digest(setup.specimen), digest(setup.region)]
    if kind in SCANS:
        plan = None if session.results.roll is None else session.results.roll.value
        # the second pass looks into gaps of the first: it counts as long as that one does
        before = plan if kind == "scan" else session.captures.scan
        seen += [digest(setup.bone), digest(devices.probe)]
        seen += ["" if before is None else digest(before)]
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
        lost = value in (None, ()) and not item.optional
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
