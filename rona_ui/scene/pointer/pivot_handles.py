"""Arcs about the tip of the pointer that turn it while it is pivoted by hand."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_ui.scene.pointer.pointer import pointer_points
from rona_ui.scene.viser_nodes import Stage
from rona_ui.view_state import Picture

NODE = "/turn"
SIZE_MM = 400.0  # of the whole; the arcs have 0.65 of it as radius, about as far as the markers
# the arcs lie between their axes; so turned, about z of the base, they face the usual camera
START = Pose.from_rotvec((0.0, 0.0, -np.pi / 2.0))


class TurnLayer:
    """Shows the arcs as long as the pointer is in the hand, whatever layers are switched off."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def render(self, old: Picture | None, new: Picture) -> None:
        """Put the arcs where the tip is drawn at the start; they stay there."""
        pose = new.T_base_pointermarker
        if not new.turning:
            self._stage.remove(NODE)
        elif pose is not None and NODE not in self._stage.names():
            _, tip_base = pointer_points(pose, new.session.setup.devices.pointer)
            self._stage.arcs(NODE, Pose(START.rotation, tip_base), size_mm=SIZE_MM)


def turn_of(wxyz: ArrayLike) -> Floats:
    """Return how far arcs of this orientation (4,) have been turned: (4,), axes of ``base``."""
    return (Pose.from_wxyz(wxyz) @ START.inv()).wxyz()
