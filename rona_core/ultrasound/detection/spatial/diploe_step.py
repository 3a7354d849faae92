"""Whether what is taken for the inner boundary is the step from table to diploe.

That step is an interface that goes on from place to place. Where the inner boundary leans away or
drowns in noise, nothing is seen behind it, and it cannot be told from an inner boundary there. But
the same interface, a few millimetres on, has the inner boundary behind it, and an interface that
sound passes in one place is not the last one in the next.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.single.inner_echo import Candidates
from rona_core.ultrasound.detection.spatial.detectability import within_table
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links
from rona_core.ultrasound.probe.probe_model import ProbeModel

SAME_MM = 0.5  # an interface changes its depth by no more than this between A-scans around,
FAINTER = 0.5  # and is at least this loud, over what it is here
ROUNDS = 4  # of asking those around, who have asked those around them: about 10 mm


def seen_behind_along(
    behind: Floats, depth_mm: Floats, candidates: Candidates, links: Links, probe: ProbeModel
) -> Floats:
    """Return how sure (n, k) a boundary lies behind each candidate, here or along its interface.

    Args:
        behind: How sure that is in each place (n, k).
        depth_mm: Of the candidates (n, k).
        candidates: The candidates.
        links: Who is around whom.
        probe: What is deeper than any outer table that it sees is no such step.
    """
    n = len(depth_mm)
    nearest: list[Ints] = []
    alike: list[Bools] = []
    for sources in links.around:
        there = np.maximum(sources, 0)
        gap = np.abs(depth_mm[there][:, None, :] - depth_mm[:, :, None])  # (n, here, there)
        quiet = candidates.level[there][:, None, :] < FAINTER * candidates.level[:, :, None]
        gap = np.where(quiet | ~candidates.exists[there][:, None, :], np.inf, gap)
        nearest.append(gap.argmin(axis=2))
        alike.append((sources >= 0)[:, None] & (gap.min(axis=2, initial=np.inf) < SAME_MM))
    along = behind
    for _ in range(ROUNDS if n else 0):
        total, count = along.copy(), np.ones(along.shape)
        for sources, column, same in zip(links.around, nearest, alike, strict=True):
            told = along[np.maximum(sources, 0)[:, None], column]
            total += np.where(same, told, 0.0)
            count += same
        along = total / count
    return np.maximum(behind, within_table(depth_mm, probe) * along)
