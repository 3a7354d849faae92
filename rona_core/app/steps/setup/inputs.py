"""Inputs that results take from the set-up: each only what the computation uses of it."""

from dataclasses import replace

from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.devices.settings import ROOM_C, ProbeSettings
from rona_core.session.document import Session

SKULL = Input(lambda s: s.setup.specimen, "load a skull (step 1)")
REGION = Input(lambda s: s.setup.region, "choose a region (step 1)")
RADIUS = Input(lambda s: s.setup.region.radius_mm, "choose a region (step 1)")
# Of the robot's settings a computation uses its geometry, a plan also the speed. Whether it errs
# and where its base stands count in captures.
MODEL = Input(lambda s: s.setup.devices.robot.model, "choose a robot (step 1)")
SCAN_SPEED = Input(lambda s: s.setup.devices.robot.scan_speed_mm_per_s, "choose a speed (step 1)")
BASE = Input(
    lambda s: s.setup.devices.robot,
    "choose where the base stands (step 1)",
    counts=lambda s: (s.setup.devices.robot.base_shift_mm, s.setup.devices.robot.base_turn_deg),
)
# by their digest, which is the same whatever processor computed them
OBSTACLES = Input(
    session_obstacles,
    "say what stands around the robot (step 1)",
    counts=lambda s: session_obstacles(s).digest(),
)
ROBOT_ERRORS = Input(lambda s: s.setup.devices.robot.errors, "choose a robot (step 1)")
TRACKER_PROFILE = Input(lambda s: s.setup.devices.tracker.profile, "choose a tracker (step 1)")
CHOOSE_REFERENCE = "choose the reference (step 1)"
PROBE = Input(lambda s: s.setup.devices.probe, "choose a probe (step 1)")
HAND_PROBE = Input(  # in the hand it fires by the clock, not by the way
    lambda s: replace(s.setup.devices.probe, pitch_mm=1.0), "choose a probe (step 1)"
)


def _block_probe(session: Session) -> ProbeSettings:
    """Return the probe as the block knows it: used elsewhere its line may be warmer."""
    probe = session.setup.devices.probe
    return replace(probe, line_temperature_c=ROOM_C, pitch_mm=1.0)


BLOCK_PROBE = Input(_block_probe, "choose a probe (step 1)")
