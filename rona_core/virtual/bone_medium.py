"""The medium of a specimen: what was chosen for its bone, and the patient's own speed of sound."""

from dataclasses import replace

import numpy as np

from rona_core.session.specimen import BoneChoice
from rona_core.ultrasound.medium import MEDIA, Medium

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
