"""Whether those around that show the same boundary are sure of it.

Two worlds may explain the same echoes: the inner boundary, or a step within lossier bone whose
inner echo drowns. Such a step goes on from place to place, and so does what rings on at the end of
a record; most A-scans that show it are refused, for being too faint, too thin or too thick, and a
few that noise makes louder are not. What is refused in most places is not sure in the others.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.spatial.detectability import SAME_MM
from rona_core.ultrasound.detection.spatial.neighbours import Links

LEAST_ALIKE = 3  # A-scans; fewer tell nothing
LEAST_SURE = 0.5  # of them
DOUBTED = 0.5  # quality of what two worlds explain alike


def refused_around(thickness_mm: Floats, seen: Bools, sure: Bools, links: Links) -> Bools:
    """Return which sure A-scans (n,) most of those around refuse that show the same boundary.

    Args:
        thickness_mm: As found (n,).
        seen: Which show any boundary (n,).
        sure: Which of those are sure of it (n,).
        links: Who is around whom.
    """
    around = np.maximum(links.around, 0)
    gap = np.abs(thickness_mm[around] - thickness_mm)
    alike = (links.around >= 0) & seen[around] & (gap < SAME_MM)
    count = alike.sum(axis=0)
    agreeing = (alike & sure[around]).sum(axis=0)
    refused: Bools = sure & (count >= LEAST_ALIKE) & (agreeing < LEAST_SURE * count)
    return refused
