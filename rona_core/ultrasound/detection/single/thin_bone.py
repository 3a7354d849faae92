"""Thin-bone test: whether the two boundaries are too close to be resolved.

Then the inner echo is so close behind the front that it is taken for a part of it, and what is
found later is the same echo once more, back and forth in the bone. As a multiple it cannot be known
by what is ahead of it, for that is gone with the front. But the front does not look like one then.
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.front_echo import Fronts
from rona_core.ultrasound.detection.single.inner_echo import bone_gate_us, through_bank
from rona_core.ultrasound.detection.single.matched_filter import Template
from rona_core.ultrasound.probe.materials import Complexes, Material

FROM = 0.4  # of the least thickness: closer to the front, nothing is seen
LEVEL = 0.35, 0.55  # level over a nominal inner echo: from where on bone may be thin, and is
OVER = 1.5, 2.5  # the same for that level over the one of what is taken for the inner echo


def merged_levels(aligned: Complexes, fronts: Fronts, template: Template, bone: Material) -> Floats:
    """Return the level (n,) over a nominal inner echo of what follows the front at once.

    The front is taken away as one plain echo, which leaves little of bone that is thick enough.
    It is 0 where the front was not measured, but known from elsewhere.

    Args:
        aligned: Spectra (n, f) with the front echo at time 0.
        fronts: Those front echoes (n,).
        template: Of the probe and excitation.
        bone: Nominal bone.
    """
    height = template.compress(aligned, template.spectrum)[:, 0]
    residual = aligned - height[:, None] * template.spectrum
    first = int(
        2.0 * FROM * template.probe.min_thickness_mm / bone.speed_mm_per_us / template.step_us
    )
    last = int(bone_gate_us(template.probe, bone)[0] / template.step_us)
    z, gain = through_bank(residual, template, bone, first, last)
    return np.where(fronts.measured, (np.abs(z) * gain).max(axis=1), 0.0)


def thick_enough(merged: Floats, level: Floats) -> Floats:
    """Return how far (n,), 1 to 0, an inner echo is to be believed.

    Args:
        merged: What `merged_levels` says.
        level: Of the inner echo over a nominal one (n,).
    """
    share = np.minimum(_rise(merged, *LEVEL), _rise(merged / np.maximum(level, 1e-6), *OVER))
    return 1.0 - share


def _rise(x: Floats, low: float, high: float) -> Floats:
    return np.clip((x - low) / (high - low), 0.0, 1.0)
