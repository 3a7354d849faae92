"""How thick and how fast the true bone is below a probe: ground truth, for the evaluation."""

import numpy as np

from rona_core.arrays import Bools, Floats
from rona_core.geometry.pose import Poses
from rona_core.ultrasound.bone_speed import local_speed_factors
from rona_core.ultrasound.medium import Medium
from rona_core.virtual.scene import VirtualScene

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
