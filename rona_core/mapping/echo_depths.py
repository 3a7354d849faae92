"""How deep the inner boundary is below the outer one, where all passes over a region agree."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, readonly
from rona_core.mapping.build_maps import LocatedDetection
from rona_core.mapping.pass_fusion import counting, fuse_passes
from rona_core.ultrasound.acoustic_calibration.reference_points import EchoDepths


def echo_depths(found: LocatedDetection, further: LocatedDetection | None = None) -> EchoDepths:
    """Return the depths of the A-scans that are sure, or that agree with those of other passes.

    A depth is along the axis of the nearest A-scan of the first pass, which was upright, and at the
    speed of sound that the boundaries were detected with. Nothing is fitted to a map.

    Args:
        found: In the first pass.
        further: The same of the tilted passes, if there are any.
    """
    first = found.detection
    entries, axes = found.points()[0], found.Ts_base_probe.rotations[:, :, 2]
    if further is None:
        rows = np.flatnonzero(first.inner_ok)
        depths_mm, quality, common_mm = first.thickness_mm, first.inner_quality, 0.0
    else:
        again, tilted = further.detection, further.Ts_base_probe.rotations[:, :, 2]
        numbers = np.zeros(len(again), np.int64) if further.passes is None else further.passes
        passes = np.concatenate((np.zeros(len(first), np.int64), 1 + numbers))
        there = further.points()[0]
        upright = np.vstack((axes, axes[KDTree(entries).query(there)[1]]))
        thickness_mm = np.concatenate((first.thickness_mm, again.thickness_mm))
        echoes = thickness_mm[:, None] * np.vstack((axes, tilted))
        depths_mm = np.einsum("ij,ij->i", echoes, upright)
        entries = np.vstack((entries, there))
        above = entries + echoes - depths_mm[:, None] * upright
        axes = upright
        usable = np.concatenate((counting(first), counting(again)))
        fusion = fuse_passes(entries, above, depths_mm, usable, passes)
        entries = above
        rows, common_mm = np.flatnonzero(fusion.agreeing), fusion.sigma_mm
        depths_mm = depths_mm - fusion.offsets_mm[passes]
        quality = np.concatenate((first.inner_quality, again.inner_quality))
    return EchoDepths(
        scans=readonly(rows),
        places_base=_taken(entries, rows),
        axes_base=_taken(axes, rows),
        depth_mm=_taken(depths_mm, rows),
        quality=_taken(quality, rows),
        sound_speed_mm_per_us=first.sound_speed_mm_per_us,
        common_sigma_mm=common_mm,
    )


def _taken(values: Floats, rows: np.ndarray) -> Floats:
    return readonly(values[rows])
