"""Rings about the tip of the pointer that turn it while it is pivoted by hand."""

from rona_ui.scene.metres import Stage
from rona_ui.scene.pointer import pointer_points
from rona_ui.view_state import Picture

NODE = "/turn"
SIZE_MM = 120.0


class TurnLayer:
    """Shows the rings as long as the pointer is in the hand, whatever layers are switched off."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def render(self, old: Picture | None, new: Picture) -> None:
        """Put the rings where the tip is drawn at the start; they stay there."""
        pose = new.T_base_pointermarker
        if not new.turning:
            self._stage.remove(NODE)
        elif pose is not None and NODE not in self._stage.names():
            _, tip_base = pointer_points(pose, new.session.setup.devices.pointer)
            self._stage.rings(NODE, tip_base, size_mm=SIZE_MM)
