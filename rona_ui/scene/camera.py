"""Camera places by name, in base and mm."""

import numpy as np

from rona_core.arrays import Vector3
from rona_ui.view_state import Backdrop

FOCUS = {  # step -> preset; the camera moves only where the preset changes
    "setup": "Overview",
    "tool": "Overview",
    "pointer": "Overview",
    "surface": "Region",
    "path": "Region",
    "smoothing": "Region",
    "roll": "Roll",
    "scan": "Scan",
    "maps": "Region",
}
UP = np.array([0.0, 0.0, 1.0])
FIRST = ((1700.0, -1250.0, 1150.0), (330.0, 10.0, 330.0))  # before the specimen is known


def preset(name: str, backdrop: Backdrop | None) -> tuple[Vector3, Vector3]:
    """Return position and place looked at, in mm, for a camera preset."""
    if backdrop is None:
        return np.array(FIRST[0]), np.array(FIRST[1])
    center, normal = backdrop.region_center_base, backdrop.region_normal_base
    head = np.array([center[0], center[1], center[2] - 60.0])
    if name == "Region":
        return center + 82.0 * normal + np.array([40.0, -72.0, 0.0]), center - 3.0 * normal
    if name == "Roll":
        return center + np.array([72.0, -125.0, 118.0]), center + np.array([0.0, 0.0, 8.0])
    if name == "Scan":
        return center + np.array([330.0, -480.0, 300.0]), center + np.array([-60.0, 0.0, 70.0])
    if name == "Top":
        return center + np.array([-1.0, 0.0, 620.0]), center
    if name == "Left":
        return head + np.array([0.0, 620.0, 130.0]), head
    if name == "Right":
        return head + np.array([0.0, -620.0, 130.0]), head
    if name == "Robot":
        middle = 0.5 * head + np.array([0.0, 0.0, 330.0])
        return middle + np.array([500.0, -1500.0, 380.0]), middle
    middle = 0.62 * head + np.array([0.0, 0.0, 210.0])
    return middle + np.array([900.0, -1050.0, 560.0]), middle
