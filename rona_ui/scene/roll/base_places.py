"""Reachability map of base poses: floor cells by margin, and the two proposed poses."""

import numpy as np
from numpy.typing import NDArray

from rona_core.app.steps.roll.base_placement import PlacementView, placement_view
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_ui.presentation.colors import BLOCKED, ORANGE, SKY, VERMILLION, viridis
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import SceneNodes, segments

MAP = "/places/map"
MARKS = (("smallest", "nearest pose", ORANGE), ("best", "largest margin", SKY))
CELL_PX, GAP_PX = 24, 1
OPAQUE, FAINT = 225, 110  # of places that seem to work, and of the others
RING_MM, ABOVE_MM = 90.0, 4.0  # radius of the mark; over the floor, so that it is seen


class PlacesLayer(Layer):
    """Draws the map of the last search while it holds."""

    layer = "places"

    def __init__(self, nodes: SceneNodes, floor_mm: float) -> None:
        super().__init__(nodes)
        self._height_mm = floor_mm + ABOVE_MM

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the map where search, robot or path is another one."""
        if (
            old is None
            or old.session.results is not new.session.results
            or old.session.setup is not new.session.setup
        ):
            self._draw(placement_view(new.session))
        for node in (MAP, *(f"/places/{name}" for name, _, _ in MARKS)):
            for part in ("", "/ring", "/label"):
                self.nodes.show(f"{node}{part}", self.shown(new))

    def _draw(self, view: PlacementView | None) -> None:
        self.nodes.remove(MAP)
        for name, words, color in MARKS:
            pose = None if view is None else getattr(view, name)
            self._mark(f"/places/{name}", words, color, pose)
        if view is None:
            return
        cell_mm = np.array((_step(view.x_mm), _step(view.y_mm)))
        middle = np.array((view.x_mm.mean(), view.y_mm.mean(), 0.0))
        place = view.room @ Pose.from_translation(middle)
        lifted = Pose(place.rotation, np.array((*place.translation[:2], self._height_mm)))
        size_mm = cell_mm * (len(view.x_mm), len(view.y_mm))
        self.nodes.image(MAP, place_image(view), lifted, size_mm=(size_mm[0], size_mm[1]))

    def _mark(self, node: str, words: str, color: tuple[int, int, int], pose: Pose | None) -> None:
        """Draw a ring on the floor, a pole up to the base, and an arrow along its x axis."""
        if pose is None:
            for part in ("/ring", "/label"):
                self.nodes.remove(f"{node}{part}")
            return
        self.nodes.lines(f"{node}/ring", base_mark(pose, self._height_mm), color, width_px=5.0)
        self.nodes.label(f"{node}/label", words, pose.translation)


def base_mark(place: Pose, floor_mm: float) -> Floats:
    """Return ring, pole and arrow of a place as segments (n, 2, 3) in ``base``."""
    angles = np.linspace(0.0, 2.0 * np.pi, 33)
    ring = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(33))) * RING_MM
    arrow = np.array(((0.0, 0, 0), (2.4, 0, 0), (1.9, 0.3, 0), (2.4, 0, 0), (1.9, -0.3, 0)))
    lines = [place @ part for part in (ring, arrow * RING_MM)]
    for line in lines:
        line[:, 2] = floor_mm
    foot = np.array((*place.translation[:2], floor_mm))
    return np.concatenate(
        [*(segments(line) for line in lines), np.stack((foot, place.translation))[None]]
    )


def place_image(view: PlacementView) -> NDArray[np.uint8]:
    """Return the cells as a picture (h, w, 4): x to the right, y upwards."""
    works = (view.margins >= 0.0) & ~view.blocked
    top = max(float(view.margins[works].max(initial=0.0)), 1e-9)
    cells = np.zeros((*works.shape, 4), dtype=np.uint8)
    cells[:, :, :3] = VERMILLION
    cells[:, :, 3] = FAINT
    cells[view.blocked, :3] = BLOCKED
    cells[works, :3] = viridis(np.clip(view.margins[works] / top, 0.0, 1.0))
    cells[works, 3] = OPAQUE
    upright = cells.transpose(1, 0, 2)[::-1]
    image = np.repeat(np.repeat(upright, CELL_PX, axis=0), CELL_PX, axis=1)
    gaps = np.arange(CELL_PX) < GAP_PX
    image[np.tile(gaps, upright.shape[0])] = 0
    image[:, np.tile(gaps, upright.shape[1])] = 0
    return np.ascontiguousarray(image)


def _step(ticks_mm: Floats) -> float:
    return float(ticks_mm[1] - ticks_mm[0]) if len(ticks_mm) > 1 else 100.0
