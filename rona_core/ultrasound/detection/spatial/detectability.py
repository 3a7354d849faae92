"""Whether an echo is loud enough to be the inner boundary, and not the step from table to diploe.

That step goes on from place to place as the inner boundary does. Where lossy bone buries the inner
echo in the noise, nothing behind contradicts it, and all A-scans around confirm it. But it reflects
a third of what an inner boundary does, and it is parallel to the outer one. An inner boundary may
be as faint in one A-scan if it leans; then its lean is seen in the times around, and with what the
lean takes away given back it is as loud as it should be (``wedge.py``). Bone may also lose more on
the way than it should, the more the thicker it is. Deeper than the outer table of the thickest bone
that the probe sees, there is no such step.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

LEAST_LEVEL = 0.5  # of an inner echo that leans no more, over a nominal one just below the surface
MORE_LOSS = 0.21  # and this share of the nominal loss on the way there and back
RAMP = 0.9, 1.05  # times that: from where on an echo is an inner one, perhaps and surely
OUTER_SHARE = 0.4, 0.5  # of bone that is outer table: mostly at most, and never more
SAME_MM = 1.0  # neighbours closer than this in thickness show the same boundary


def loud_enough(
    log_level: Floats, lag_us: Floats, rows: Ints, links: Links, probe: ProbeModel, bone: Material
) -> Floats:
    """Return how far (r,), 0 to 1, echoes are loud enough to be inner ones.

    Args:
        log_level: Natural logarithm of how loud they would be without lean, over nominal (r,).
        lag_us: When they come after the front (r,).
        rows: Which A-scans of the survey these are (r,).
        links: Who is around whom, among all of them.
        probe: Its centre frequency tells what bone takes away.
        bone: Nominal bone.
    """
    depth = lag_us * bone.speed_mm_per_us / 2.0
    here = np.full(links.around.shape[1], -1, dtype=np.int64)
    here[rows] = np.arange(len(rows))
    total, count = log_level.copy(), np.ones(len(rows))
    for sources in links.around:
        beside = np.where(sources[rows] >= 0, here[sources[rows]], -1)
        alike = (beside >= 0) & (np.abs(depth[beside] - depth) < SAME_MM)
        total += np.where(alike, log_level[beside], 0.0)
        count += alike
    loss = -2.0 * bone.wavenumber_per_mm(np.array([probe.centre_mhz])).imag[0] * depth
    over = np.exp(total / count + MORE_LOSS * loss) / LEAST_LEVEL
    low, high = RAMP
    loud = np.clip((over - low) / (high - low), 0.0, 1.0)
    return np.asarray(np.maximum(loud, 1.0 - within_table(depth, probe)), dtype=np.float64)


def within_table(depth_mm: Floats, probe: ProbeModel) -> Floats:
    """Return how far depths (...), 1 to 0, may be within the outer table of the bone."""
    least, most = OUTER_SHARE
    too_deep = (depth_mm / probe.max_thickness_mm - least) / (most - least)
    return np.asarray(1.0 - np.clip(too_deep, 0.0, 1.0), dtype=np.float64)
