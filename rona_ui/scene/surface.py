"""Step 4: surface cloud, region to be scanned, and a loaded skull where it is registered."""

import numpy as np
import trimesh

from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull
from rona_ui.presentation.colors import GREEN, PURPLE, SKY, STEEL
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.cut_plane import Plane, crossings
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import NO_LINES, NO_POINTS, segments

CLOUD, REGION, CONTOURS = "/surface/cloud", "/region", "/registered_skull"
STROKE = "/surface/stroke"
MOST_POINTS = 60_000  # drawn; the session keeps all
APART_MM = 12.0  # from contour to contour
LIFT_MM = 0.4  # off the mesh, so that the contours are to be seen where both skulls agree


class CloudLayer(Layer):
    """Draws the surface points; grey while another stroke is recorded."""

    layer = "cloud"
    names = (CLOUD,)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the cloud anew when it is another one, or when a stroke begins or ends."""
        before = old is not None and old.stroke is not None
        if changed(old, new, "session.results.surface") or before != (new.stroke is not None):
            surface = new.session.results.surface
            points = NO_POINTS if surface is None else surface.value.points_base
            color = SKY if new.stroke is None else STEEL
            self.nodes.cloud(CLOUD, thinned(points), color, size_mm=0.8)
        super().render(old, new)


class StrokeLayer(Layer):
    """Draws where the tip of the pointer has been in the stroke under way; never hidden."""

    follows = ("stroke",)

    def draw(self, new: Snapshot) -> None:
        """Draw the stroke."""
        points = NO_POINTS if new.stroke is None else new.stroke
        self.nodes.cloud(STROKE, thinned(points), SKY, size_mm=0.8)


def thinned(points: Floats) -> Floats:
    """Return as many of the points (n, 3) as are drawn."""
    return points[:: 1 + len(points) // MOST_POINTS]


class RegionLayer(Layer):
    """Draws the rim of the region as a ring round the place to be scanned."""

    layer = "region"
    follows = ("static_scene",)
    names = (REGION,)

    def draw(self, new: Snapshot) -> None:
        """Draw the ring."""
        lines = NO_LINES if new.static_scene is None else segments(ring(new.static_scene))
        self.nodes.lines(REGION, lines, PURPLE, width_px=3.0)


class RegisteredSkullLayer(Layer):
    """Draws the contours of the registered skull, beside the skull as it is drawn."""

    layer = "registered_skull"
    follows = ("session.results.registration", "session.setup.specimen")
    names = (CONTOURS,)

    def draw(self, new: Snapshot) -> None:
        """Draw the contours."""
        self.nodes.lines(CONTOURS, contours(new.session), GREEN, width_px=1.5)


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


def contours(session: Session) -> Floats:
    """Return segments (n, 2, 3) in ``base`` round the registered skull; none without one."""
    registered, skull = session.results.registration, session.setup.specimen
    if registered is None or not isinstance(skull, LoadedSkull):
        return NO_LINES
    vertices = np.asarray(skull.mesh_vertices_skull, dtype=np.float64)
    faces = np.asarray(skull.mesh_faces, dtype=np.int64)
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    mesh = Mesh(vertices + LIFT_MM * normals, faces)
    lines: list[Floats] = []
    for axis in np.eye(3)[:2]:
        heights = mesh.vertices @ axis
        for height in np.arange(heights.min() + APART_MM / 2.0, heights.max(), APART_MM):
            lines.append(crossings(mesh, Plane(height * axis, axis)).rim_base(mesh.vertices))
    T_base_skull = registered.value.T_b_a.inv()
    return (T_base_skull @ np.concatenate(lines).reshape(-1, 3)).reshape(-1, 2, 3)
