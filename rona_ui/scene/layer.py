"""What every adapter of the scene is: it draws the difference between two pictures."""

from typing import Protocol

from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.viser_nodes import SceneNodes


class Adapter(Protocol):
    """Draws one thing; never sends a message, never keeps what it read."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring the scene from ``old`` to ``new``; ``old`` is None for the first time."""
        ...


class Layer:
    """Nodes under one name of ``view_state.LAYERS``, shown or hidden together."""

    layer = ""

    def __init__(self, nodes: SceneNodes) -> None:
        self.nodes = nodes

    def shown(self, snapshot: Snapshot) -> bool:
        """Return whether the layer is switched on in this browser."""
        return snapshot.view.shows(self.layer)

    def toggled(self, old: Snapshot | None, new: Snapshot) -> bool:
        """Return whether the layer was switched on or off, or is drawn for the first time."""
        return old is None or self.shown(old) != self.shown(new)
