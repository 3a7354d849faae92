"""Layers of the scene: each draws the difference between two snapshots."""

from typing import ClassVar

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.geometry.arrays import Vector3
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.viser_nodes import SceneNodes


class Layer:
    """Nodes under one name of ``view_state.LAYERS``, shown or hidden together.

    It draws one kind of object from snapshots; it sends no messages and keeps no session.
    """

    layer: str = ""
    follows: ClassVar[tuple[str, ...]] = ()  # parts of the snapshot that it is drawn from
    names: ClassVar[tuple[str, ...]] = ()  # of the nodes that are shown with the layer
    results: ClassVar[tuple[str, ...]] = ()  # that it draws, in grey where one of them is stale

    def __init__(self, nodes: SceneNodes) -> None:
        self.nodes = nodes

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw what differs from ``old``, None for the first time; show it where switched on."""
        if changed(old, new, *self.follows):
            self.draw(new)
        for name in self.names:
            self.nodes.show(name, self.shown(new))

    def draw(self, new: Snapshot) -> None:
        """Draw all nodes anew."""

    def stale(self, snapshot: Snapshot) -> bool:
        """Return whether a result that the layer draws is stale: then it is drawn in grey."""
        return any(stale_reason(name, snapshot.session) for name in self.results)

    def shown(self, snapshot: Snapshot) -> bool:
        """Return whether the layer is switched on in this browser."""
        return snapshot.view.shows(self.layer)


def lift(snapshot: Snapshot, height_mm: float) -> Vector3:
    """Return the offset (3,) that lifts things off the region, so that the skull does not hide."""
    scene = snapshot.static_scene
    return np.zeros(3) if scene is None else height_mm * scene.region_normal_base
