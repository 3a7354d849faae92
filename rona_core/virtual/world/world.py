"""World: what patient and devices really are, drawn from the seed of a session."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from rona_core.devices.world_settings import NOMINAL_WORLD, WorldSettings
from rona_core.geometry.arrays import Vector3, readonly
from rona_core.geometry.pose import Pose
from rona_core.session.specimen import BoneChoice, BoneKind
from rona_core.virtual.noise import rng
from rona_core.virtual.specimen.boundaries import Relief
from rona_core.virtual.world.quantities import BONE_KINDS, QUANTITIES


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The quantities of ``docs/world.md`` for one patient and one set of devices.

    What ``WorldSettings`` names has its name and unit here.
    """

    seed: int
    bone: BoneChoice
    bone_loss: float
    bone_speed: float
    outer_texture_mm: float
    inner_relief_mm: float
    step_relief_mm: float
    relief_length_mm: float
    gel_speed_mm_per_us: float
    film_mm: float
    friction: float
    line_excess_k: float
    line_drift_k: float
    line_strain_share: float
    pulse_loss: float
    mounting_mm: float
    mounting_deg: float
    spindle_mm: float
    robot_mm: float
    tracker_share: float
    head_drift_mm: float
    breathing_mm: float
    robot_joints: bool  # the robot errs by its joints and links, not by the place of its tip alone

    @property
    def relief(self) -> Relief:
        """How uneven the boundaries of the bone are."""
        return Relief(
            self.outer_texture_mm, self.inner_relief_mm, self.step_relief_mm, self.relief_length_mm
        )

    @property
    def clamping(self) -> Pose:
        """The probe as it is clamped in its holder, in the frame where it should be."""
        return _clamping(self.seed, self.mounting_deg, self.mounting_mm)

    @property
    def spindle_off_tip(self) -> Vector3:
        """How far (3,) the tip of the spindle sits in its holder off its drawing, in ``tip``."""
        return self.spindle_mm * _direction(rng(self.seed, "world spindle", 0, 0))

    @property
    def head_drift_base(self) -> Vector3:
        """Unit vector (3,) in ``base`` along which the head creeps."""
        return _head_direction(self.seed)


def draw_world(settings: WorldSettings, bone: BoneChoice, seed: int) -> World:
    """Return the world of a seed; what is set is as it is set.

    Args:
        settings: Profile, and what is set.
        bone: What the bone is made of, as the set-up says; in other profiles than the nominal one
            some patients have sharp or hard bone where it says normal.
        seed: Of the session. Each quantity has a stream of its own.
    """
    values: dict[str, Any] = {}
    for name, quantity in QUANTITIES.items():
        chosen: float | None = getattr(settings, name)
        random = rng(seed, f"world {name}", 0, 0)
        values[name] = quantity.draw(settings.profile, random) if chosen is None else chosen
    if bone.kind == "normal":
        sharp, hard = BONE_KINDS[settings.profile]
        share = float(rng(seed, "world bone kind", 0, 0).random())
        kind: BoneKind = "sharp" if share < sharp else "hard" if share < sharp + hard else "normal"
        bone = BoneChoice(kind, bone.own_speed)
    return World(seed, bone, **values, robot_joints=settings.profile != "nominal")


NOMINAL = draw_world(NOMINAL_WORLD, BoneChoice(own_speed=False), 0)


@lru_cache(maxsize=8)  # each group of A-scans asks
def _clamping(seed: int, mounting_deg: float, mounting_mm: float) -> Pose:
    random = rng(seed, "world mounting", 0, 0)
    turn = np.deg2rad(mounting_deg) * _direction(random)
    return Pose.from_rotvec(turn, mounting_mm * _direction(random))


@lru_cache(maxsize=8)  # a contact loop asks every step
def _head_direction(seed: int) -> Vector3:
    return readonly(_direction(rng(seed, "world head", 0, 0)))


def _direction(random: np.random.Generator) -> Vector3:
    vector = random.normal(0.0, 1.0, 3)
    return vector / np.linalg.norm(vector)
