"""The surface cloud that the pointer has sampled, and the region that is to be scanned."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import PURPLE, SKY
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import segments

CLOUD, REGION = "/surface/cloud", "/region"
MOST_POINTS = 60_000  # drawn; the session keeps all


class CloudLayer(Layer):
    """Draws the surface points."""

    layer = "cloud"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the cloud where it is another one."""
        surface = new.session.results.surface
        if old is None or old.session.results.surface is not surface:
            points = np.zeros((0, 3)) if surface is None else surface.value.points_base
            step = 1 + len(points) // MOST_POINTS
            self.nodes.cloud(CLOUD, points[::step], SKY, size_mm=0.8)
        self.nodes.show(CLOUD, self.shown(new))


class RegionLayer(Layer):
    """Draws the rim of the region as a ring round the place to be scanned."""

    layer = "region"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the ring where the region is another one."""
        static_scene = new.static_scene
        if static_scene is None:
            self.nodes.remove(REGION)
            return
        if old is None or old.static_scene is not static_scene:
            self.nodes.lines(REGION, segments(ring(static_scene)), PURPLE, width_px=3.0)
        self.nodes.show(REGION, self.shown(new))


def ring(static_scene: StaticScene, n: int = 96) -> Floats:
    """Return the rim of the region (n + 1, 3), laid onto the drawn skull."""
    normal, center = static_scene.region_normal_base, static_scene.region_center_base
    across = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    angle = np.linspace(0.0, 2.0 * np.pi, n + 1)[:, None]
    rim = center + static_scene.region_radius_mm * (np.cos(angle) * across + np.sin(angle) * along)
    near = static_scene.skull.vertices - center
    heights, aside = near @ normal, near - (near @ normal)[:, None] * normal
    close = (np.linalg.norm(aside, axis=1) < static_scene.region_radius_mm + 8.0) & (
        heights > -40.0
    )
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
