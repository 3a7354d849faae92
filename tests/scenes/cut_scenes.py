"""A small cutting path: two rings, the second with a thinner burr."""

import numpy as np

from rona_core.geometry.pose import Pose
from rona_core.robot.trajectory.trajectory import CuttingPath

TILT_RAD = np.deg2rad(15.0)
HIGH_MM = 5.0


def rings(
    T_base_bed: Pose, radius_mm: float = 5.0, depths_mm: tuple[float, ...] = (1.0, 2.0)
) -> CuttingPath:
    """Return rings at some depths, each from above and back up, the tilt round with the feed."""
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = radius_mm * np.column_stack((np.cos(turn), np.sin(turn)))
    axes = np.column_stack(
        (
            np.sin(TILT_RAD) * np.sin(turn),
            -np.sin(TILT_RAD) * np.cos(turn),
            np.full(len(turn), -np.cos(TILT_RAD)),
        )
    )
    rest, upright = np.array([[0.0, 0.0, HIGH_MM]]), np.array([[0.0, 0.0, -1.0]])
    bottoms, directions = [rest], [upright]
    feeds, air, radii, rests = [[20.0]], [[True]], [[2.5]], [0]
    for number, depth_mm in enumerate(depths_mm):
        over = np.array([[radius_mm, 0.0, HIGH_MM]])
        ring = np.column_stack((circle, np.full(len(turn), -depth_mm)))
        bottoms += [over, ring, over, rest]
        directions += [axes[:1], axes, axes[-1:], upright]
        feeds.append([20.0, 20.0, *[2.0 + 2.0 * number] * (len(turn) - 1), 20.0, 20.0])
        air.append([True, True, *[False] * (len(turn) - 1), True, True])
        radii.append([2.5 if number == 0 else 1.0] * (len(turn) + 3))
        rests.append(rests[-1] + len(turn) + 3)
    return CuttingPath(
        T_base_bed=T_base_bed,
        bottoms_bed=np.vstack(bottoms),
        axes_bed=np.vstack(directions),
        radii_mm=np.concatenate(radii),
        feeds_mm_per_s=np.concatenate(feeds),
        in_air=np.concatenate(air).astype(np.bool_),
        rests=np.array(rests),
        surface_mm=0.0,
    )
