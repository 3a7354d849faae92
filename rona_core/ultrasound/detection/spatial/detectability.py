"""Echo detectability: whether an echo is strong enough to be the inner boundary.

An inner echo needs ``MIN_ECHO_LEVEL`` of the nominal one, -6 dB. What is fainter may be the step
from table to diploe: it goes on from place to place as the inner boundary does, it is parallel to
the outer boundary, and it reflects a third of what an inner boundary does. Where lossy bone buries
the inner echo in the noise, nothing behind the step contradicts it, and all A-scans around confirm
it. An inner boundary may be as faint in one A-scan if it is oblique; with what the obliquity takes
away given back it is as strong as it should be (``oblique_correction.py``). Bone may also lose more
on the way than it should, the more the thicker it is. Deeper than the outer table of the thickest
bone that the probe sees, there is no such step.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.spatial.neighbours import Links
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

# Amplitude that an inner echo needs, corrected for obliquity, over that of a nominal inner echo
# just below the surface: -6 dB.
MIN_ECHO_LEVEL = 0.5
MORE_LOSS = (
    0.10  # and this share of the loss on the way there and back: so far a learned loss is off
)
RAMP = 0.9, 1.05  # times that: from where on an echo is an inner one, perhaps and surely
OUTER_SHARE = 0.4, 0.5  # of bone that is outer table: mostly at most, and never more
STEP_SHARE = 0.5  # more likely than this within the outer table, a boundary may be its step
DROWNED = 0.5  # share of sure A-scans below which steps are expected,
SHALLOW = 0.5  # at less than this share of the depth of the others,
DEEP = 0.2  # if those are at least this share of the sure ones
SAME_MM = 1.0  # neighbours closer than this in thickness show the same boundary


def detectability(
    log_level: Floats, lag_us: Floats, rows: Ints, links: Links, probe: ProbeModel, bone: Material
) -> Floats:
    """Return how far (r,), 0 to 1, echoes are strong enough to be inner ones.

    Args:
        log_level: Natural logarithm of the level over nominal, corrected for obliquity (r,).
        lag_us: When they come after the front (r,).
        rows: Which A-scans of the survey these are (r,).
        links: Who is around whom, among all of them.
        probe: Its centre frequency sets the loss in bone.
        bone: Nominal bone.
    """
    depth = lag_us * bone.speed_mm_per_us / 2.0
    place = np.full(links.around.shape[1], -1, dtype=np.int64)  # in ``rows``
    place[rows] = np.arange(len(rows))
    total, count = log_level.copy(), np.ones(len(rows))
    for sources in links.around:
        beside = np.where(sources[rows] >= 0, place[sources[rows]], -1)
        alike = (beside >= 0) & (np.abs(depth[beside] - depth) < SAME_MM)
        total += np.where(alike, log_level[beside], 0.0)
        count += alike
    loss = -2.0 * bone.wavenumber_per_mm(np.array([probe.centre_mhz])).imag[0] * depth
    over = np.exp(total / count + MORE_LOSS * loss) / MIN_ECHO_LEVEL
    low, high = RAMP
    detectable = np.clip((over - low) / (high - low), 0.0, 1.0)
    return np.asarray(np.maximum(detectable, 1.0 - within_table(depth, probe)), dtype=np.float64)


def possible_steps(thickness_mm: Floats, sure: Bools, probe: ProbeModel) -> Bools:
    """Return which sure inner boundaries (n,) may as well be the step from table to diploe.

    Where a survey is sure of fewer than half of its A-scans, most inner echoes have drowned. Those
    that are less than half as deep as the others may then be thin bone, or its step, and there may
    be more of them than of the inner echoes that are left.

    Args:
        thickness_mm: Of the bone, as found (n,).
        sure: Which of them count (n,).
        probe: What is deeper than any outer table that it sees is no step.
    """
    in_table = sure & (within_table(thickness_mm, probe) > STEP_SHARE)
    deep = sure & ~in_table
    none = np.zeros(len(sure), dtype=np.bool_)
    if not deep.any() or sure.mean() >= DROWNED or deep.sum() < DEEP * sure.sum():
        return none
    return in_table & (thickness_mm < SHALLOW * np.median(thickness_mm[deep]))


def within_table(depth_mm: Floats, probe: ProbeModel) -> Floats:
    """Return how far depths (...), 1 to 0, may be within the outer table of the bone."""
    least, most = OUTER_SHARE
    too_deep = (depth_mm / probe.max_thickness_mm - least) / (most - least)
    return np.asarray(1.0 - np.clip(too_deep, 0.0, 1.0), dtype=np.float64)
