"""Furrows of the inner boundary that ultrasound did not hear, as draws of it may have them.

Vessels of the dura lie in furrows of the inner table that are narrower than a beam. A map smooths
them away, and all that tells of one is that an A-scan above it heard no inner boundary. What hides
there leaves less bone, never more, so that an error that goes either way does not stand for it.
"""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build_maps import LEAST_THICKNESS_MM
from rona_core.mapping.fitting.gaussian_field import field_root

# No source tells how deep, wide and frequent such furrows are: assumed, and chosen such that P of
# beds was honest on virtual patients that no published figure is made with.
MEAN_MM, SIGMA_MM = -0.5, 0.7  # of the depth; below 0 there is none: one place in four has some
HALF_WIDTH_MM = 1.0  # a Gaussian's deviation, from an A-scan that heard nothing
REACH_MM = 20.0  # along a furrow its depth is alike (a Gaussian's deviation)
AT_ONCE = 16  # draws that are worked on together: all of them take much memory


def with_furrows(maps: Maps, outer_mm: Floats, inner_mm: Floats, seed: int = 0) -> Floats:
    """Return draws of the inner boundary (n, nu, nv) with furrows where no echo was heard.

    Args:
        maps: That they are draws of; the A-scans that went into the inner map were heard.
        outer_mm: Heights of the outer boundary (n, nu, nv), which no furrow reaches.
        inner_mm: Heights of the inner one (n, nu, nv).
        seed: Of the furrows.
    """
    if maps.inner_used.all():
        return inner_mm
    u_mm, v_mm = maps.inner.u_mm, maps.inner.v_mm
    cells = np.stack(np.meshgrid(u_mm, v_mm, indexing="ij"), axis=-1)
    unheard = (maps.inner.T_base_map.inv() @ maps.outer_points_base[~maps.inner_used])[:, :2]
    away = KDTree(unheard).query(cells)[0] / HALF_WIDTH_MM
    share, random = np.exp(-0.5 * away**2), np.random.default_rng(seed)
    along_u, along_v = field_root(u_mm, REACH_MM), field_root(v_mm, REACH_MM)
    deepened: Floats = np.zeros(inner_mm.shape)
    for start in range(0, len(inner_mm), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        field = along_u @ random.standard_normal(inner_mm[some].shape) @ along_v.T
        furrows = share * np.maximum(MEAN_MM + SIGMA_MM * field, 0.0)
        np.minimum(
            inner_mm[some] + furrows, outer_mm[some] - LEAST_THICKNESS_MM, out=deepened[some]
        )
    return deepened
