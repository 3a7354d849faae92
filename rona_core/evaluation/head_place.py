"""Where the head lay in step 4: the place that all maps and figures of a session are for."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.geometry.arrays import Vector3
from rona_core.session.captures import is_imported
from rona_core.virtual.scene import VirtualScene

if TYPE_CHECKING:
    from rona_core.session.document import Session


def head_place_base(session: "Session", scene: VirtualScene) -> Vector3:
    """Return how far (3,) the head was from its rest in the mean of the first stroke of step 4.

    Zero before it, and where the stroke came out of a file.
    """
    strokes = session.captures.surface
    if not strokes or is_imported(strokes[0]):
        return np.zeros(3)
    first = strokes[0]
    watched = first.head is not None and len(first.head.times_s) > 0
    track = first.head if first.head is not None and watched else first.marker
    if not len(track.times_s):
        return np.zeros(3)
    return scene.head_shift_base(first.ordinal, track.times_s).mean(axis=0)
