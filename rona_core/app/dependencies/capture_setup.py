"""Which part of the set-up each kind of capture depends on, as a digest that is kept with it."""

from dataclasses import replace
from typing import Any

from rona_core.app.dependencies.inputs import BLOCK_PROBE, HAND_PROBE
from rona_core.devices.settings import TrackerSettings
from rona_core.session.codec import digest
from rona_core.session.document import Session

BY_HAND = ("sono_pivot", "sono_spin", "sono_scan")  # with the probe in the hand
SCANS = {"scan": "roll", "second": "capture scan"}  # capture -> what it rests on
PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


def capture_setup_digest(kind: str, session: Session, *, whole_probe: bool = False) -> str:
    """Return a digest of the part of the set-up that a capture of this kind depends on.

    With ``whole_probe`` it is that of older files, where a scan by hand depended on the pitch too.
    """
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
        seen += [digest(BLOCK_PROBE.read(session))]
    if kind == "sono_scan":
        probe = devices.probe if whole_probe else HAND_PROBE.read(session)
        seen += [digest(setup.bone), digest(probe)]
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
