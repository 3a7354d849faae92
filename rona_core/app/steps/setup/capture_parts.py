"""Parts of the set-up that results take and captures depend on."""

from collections.abc import Callable
from dataclasses import fields, replace

from rona_core.app.declarations.declarations import SetupPart
from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.setup import messages
from rona_core.devices.limits import BEFORE
from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.settings import ROOM_C, ProbeSettings, TrackerSettings
from rona_core.devices.world_settings import WorldSettings
from rona_core.session.codec import digest
from rona_core.session.document import Session

SKULL = Input(lambda s: s.setup.specimen, "load a skull (step 1)", title="the skull (step 1)")
REGION = Input(lambda s: s.setup.region, "choose a region (step 1)", title="the region (step 1)")
RADIUS = Input(
    lambda s: s.setup.region.radius_mm,
    "choose a region (step 1)",
    title="the radius of the region (step 1)",
)
# Of the robot's settings a computation uses its geometry, a plan also the speed. Whether it errs
# and where its base stands count in captures.
MODEL = Input(
    lambda s: s.setup.devices.robot.model, "choose a robot (step 1)", title="the robot (step 1)"
)
SCAN_SPEED = Input(
    lambda s: s.setup.devices.robot.scan_speed_mm_per_s,
    "choose a speed (step 1)",
    title="the scan speed (step 1)",
)
BASE = Input(
    lambda s: s.setup.devices.robot,
    "choose where the base stands (step 1)",
    counts=lambda s: (s.setup.devices.robot.base_shift_mm, s.setup.devices.robot.base_turn_deg),
    title="the place of the robot's base (step 1)",
)
# by their digest, which is the same whatever processor computed them
OBSTACLES = Input(
    session_obstacles,
    "say what stands around the robot (step 1)",
    counts=lambda s: session_obstacles(s).digest(),
    title="what stands around the robot",
)
ROBOT_ERRORS = Input(
    lambda s: s.setup.devices.robot.errors,
    "choose a robot (step 1)",
    title="the choice whether the robot errs (step 1)",
)
TRACKER_PROFILE = Input(
    lambda s: s.setup.devices.tracker.profile,
    "choose a tracker (step 1)",
    title="the tracker (step 1)",
)


def reference_input(read: Callable[[Session], bool]) -> Input[bool]:
    """Return whether the tracker may be found again for captures, as an input."""
    return Input(read, "choose the reference (step 1)", title="the use of the base marker (step 1)")


PROBE = Input(
    lambda s: s.setup.devices.probe, "choose a probe (step 1)", title="the probe (step 1)"
)
HAND_PROBE = Input(  # in the hand it fires by the clock, not by the way
    lambda s: replace(s.setup.devices.probe, pitch_mm=1.0),
    "choose a probe (step 1)",
    title="the probe (step 1)",
)


def _block_probe(session: Session) -> ProbeSettings:
    """Return the probe as the block knows it: used elsewhere its line may be warmer."""
    probe = session.setup.devices.probe
    return replace(probe, line_temperature_c=ROOM_C, pitch_mm=1.0)


def _look_probes(session: Session) -> tuple[ProbeSettings, ...]:
    """Return the chosen probe and each other of the catalogue with the same receiver.

    In the order of the catalogue, so that another choice leaves them as they are.
    """
    held = replace(session.setup.devices.probe, pitch_mm=1.0)
    return tuple(held.of_probe(name) for name in PROBE_DATA)


LOOK_PROBES = Input(_look_probes, "choose a probe (step 1)", title="the probe (step 1)")
BLOCK_PROBE = Input(_block_probe, "choose a probe (step 1)", title="the probe (step 1)")


WORLD = messages.SetWorld.__name__


def _changed_by(*kinds: type | str) -> Callable[[Callable[[Session], list[object]]], SetupPart]:
    """Declare a part by what it reads, which decides; the messages are named in the reason."""
    names = tuple(kind if isinstance(kind, str) else kind.__name__ for kind in kinds)
    return lambda read: SetupPart(read, names)


