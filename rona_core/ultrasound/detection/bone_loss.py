"""Loss of the bone, learned from the survey itself: how faint sure inner echoes are, by depth.

Published attenuations of skull bone differ sixfold, so an inner echo cannot be judged by a nominal
one. Sure echoes are as loud as nominal ones but for obliquity, which does not depend on the bone;
what they are fainter by, over the way that they came, is the loss that nominal bone does not have.
A step from table to diploe is fainter for another reason, so only echoes from deeper than any outer
table count.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.single.candidates import Echoes
from rona_core.ultrasound.detection.single.inner_echo import InnerEchoes
from rona_core.ultrasound.detection.spatial.detectability import STEP_SHARE, within_table
from rona_core.ultrasound.probe.materials import Material

FIRST_LOSSES = 1.4, 1.8  # over the nominal one: high, so that faint echoes count at first
LOSSES = 0.5, 2.0  # of bone, over the nominal one
LEAST_SURE = 10  # A-scans; fewer tell nothing
USUAL_LEVEL = 0.60  # of a sure inner echo over that of a parallel boundary: it leans, and is rough
SAME_US = 0.2  # the peak that was selected lies this close to the time that was found


def learned_loss(
    echoes: Echoes, inner: InnerEchoes, sure: Bools, bone: Material, loss: float
) -> float | None:
    """Return the attenuation of the bone over the nominal one; None where too few echoes are sure.

    Args:
        echoes: Of all A-scans (n), their levels over those in bone of ``loss``.
        inner: The inner echoes that were selected.
        sure: Which of them count (n,).
        bone: Bone as it was assumed.
        loss: Its attenuation over the nominal one.
    """
    candidates, rows = echoes.candidates, np.arange(len(sure))
    apart = np.where(candidates.exists, np.abs(candidates.lag_us - inner.lag_us[:, None]), np.inf)
    nearest = apart.argmin(axis=1)
    depth_mm = inner.lag_us * bone.speed_mm_per_us / 2.0
    deep = within_table(depth_mm, echoes.template.probe) < STEP_SHARE
    used = sure & deep & (apart[rows, nearest] < SAME_US)
    if np.count_nonzero(used) < LEAST_SURE:
        return None
    level: Floats = candidates.level[rows, nearest][used]
    depth_mm = depth_mm[used]
    centre_mhz = np.array([echoes.template.probe.centre_mhz])
    per_mm = -2.0 * float(bone.wavenumber_per_mm(centre_mhz).imag[0]) / loss  # there and back
    found = loss - np.log(np.maximum(level, 1e-6) / USUAL_LEVEL) / (per_mm * depth_mm)
    return float(np.clip(np.median(found), *LOSSES))
