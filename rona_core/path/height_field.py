"""Height field of a point cloud over the tangent plane of a patch, by local regression."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, as_points
from rona_core.geometry.pose import Pose

NEIGHBOURS = 24
REACH_MM = 6.0  # a place with no point within this distance has no height
DEPTH_MM = 40.0  # points farther from the tangent plane belong to something else
RIDGE = 1e-3  # of the weight: a lean that the points do not show is not made up


def fit_height_field(points_base: ArrayLike, T_base_patch: Pose) -> Callable[[Floats], Floats]:
    """Return the height (k,) in mm of a surface cloud over places (k, 2) of a patch.

    At each place a plane is fitted to the points around it, with weights that fall to zero at the
    last of 24 neighbours; so noise is averaged and a lean is followed.

    Args:
        points_base: Surface points (n, 3) in ``base``.
        T_base_patch: Pose of the patch, z out of the bone.

    Raises:
        DegenerateGeometryError: too few points near the patch, or, from the function returned,
            places without a point nearby.
    """
    points_patch = T_base_patch.inv() @ as_points(points_base, name="points_base")
    points_patch = points_patch[np.abs(points_patch[:, 2]) <= DEPTH_MM]
    if len(points_patch) < 3:
        raise DegenerateGeometryError(
            f"only {len(points_patch)} surface points lie within {DEPTH_MM:g} mm of the patch"
        )
    tree = KDTree(points_patch[:, :2])
    k = min(NEIGHBOURS, len(points_patch))

    def heights(places: Floats) -> Floats:
        distances, rows = tree.query(places, k=k)
        uncovered = distances[:, 0] > REACH_MM
        if uncovered.any():
            raise DegenerateGeometryError(
                f"{int(uncovered.sum())} of {len(places)} places of the pattern have no surface "
                f"point within {REACH_MM:g} mm: sample the surface there or draw the boundary "
                "closer"
            )
        width = np.maximum(distances[:, -1:], 1e-9) * (1.0 + 1e-9)
        weights = (1.0 - (distances / width) ** 2) ** 2
        weights /= weights.sum(axis=1, keepdims=True)
        offsets = points_patch[rows, :2] - places[:, None]
        z = points_patch[rows, 2]
        middle = (weights[..., None] * offsets).sum(axis=1)
        mean = (weights * z).sum(axis=1)
        q, r = offsets - middle[:, None], z - mean[:, None]
        moments = np.einsum("pk,pki,pkj->pij", weights, q, q)
        moments += RIDGE * np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        moments += 1e-12 * np.eye(2)
        slope = np.linalg.solve(moments, np.einsum("pk,pki,pk->pi", weights, q, r)[..., None])
        return mean - (slope[..., 0] * middle).sum(axis=1)

    return heights
