"""Reference points of known thickness: a dot, its number, and echo minus caliper."""

import numpy as np

from rona_core.app.steps.acoustics.view import ReferenceRow, reference_rows
from rona_ui.presentation.colors import ORANGE, PURPLE
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer, lift
from rona_ui.scene.viser_nodes import NO_POINTS, SceneNodes

POINTS = "/references/points"
SIZE_MM = 2.4
LIFT_MM, LABEL_MM = 1.0, 4.0  # above the outer boundary


class ReferencesLayer(Layer):
    """Draws the reference points of step 9; doubtful ones are orange and labelled so."""

    layer = "references"

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._labels = 0
        self._rows: tuple[ReferenceRow, ...] = ()

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the points where they, what is said of them, or the region are others."""
        if changed(old, new, "static_scene", "session"):
            rows = reference_rows(new.session)
            moved = changed(old, new, "static_scene", "session.captures.references")
            if moved or rows != self._rows:
                self._rows = rows
                self._draw(new)
        for node in (POINTS, *map(_label, range(self._labels))):
            self.nodes.show(node, self.shown(new))

    def _draw(self, new: Snapshot) -> None:
        held, rows = new.session.captures.references, self._rows
        places = NO_POINTS if held is None else held.places_base
        up = lift(new, 1.0)
        colors = np.array([PURPLE if row.counts else ORANGE for row in rows], dtype=np.uint8)
        self.nodes.cloud(POINTS, places + LIFT_MM * up, colors.reshape(-1, 3), size_mm=SIZE_MM)
        for row, place in zip(rows, places, strict=True):
            self.nodes.label(_label(row.number), label_words(row), place + LABEL_MM * up)
        for number in range(len(rows), self._labels):
            self.nodes.remove(_label(number))
        self._labels = len(rows)


def label_words(row: ReferenceRow) -> str:
    """Return number and caliper of a point, and how far the echo is from it where that is known."""
    words = f"{row.number + 1}: {row.caliper_mm:.2f} mm"
    if row.off_mm is not None:
        words += f", echo {row.off_mm:+.2f}"
    return words if row.counts else f"{words} doubtful"


def _label(number: int) -> str:
    return f"/references/label{number}"
