"""The way of a burr as a rehearsal mills it: places close together, of the cuts alone."""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.planning.rehearsal.site import BurrWay
from rona_core.planning.robot_milling.robot_path import RobotPath

STEP_MM = 0.25  # between places of the way at which force is felt
FINE_MM = 0.1  # between those they are taken from: the tip may go further than the ball


def burr_way(
    path: RobotPath, layers: Ints, ways_mm: Floats, qs_rad: Floats, times_s: Floats
) -> BurrWay:
    """Return the places at which the burr cuts, evenly along its way.

    Args:
        path: What the robot drives.
        layers: Of the n places of the milling path (n,).
        ways_mm: Along the path of the robot (k,), never falling.
        qs_rad: Postures there (k, 6).
        times_s: When the robot is there (k,).
    """
    cutting = path.cutting
    ways = np.arange(0.0, float(cutting.way_mm()[-1]), FINE_MM)
    moves = cutting.moves_at(ways)
    cuts = ~cutting.in_air[moves]
    ways, moves = ways[cuts], moves[cuts]
    bottoms = cutting.at(ways).bottoms_bed
    gone = np.cumsum(np.linalg.norm(np.diff(bottoms, axis=0, prepend=bottoms[:1]), axis=1))
    kept = np.diff(np.floor(gone / STEP_MM), prepend=-1.0) > 0.0
    ways, moves = ways[kept], moves[kept]
    qs = [np.interp(ways, ways_mm, q) for q in qs_rad.T]
    return BurrWay(
        T_base_bed=cutting.T_base_bed,
        bottoms_bed=bottoms[kept],
        radii_mm=cutting.radii_mm[moves],
        qs_rad=np.column_stack(qs),
        times_s=np.interp(ways, ways_mm, times_s),
        feeds_mm_per_s=cutting.feeds_mm_per_s[moves],
        layers=layers[path.places[moves]],
    )
