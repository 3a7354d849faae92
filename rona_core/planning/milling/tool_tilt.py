"""Tilt of a ball burr: its pole, which does not move, is kept behind the feed.

The front of a ball that moves along v is where its normals n have n . v > 0. The pole lies at the
end of the axis a, so that it is behind as long as a . v < 0: with the axis leant against the feed
by t, and a way down of slope s, a . v = sin(s - t).
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints

CORNER_RAD = float(np.deg2rad(30.0))  # of the path: where it turns by more, the axis turns in place


def tilted(bottoms_bed: Floats, moves: Ints, tilt_rad: float) -> tuple[Floats, Floats, Ints]:
    """Return lowest places (m, 3), axes (m, 3) into the bone and moves (m,) with m >= n.

    At corners of the path a place stands twice, with the axis of the way in and of the way out.
    """
    steps = np.diff(bottoms_bed, axis=0)
    moved = np.concatenate(([True], np.linalg.norm(steps, axis=1) > 1e-9))
    bottoms, moves = bottoms_bed[moved], moves[moved]
    n = len(bottoms)
    if tilt_rad == 0.0 or n < 2:
        return bottoms, np.tile((0.0, 0.0, -1.0), (n, 1)), moves
    along = np.diff(bottoms[:, :2], axis=0)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    into = np.concatenate((heading[:1], heading))
    out = np.concatenate((heading, heading[-1:]))
    corner = np.abs(out - into) > CORNER_RAD
    times = np.where(corner, 2, 1)
    rows = np.repeat(np.arange(n), times)
    second = np.concatenate(([False], rows[1:] == rows[:-1]))
    heading = np.where(
        corner[rows], np.where(second, out[rows], into[rows]), 0.5 * (into + out)[rows]
    )
    sine, cosine = np.sin(tilt_rad), np.cos(tilt_rad)
    axes = np.column_stack(
        (-sine * np.cos(heading), -sine * np.sin(heading), np.full(len(rows), -cosine))
    )
    return bottoms[rows], axes, moves[rows]
