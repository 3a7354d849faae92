"""The layers of a simulated skull: ground truth, unknown to the detection of echoes."""

from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.ultrasound.probe.materials import Material
from rona_core.virtual.acoustics.microstructure import local_speed_factors
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.world.world import World

# Bone and what is around it, as the sources of docs/world.md have them. Detection assumes values of
# its own (``ultrasound.probe.materials``), which are the same in the nominal world alone.
GEL = Material(1.50, 1.00, 0.05, 1.0)
TABLE = Material(2.85, 1.90, 6.0, 1.0, shear_mm_per_us=1.5)  # White 2006
DIPLOE = Material(2.45, 1.70, 12.0, 1.0)  # Pichardo 2011; loss with scatter, Fry and Barger 1978
BRAIN = Material(1.55, 1.04, 0.5, 1.0)
PATIENT_STREAM = 0x50EED  # names the share of this draw in the session's seed
PATIENT_SD, LOCAL_SD = 0.03, 0.02  # relative, between patients and from place to place
MOST_SD = 2.5  # no patient is further from the mean


@dataclass(frozen=True, slots=True)
class Medium:
    """A skull: gel, outer table, diploe, inner table, brain, and how blurred the diploe ends are.

    ``ramp_mm`` is the width over which table turns into diploe. A sharp step makes the
    table-diploe echo stronger than that of the inner boundary; real bone has 0.3 to 0.8 mm.
    Roughness is the rms deviation of a boundary from its smooth shape; ``speckle`` is the rms
    reflectivity of one cell of diploe, 0.15 mm deep and 0.6 mm wide. ``MEDIA`` has them by name.
    """

    gel: Material = field(default=GEL)
    film_mm: float = 0.1  # of gel that remains under the pressed face
    table: Material = field(default=TABLE)
    diploe: Material = field(default=DIPLOE)
    brain: Material = field(default=BRAIN)
    ramp_mm: float = 0.5
    outer_roughness_mm: float = 0.02
    inner_roughness_mm: float = 0.05
    speckle: float = 0.02
    local_speed_sd: float = 0.0  # relative rms of the speed of sound over the skull

    def __post_init__(self) -> None:
        values = (self.ramp_mm, self.outer_roughness_mm, self.inner_roughness_mm, self.speckle)
        if min(values) < 0:
            raise InvalidInputError("ramp, roughness and speckle must not be negative")
        if not 0.0 <= self.local_speed_sd <= 0.1:
            raise InvalidInputError("local_speed_sd must be 0 to 0.1")


# "sharp": the table ends at once, so its echo is louder than that of the inner boundary; "hard":
# 2.5 times the scatter on top, and rougher.
MEDIA = {
    "normal": Medium(),
    "sharp": Medium(ramp_mm=0.0),
    "hard": Medium(
        ramp_mm=0.0,
        outer_roughness_mm=0.03,
        inner_roughness_mm=0.08,
        speckle=0.05,
    ),
}


def patient_speed_factor(seed: int) -> float:
    """Return the speed of sound in the bone of a simulated patient over the nominal one."""
    draw = float(np.random.default_rng((seed, PATIENT_STREAM)).normal())
    return 1.0 + PATIENT_SD * float(np.clip(draw, -MOST_SD, MOST_SD))


def bone_medium(world: World) -> Medium:
    """Return gel, bone and brain as the virtual probe meets them: ground truth."""
    medium = MEDIA[world.bone.kind]
    own = world.bone.own_speed
    speed = world.bone_speed * (patient_speed_factor(world.seed) if own else 1.0)
    table, diploe = (
        replace(
            bone,
            speed_mm_per_us=speed * bone.speed_mm_per_us,
            attenuation_db_per_cm=world.bone_loss * bone.attenuation_db_per_cm,
        )
        for bone in (medium.table, medium.diploe)
    )
    return replace(
        medium,
        gel=replace(medium.gel, speed_mm_per_us=world.gel_speed_mm_per_us),
        film_mm=world.film_mm,
        table=table,
        diploe=diploe,
        local_speed_sd=LOCAL_SD if own else 0.0,
    )


BEHIND_MM = 20.0  # rays start this far before the face


def true_bone(Ts_base_probe: Poses, scene: VirtualScene, medium: Medium) -> tuple[Floats, Floats]:
    """Return mean speed in mm/us and thickness in mm (n,) along the axis of each probe.

    NaN where it misses the bone.
    """
    T_skull_base = scene.T_base_skull.inv()
    axes = T_skull_base.rotate(Ts_base_probe.rotations[:, :, 2])
    starts = T_skull_base @ Ts_base_probe.translations - BEHIND_MM * axes
    found = scene.specimen.layers(starts, axes)
    hit: Bools = np.asarray(np.isfinite(found).all(axis=1), dtype=np.bool_)
    depths = np.where(hit[:, None], found, 0.0)
    table, diploe, inner = np.diff(depths, axis=1).T
    slow_us = (table + inner) / medium.table.speed_mm_per_us
    slow_us = slow_us + diploe / medium.diploe.speed_mm_per_us
    local = local_speed_factors(starts + depths[:, :1] * axes, scene.seed, medium.local_speed_sd)
    total = depths[:, 3] - depths[:, 0]
    good = hit & (total > 0.0)
    speed = np.where(good, local * total / np.where(good, slow_us, 1.0), np.nan)
    return speed, np.where(good, total, np.nan)
