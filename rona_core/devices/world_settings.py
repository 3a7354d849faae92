"""World settings: how far patient and devices are from their stated values."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from rona_core.devices.limits import choice, number, require_limits
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

    profile: WorldProfile = choice(
        "realistic",
        "World",
        {"nominal": "Nominal: as specified", "realistic": "Realistic", "hard": "Hard"},
        "How far patient and devices deviate from their specification",
    )
    bone_loss: float | None = number(
        None, "Bone attenuation", "", 0.5, 2.0, 0.05, hint="Over its published mean"
    )
    bone_speed: float | None = number(
        None,
        "Bone speed of sound",
        "",
        0.85,
        1.15,
        0.01,
        hint="Of all patients, over the nominal one",
    )
    outer_texture_mm: float | None = number(
        None, "Outer texture", "mm", 0.0, 0.3, 0.01, hint="RMS unevenness of the outer table"
    )
    inner_relief_mm: float | None = number(
        None, "Inner relief", "mm", 0.0, 0.3, 0.01, hint="RMS of the inner boundary", before=0.0
    )
    step_relief_mm: float | None = number(
        None, "Step relief", "mm", 0.0, 0.6, 0.01, hint="RMS, outer table to diploe", before=0.0
    )
    relief_length_mm: float | None = number(
        None, "Relief length", "mm", 2.0, 10.0, 0.5, hint="Correlation length of both", before=5.0
    )
    gel_speed_mm_per_us: float | None = number(
        None, "Gel speed of sound", "mm/µs", 1.4, 1.7, 0.01, hint="Between probe and bone"
    )
    film_mm: float | None = number(
        None, "Gel film", "mm", 0.0, 0.5, 0.01, hint="Remains under the pressed face"
    )
    line_excess_k: float | None = number(
        None, "Line excess temperature", "K", -15.0, 25.0, 1.0, hint="Over what is stated"
    )
    line_drift_k: float | None = number(
        None, "Line temperature drift", "K", -10.0, 10.0, 1.0, hint="Warming in a capture"
    )
    line_strain_share: float | None = number(
        None, "Speed change per strain", "", -0.5, 0.5, 0.05, hint="Of the delay line, relative"
    )
    pulse_loss: float | None = number(
        None, "Centre frequency loss", "", 0.0, 0.3, 0.01, hint="Share lost by an old probe"
    )
    mounting_mm: float | None = number(
        None, "Probe mounting offset", "mm", 0.0, 2.0, 0.1, hint="Off its place in the holder"
    )
    mounting_deg: float | None = number(
        None, "Probe mounting tilt", "deg", 0.0, 5.0, 0.1, hint="Off its direction in the holder"
    )
    spindle_mm: float | None = number(
        None, "Spindle offset", "mm", 0.0, 2.0, 0.1, hint="Of its tip, off its place"
    )
    friction: float | None = number(
        None, "Friction coefficient", "", 0.0, 0.5, 0.05, hint="Between probe face and bone"
    )
    robot_mm: float | None = number(
        None, "Robot error", "mm", 0.0, 2.0, 0.1, hint="3D RMS, systematic"
    )
    tracker_share: float | None = number(
        None, "Tracker error factor", "", 0.0, 2.0, 0.1, hint="Over what its maker states"
    )
    head_drift_mm: float | None = number(
        None, "Head drift", "mm", 0.0, 2.0, 0.1, hint="Creep of the head in its clamp"
    )
    breathing_mm: float | None = number(
        None, "Breathing amplitude", "mm", 0.0, 0.5, 0.05, hint="Of the head, to and fro"
    )

    def __post_init__(self) -> None:
        require_limits(self)


NOMINAL_WORLD = WorldSettings("nominal")
REALISTIC_WORLD = WorldSettings("realistic")
