"""Parts of the set-up that captures depend on; each is digested with the captures that name it."""

from collections.abc import Callable
from dataclasses import replace

from rona_core.app.declarations.inputs import Input
from rona_core.app.steps.setup.inputs import HAND_PROBE
from rona_core.devices.settings import TrackerSettings
from rona_core.session.codec import digest
from rona_core.session.document import Session

Part = Callable[[Session], list[object]]
# quantities of the world that an echo depends on: off a steel block, and of bone
LINE = ("gel_speed_mm_per_us", "film_mm", "line_excess_k", "line_drift_k", "pulse_loss")
BONE = ("bone_loss", "bone_speed", "line_strain_share")
PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


def tracker(session: Session) -> list[object]:
    """Return what a recording of the tracker depends on; where it stands is not among it."""
    settings = session.setup.devices.tracker
    share = world("tracker_share")(session)
    return [settings.profile, settings.rate_hz, *_faults(settings), *share]


def robot(session: Session) -> list[object]:
    """Return which robot it is and where it stands."""
    settings = session.setup.devices.robot
    return [settings.model, settings.base_shift_mm, settings.base_turn_deg]


def robot_errors(session: Session) -> list[object]:
    """Return whether the robot errs and how late it reports; nothing of that for older captures."""
    settings = session.setup.devices.robot
    late = [settings.latency_ms] if settings.latency_ms else []
    return [settings.errors, *late, *world("robot_mm")(session)]


def pointer(session: Session) -> list[object]:
    """Return which pointer it is."""
    return [session.setup.devices.pointer]


def specimen(session: Session) -> list[object]:
    """Return the specimen and the region on it."""
    chosen = [digest(session.setup.specimen), digest(session.setup.region)]
    return [*chosen, *world("outer_texture_mm")(session)]


def bone_and_probe(session: Session) -> list[object]:
    """Return the bone and the probe that fires into it."""
    chosen = [digest(session.setup.bone), digest(session.setup.devices.probe)]
    return [*chosen, *world(*LINE, *BONE)(session)]


def bone_and_hand_probe(session: Session) -> list[object]:
    """Return the bone and the probe in the hand, whose pitch counts for nothing."""
    chosen = [digest(session.setup.bone), digest(HAND_PROBE.read(session))]
    return [*chosen, *world(*LINE, *BONE)(session)]


def contact(session: Session) -> list[object]:
    """Return the force control; nothing where the robot is driven by position alone."""
    settings = session.setup.devices.robot.contact
    return [] if settings is None else [digest(settings)]


def world(*names: str) -> Part:
    """Return what is set of these quantities of the world; nothing where all are drawn."""

    def part(session: Session) -> list[object]:
        values = [getattr(session.setup.world, name) for name in names]
        return [] if values == [None] * len(names) else [digest(values)]

    return part


HEAD = world("head_drift_mm", "breathing_mm")
CLAMPED_PROBE = world("mounting_mm", "mounting_deg", "friction")
BLOCK = world(*LINE)
SPINDLE = world("spindle_mm")


def of_input(item: Input[object]) -> Part:
    """Return the digest of an input as a part of the set-up; an empty text while it is missing."""

    def part(session: Session) -> list[object]:
        value = item.read(session)
        return ["" if value is None else digest(value)]

    return part


def _faults(settings: TrackerSettings) -> list[str]:
    """Return a digest of what else a capture depends on; nothing for captures of schema 1.

    Where the tracker stands is not among it: a stroke stays valid where it was taken.
    """
    rest = replace(
        settings,
        profile=PLAIN.profile,
        rate_hz=PLAIN.rate_hz,
        hidden_tools=(),
        place=PLAIN.place,
    )
    return [] if rest == PLAIN else [digest(rest)]
