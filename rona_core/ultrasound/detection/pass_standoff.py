"""Stand-off of a tilted pass as a whole, from the front echoes that it has.

The stand-off of a tilted probe comes from the map of the outer boundary and the pose of the robot.
A holder that slipped, a line that is warmer or links that err otherwise in these postures change it
for all A-scans of the pass alike, and a millimetre of stand-off is 1.7 mm of thickness. A quarter
to a half of the A-scans at 5 degrees still have a front echo, and these show it.
"""

from dataclasses import replace

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.candidates import clear_fronts
from rona_core.ultrasound.detection.single.front_echo import fronts_found, standoff_mm
from rona_core.ultrasound.probe.probe_model import ProbeSurvey

LEAST_FRONTS = 12  # fewer show nothing of a pass
WINDOW_MM = 0.25  # fronts further apart are of other cycles, or of other places
EXPECTED_MM = 0.15  # standard deviation of the offset, by which a cycle is chosen


def standoff_offset_mm(survey: ProbeSurvey, known_mm: Floats) -> float:
    """Return by how much the stand-offs of a pass are longer than they are known to be.

    Args:
        survey: A-scans (n) of the pass.
        known_mm: Stand-offs (n,), from the outer map and the poses.
    """
    fronts = clear_fronts(replace(survey, known_standoff_mm=None)).fronts
    found = fronts_found(fronts, survey.probe)
    off_mm = np.sort((standoff_mm(fronts.delay_us, survey.probe) - known_mm)[found])
    ends = np.searchsorted(off_mm, off_mm + WINDOW_MM)
    counts = ends - np.arange(len(off_mm))
    if counts.max(initial=0) < LEAST_FRONTS:
        return 0.0
    likely = np.exp(-0.5 * ((off_mm + 0.5 * WINDOW_MM) / EXPECTED_MM) ** 2)
    first = int((counts * likely).argmax())
    return float(np.median(off_mm[first : ends[first]]))
