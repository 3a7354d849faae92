"""World settings: how far patient and devices are from their stated values."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.limits import number, require_limits
from rona_core.devices.settings import STRICT

WorldProfile = Literal["nominal", "realistic", "hard"]


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Which world the virtual patient and devices are drawn from.

    ``nominal``: all is as stated. ``realistic`` and ``hard``: each quantity is drawn from the
    seed, as published spreads have it or at their far end. A quantity that is not None is as it is
    set. Nothing of this is known to what plans, calibrates or detects. ``docs/world.md`` explains
    each.
    """

    __pydantic_config__: ClassVar = STRICT

    profile: WorldProfile = "realistic"
    # attenuation of bone over its published mean
    bone_loss: float | None = number(None, "Bone attenuation", "", 0.5, 2.0, 0.05)
    # of sound in the bone of all patients, over the nominal one
    bone_speed: float | None = number(None, "Bone speed of sound", "", 0.85, 1.15, 0.01)
    # RMS of the small unevenness of the outer table
    outer_texture_mm: float | None = number(None, "Outer texture", "mm", 0.0, 0.3, 0.01)
    gel_speed_mm_per_us: float | None = number(None, "Gel speed of sound", "mm/µs", 1.4, 1.7, 0.01)
    # of gel that remains under the pressed face
    film_mm: float | None = number(None, "Gel film", "mm", 0.0, 0.5, 0.01)
    # line's temperature over the stated one
    line_excess_k: float | None = number(None, "Line excess temperature", "K", -15.0, 25.0, 1.0)
    # by which it then warms in the course of a capture
    line_drift_k: float | None = number(None, "Line temperature drift", "K", -10.0, 10.0, 1.0)
    # relative change of its speed per strain
    line_strain_share: float | None = number(None, "Speed change per strain", "", -0.5, 0.5, 0.05)
    # share of its centre frequency that an old probe has lost
    pulse_loss: float | None = number(None, "Centre frequency loss", "", 0.0, 0.3, 0.01)
    # how far the robot's probe sits off its place
    mounting_mm: float | None = number(None, "Probe mounting offset", "mm", 0.0, 2.0, 0.1)
    # and is turned
    mounting_deg: float | None = number(None, "Probe mounting tilt", "deg", 0.0, 5.0, 0.1)
    # how far the spindle's tip sits off its place
    spindle_mm: float | None = number(None, "Spindle offset", "mm", 0.0, 2.0, 0.1)
    # coefficient between face and bone
    friction: float | None = number(None, "Friction coefficient", "", 0.0, 0.5, 0.05)
    # 3D RMS of the robot's systematic error
    robot_mm: float | None = number(None, "Robot error", "mm", 0.0, 2.0, 0.1)
    # error of the tracker over what its maker states
    tracker_share: float | None = number(None, "Tracker error factor", "", 0.0, 2.0, 0.1)
    # by which the head creeps in its clamp
    head_drift_mm: float | None = number(None, "Head drift", "mm", 0.0, 2.0, 0.1)
    # amplitude with which it moves to and fro
    breathing_mm: float | None = number(None, "Breathing amplitude", "mm", 0.0, 0.5, 0.05)

    def __post_init__(self) -> None:
        require_limits(self)


NOMINAL_WORLD = WorldSettings("nominal")
REALISTIC_WORLD = WorldSettings("realistic")
