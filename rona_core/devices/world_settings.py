"""World settings: how far patient and devices are from what a laboratory is told of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.settings import STRICT, require_within

WorldProfile = Literal["nominal", "realistic", "hard"]

# what each quantity may be set to; ``docs/world.md`` explains each
WORLD_LIMITS: Mapping[str, tuple[float, float]] = {
    "bone_loss": (0.5, 2.0),
    "bone_speed": (0.85, 1.15),
    "outer_texture_mm": (0.0, 0.3),
    "gel_speed_mm_per_us": (1.4, 1.7),
    "film_mm": (0.0, 0.5),
    "line_excess_k": (-15.0, 25.0),
    "line_drift_k": (-10.0, 10.0),
    "line_strain_share": (-0.5, 0.5),
    "pulse_loss": (0.0, 0.3),
    "mounting_mm": (0.0, 2.0),
    "mounting_deg": (0.0, 5.0),
    "spindle_mm": (0.0, 2.0),
    "friction": (0.0, 0.5),
    "robot_mm": (0.0, 2.0),
    "tracker_share": (0.0, 2.0),
    "head_drift_mm": (0.0, 2.0),
    "breathing_mm": (0.0, 0.5),
}


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Which world the virtual patient and devices are drawn from.

    ``nominal``: all is as it is told. ``realistic`` and ``hard``: each quantity is drawn from the
    seed, as published spreads have it or at their far end. A quantity that is not None is as it is
    set. Nothing of this is known to what plans, calibrates or detects.
    """

    __pydantic_config__: ClassVar = STRICT

    profile: WorldProfile = "realistic"
    bone_loss: float | None = None  # attenuation of bone over its published mean
    bone_speed: float | None = None  # of sound in the bone of all patients, over the nominal one
    outer_texture_mm: float | None = None  # RMS of the small unevenness of the outer table
    gel_speed_mm_per_us: float | None = None
    film_mm: float | None = None  # of gel that remains under the pressed face
    line_excess_k: float | None = None  # line's temperature over the one that is told
    line_drift_k: float | None = None  # by which it then warms in the course of a capture
    line_strain_share: float | None = None  # relative change of its speed per strain
    pulse_loss: float | None = None  # share of its centre frequency that an old probe has lost
    mounting_mm: float | None = None  # how far the robot's probe sits off its place
    mounting_deg: float | None = None  # and is turned
    spindle_mm: float | None = None  # how far the spindle's tip sits off its place
    friction: float | None = None  # coefficient between face and bone
    robot_mm: float | None = None  # 3D RMS of the robot's systematic error
    tracker_share: float | None = None  # error of the tracker over what its maker states
    head_drift_mm: float | None = None  # by which the head creeps in its clamp
    breathing_mm: float | None = None  # amplitude with which it moves to and fro

    def __post_init__(self) -> None:
        for name, (low, high) in WORLD_LIMITS.items():
            value = getattr(self, name)
            if value is not None:
                require_within(name, value, low, high)


NOMINAL_WORLD = WorldSettings("nominal")
REALISTIC_WORLD = WorldSettings("realistic")
