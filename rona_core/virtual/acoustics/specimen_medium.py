"""The medium of a specimen: what was chosen for its bone, and the patient's own speed of sound."""

from dataclasses import replace

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.session.specimen import BoneChoice
from rona_core.virtual.acoustics.medium import MEDIA, Medium
from rona_core.virtual.acoustics.microstructure import local_speed_factors
from rona_core.virtual.scene import VirtualScene

PATIENT_STREAM = 0x50EED  # names the share of this draw in the session's seed
PATIENT_SD, LOCAL_SD = 0.03, 0.02  # relative, between patients and from place to place
MOST_SD = 2.5  # no patient is further from the mean


def patient_speed_factor(seed: int) -> float:
    """Return the speed of sound in the bone of a simulated patient over the nominal one."""
    draw = float(np.random.default_rng((seed, PATIENT_STREAM)).normal())
    return 1.0 + PATIENT_SD * float(np.clip(draw, -MOST_SD, MOST_SD))


def bone_medium(choice: BoneChoice, seed: int) -> Medium:
    """Return gel, bone and brain as the virtual probe meets them: ground truth."""
    medium = MEDIA[choice.kind]
    if not choice.own_speed:
        return medium
    factor = patient_speed_factor(seed)
    table, diploe = (
        replace(bone, speed_mm_per_us=factor * bone.speed_mm_per_us)
        for bone in (medium.table, medium.diploe)
    )
    return replace(medium, table=table, diploe=diploe, local_speed_sd=LOCAL_SD)


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
