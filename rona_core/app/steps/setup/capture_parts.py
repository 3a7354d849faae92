"""Parts of the set-up that captures depend on; each is digested with the captures that name it."""

from collections.abc import Callable
from dataclasses import replace

from rona_core.app.declarations.declarations import Input
from rona_core.app.steps.setup.inputs import HAND_PROBE
from rona_core.devices.settings import TrackerSettings
from rona_core.session.codec import digest
from rona_core.session.document import Session

Part = Callable[[Session], list[object]]
PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


def tracker_part(session: Session) -> list[object]:
    """Return what a recording of the tracker depends on; where it stands is not among it."""
    tracker = session.setup.devices.tracker
    return [tracker.profile, tracker.rate_hz, *_faults(tracker)]


def robot_part(session: Session) -> list[object]:
    """Return which robot it is and where it stands."""
    robot = session.setup.devices.robot
    return [robot.model, robot.base_shift_mm, robot.base_turn_deg]


def robot_errors_part(session: Session) -> list[object]:
    """Return whether the robot errs and how late it reports; nothing of that for older captures."""
    robot = session.setup.devices.robot
    return [robot.errors, *([robot.latency_ms] if robot.latency_ms else [])]


def pointer_part(session: Session) -> list[object]:
    """Return which pointer it is."""
    return [session.setup.devices.pointer]


def specimen_part(session: Session) -> list[object]:
    """Return the specimen and the region on it."""
    return [digest(session.setup.specimen), digest(session.setup.region)]


def bone_and_probe_part(session: Session) -> list[object]:
    """Return the bone and the probe that fires into it."""
    return [digest(session.setup.bone), digest(session.setup.devices.probe)]


def bone_and_hand_probe_part(session: Session) -> list[object]:
    """Return the bone and the probe in the hand, whose pitch counts for nothing."""
    return [digest(session.setup.bone), digest(HAND_PROBE.read(session))]


def contact_part(session: Session) -> list[object]:
    """Return the force control; nothing where the robot is driven by position alone."""
    contact = session.setup.devices.robot.contact
    return [] if contact is None else [digest(contact)]


def input_part(item: Input) -> Part:
    """Return the digest of an input as a part of the set-up; an empty text while it is missing."""

    def part(session: Session) -> list[object]:
        value = item.read(session)
        return ["" if value is None else digest(value)]

    return part


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