# quantities of the world that an echo depends on: off a steel block, and of bone
LINE = ("gel_speed_mm_per_us", "film_mm", "line_excess_k", "line_drift_k", "pulse_loss")
BONE = ("bone_loss", "bone_speed", "line_strain_share")
RELIEF = ("inner_relief_mm", "step_relief_mm", "relief_length_mm")
PLAIN = TrackerSettings(stereo=False, occlusion=False)  # the tracker of sessions of schema 1


@_changed_by(messages.SetTracker, WORLD)
def tracker(session: Session) -> list[object]:
    """Return what a recording of the tracker depends on; where it stands is not among it."""
    settings = session.setup.devices.tracker
    share = world("tracker_share")(session)
    return [settings.profile, settings.rate_hz, *_faults(settings), *share]


@_changed_by(messages.SetRobot, "ApplyBasePlacement")
def robot(session: Session) -> list[object]:
    """Return which robot it is and where it stands."""
    settings = session.setup.devices.robot
    return [settings.model, settings.base_shift_mm, settings.base_turn_deg]


@_changed_by(messages.SetRobot, WORLD)
def robot_errors(session: Session) -> list[object]:
    """Return whether the robot errs and how late it reports; nothing of that for older captures."""
    settings = session.setup.devices.robot
    late = [settings.latency_ms] if settings.latency_ms else []
    return [settings.errors, *late, *world("robot_mm")(session)]


@_changed_by(messages.SetPointer)
def pointer(session: Session) -> list[object]:
    """Return which pointer it is."""
    return [session.setup.devices.pointer]


@_changed_by(messages.UseSimulatedSkull, messages.StoreSkull, messages.SetRegion, WORLD)
def specimen(session: Session) -> list[object]:
    """Return the specimen and the region on it."""
    chosen = [digest(session.setup.specimen), digest(session.setup.region)]
    return [*chosen, *world("outer_texture_mm")(session), *world(*RELIEF)(session)]


@_changed_by(messages.SetBoneModel, messages.SetProbe, WORLD)
def bone_and_probe(session: Session) -> list[object]:
    """Return the bone and the probe that fires into it."""
    chosen = [digest(session.setup.bone), digest(session.setup.devices.probe)]
    return [*chosen, *world(*LINE, *BONE)(session)]


@_changed_by(messages.SetBoneModel, messages.SetProbe, WORLD)
def bone_and_hand_probe(session: Session) -> list[object]:
    """Return the bone and the probe in the hand, whose pitch counts for nothing."""
    chosen = [digest(session.setup.bone), digest(HAND_PROBE.read(session))]
    return [*chosen, *world(*LINE, *BONE)(session)]


@_changed_by(messages.SetBoneModel, messages.SetProbe, WORLD)
def bone_and_looks(session: Session) -> list[object]:
    """Return the bone and all probes that a quick look is taken with."""
    chosen = [digest(session.setup.bone), digest(LOOK_PROBES.read(session))]
    return [*chosen, *world(*LINE, *BONE)(session)]


@_changed_by(messages.SetContact)
def contact(session: Session) -> list[object]:
    """Return the force control; nothing where the robot is driven by position alone."""
    settings = session.setup.devices.robot.contact
    return [] if settings is None else [digest(settings)]


def world(*names: str) -> SetupPart:
    """Return what is set of these quantities of the world; nothing where all are drawn.

    Of those that were added later, nothing where they are as in sessions before that.
    """
    before = {part.name: part.metadata.get(BEFORE) for part in fields(WorldSettings)}

    @_changed_by(WORLD)
    def part(session: Session) -> list[object]:
        values = [getattr(session.setup.world, name) for name in names]
        return [] if values == [before[name] for name in names] else [digest(values)]

    return part


HEAD = world("head_drift_mm", "breathing_mm")
CLAMPED_PROBE = world("mounting_mm", "mounting_deg", "friction")
BLOCK = world(*LINE)
SPINDLE = world("spindle_mm")


def of_input(item: Input[object], *changed_by: str) -> SetupPart:
    """Return the digest of an input as a part of the set-up; an empty text while it is missing.

    Args:
        item: A part of the set-up, a result or a capture.
        changed_by: Names of the messages, results and captures that may change it.
    """

    @_changed_by(*changed_by)
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
