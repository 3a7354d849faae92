"""The surface cloud that the pointer has sampled, and the region that is to be scanned."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import PURPLE, SKY
from rona_ui.scene.viser_nodes import segments
from rona_ui.view_state import Backdrop, Picture

CLOUD, REGION = "/surface/cloud", "/region"
MOST_POINTS = 60_000  # drawn; the session keeps all


class CloudLayer(Layer):
    """Draws the surface points."""

    layer = "cloud"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the cloud where it is another one."""
        surface = new.session.results.surface
        if old is None or old.session.results.surface is not surface:
            points = np.zeros((0, 3)) if surface is None else surface.value.points_base
            step = 1 + len(points) // MOST_POINTS
            self.stage.cloud(CLOUD, points[::step], SKY, size_mm=0.8)
        self.stage.show(CLOUD, self.shown(new))


class RegionLayer(Layer):
    """Draws the rim of the region as a ring round the place to be scanned."""

    layer = "region"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the ring where the region is another one."""
        backdrop = new.backdrop
        if backdrop is None:
            self.stage.remove(REGION)
            return
        if old is None or old.backdrop is not backdrop:
            self.stage.lines(REGION, segments(ring(backdrop)), PURPLE, width_px=3.0)
        self.stage.show(REGION, self.shown(new))


def ring(backdrop: Backdrop, n: int = 96) -> Floats:
    """Return the rim of the region (n + 1, 3), laid onto the drawn skull."""
    normal, center = backdrop.region_normal_base, backdrop.region_center_base
    across = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    angle = np.linspace(0.0, 2.0 * np.pi, n + 1)[:, None]
    rim = center + backdrop.region_radius_mm * (np.cos(angle) * across + np.sin(angle) * along)
    near = backdrop.skull.vertices - center
    heights, aside = near @ normal, near - (near @ normal)[:, None] * normal
    close = (np.linalg.norm(aside, axis=1) < backdrop.region_radius_mm + 8.0) & (heights > -40.0)
    if close.any():
        flat = aside[close]
        for i, place in enumerate(rim - center):
            nearest = int(np.argmin(((flat - place) ** 2).sum(axis=1)))
            rim[i] = center + place + (heights[close][nearest] + 1.0) * normal
        smooth = np.convolve(
            np.pad((rim - center) @ normal, 4, mode="wrap"), np.ones(9) / 9, "valid"
        )
        rim += (smooth - (rim - center) @ normal)[:, None] * normal
    rim[-1] = rim[0]
    return rim
