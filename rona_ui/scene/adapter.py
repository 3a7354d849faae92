"""What every adapter of the scene is: it draws the difference between two pictures."""

from typing import Protocol

from rona_ui.scene.viser_nodes import Stage
from rona_ui.view_state import Picture


class Adapter(Protocol):
    """Draws one thing; never sends a message, never keeps what it read."""

    def render(self, old: Picture | None, new: Picture) -> None:
        """Bring the scene from ``old`` to ``new``; ``old`` is None for the first time."""
        ...


class Layer:
    """Nodes under one name of ``view_state.LAYERS``, shown or hidden together."""

    layer = ""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def shown(self, picture: Picture) -> bool:
        """Return whether the layer is switched on in this browser."""
        return picture.view.shows(self.layer)

    def toggled(self, old: Picture | None, new: Picture) -> bool:
        """Return whether the layer was switched on or off, or is drawn for the first time."""
        return old is None or self.shown(old) != self.shown(new)
