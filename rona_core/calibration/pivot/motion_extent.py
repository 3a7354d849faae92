"""Extent of a pivot motion: half-angle of the cone, and evenness of the swing."""

import numpy as np

from rona_core.calibration.pivot.refusals import refusal
from rona_core.calibration.pivot.sphere_fit import cap_half_angle_deg
from rona_core.geometry.arrays import Floats

MIN_CONE_DEG = 5.0  # half-angle that the lever must cover
MIN_CROSS_DEG = 2.5  # half-angle of an even cone that turns as much about its weakest axis
STATIC_DEG = 1.0


def require_cone(levers: Floats) -> float:
    """Return the half-angle (deg) of the cone that unit vectors (n, 3) cover.

    Raises:
        DegenerateGeometryError: less than 5 degrees.
    """
    cone_deg = cap_half_angle_deg(levers)
    if cone_deg < MIN_CONE_DEG:
        raise refusal("narrow", degrees=cone_deg, least=MIN_CONE_DEG)
    return cone_deg


def swing_of_shaft_deg(shafts: Floats) -> tuple[float, float]:
    """Return by how much unit vectors (n, 3) swing in their weakest and strongest direction.

    Both are half-angles of the even cone that swings as much.
    """
    mean = shafts.mean(axis=0)
    across = np.linalg.svd(mean[None] / np.linalg.norm(mean))[2][1:]  # plane across the shaft
    tilts = (shafts - mean) @ across.T
    spread = np.linalg.eigvalsh(tilts.T @ tilts / len(tilts))
    weakest, strongest = np.rad2deg(2.0 * np.sqrt(np.maximum(spread, 0.0)))
    return float(weakest), float(strongest)


def require_swing(rotations: Floats, dof: int) -> None:
    """Refuse rotations that leave some direction of the tip open.

    ``mean |R v - mean(R v)|^2`` is how much a lever along v moves, per length squared. For an even
    cone of half-angle w without spin it is w^2 / 4 across the shaft, so 2 sqrt() is the angle.

    Args:
        rotations: (n, 3, 3) of the marker.
        dof: 6, or 5 where only the z axis is known.

    Raises:
        DegenerateGeometryError: static, in one plane, or too small.
    """
    deviations = rotations - rotations.mean(axis=0)
    if dof == 5:
        weakest, strongest = swing_of_shaft_deg(rotations[:, :, 2])
    else:
        moved = np.einsum("nji,njk->ik", deviations, deviations) / len(rotations)
        spread = np.linalg.eigvalsh(moved)
        weakest, _, strongest = np.rad2deg(2.0 * np.sqrt(np.maximum(spread, 0.0)))
    if strongest < STATIC_DEG:
        raise refusal("still", degrees=strongest)
    if weakest < MIN_CROSS_DEG and strongest > 2.0 * MIN_CROSS_DEG:
        raise refusal("one plane", strongest=strongest, weakest=weakest)
    if weakest < MIN_CROSS_DEG:
        raise refusal("small", degrees=strongest, least=MIN_CONE_DEG)
