"""The frame in which a volume is looked at: along its voxels, z up and x to a side of the head."""

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose

DIGITS = 6  # of the edges of voxels in mm: single precision in a header has no more
TURNS = tuple(
    np.eye(3)[list(order)] * np.array(signs)[:, None]
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
)  # rows: x, y and z of ``upright`` along the axes of the voxels; of either handedness


def upright_frame(T_skull_voxel: Floats, turns: Sequence[Floats] = TURNS) -> tuple[Floats, Pose]:
    """Return how voxels lie in ``upright``, and where that is in the coordinates of the file.

    Of the turns it takes the one whose axes lie nearest to those of the file. ``upright`` is
    right-handed as the file's coordinates are; of voxels of the other hand an axis runs backwards.

    Args:
        T_skull_voxel: Coordinates of an index in the file, (4, 4); a grid at right angles.
        turns: Rows are the axes of ``upright`` among those of the voxels, (3, 3) each.

    Returns:
        T_upright_voxel (4, 4), along the axes, and the pose T_skull_upright; their product is
        T_skull_voxel but for what the header has rounded.
    """
    columns = T_skull_voxel[:3, :3]
    edges = np.linalg.norm(columns, axis=0)
    u, _, v = np.linalg.svd(columns / edges)
    axes = u @ v  # the orthogonal matrix next to that of the header
    hand = round(float(np.linalg.det(axes)))
    proper = [turn for turn in turns if round(float(np.linalg.det(turn))) == hand]
    turn = max(proper, key=lambda turn: float(np.trace(axes @ turn.T)))
    T_upright_voxel = np.eye(4)
    T_upright_voxel[:3, :3] = turn * edges.round(DIGITS)
    return T_upright_voxel, Pose(axes @ turn.T, T_skull_voxel[:3, 3])
