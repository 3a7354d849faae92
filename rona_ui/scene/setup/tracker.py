"""Tracker, its measuring volume, and the base marker."""

import numpy as np
import trimesh
from trimesh.transformations import translation_matrix

from rona_core.devices.display import Mesh
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.tracker_volumes import VOLUMES, Volume
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_ui.presentation.colors import STEEL
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import segments

CAMERA, VOLUME, NAME = "/tracker/camera", "/tracker/volume", "/tracker/name"
EXTENT = "/tracker/extent"  # words at the volume
PLATE, SPHERES, BASE = "/tracker/plate", "/tracker/spheres", "/tracker/basemarker"
VOLUME_COLOR = (158, 170, 184)


class TrackerLayer(Layer):
    """Draws a bar with two lenses and three sections of the measuring volume."""

    layer = "tracker"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the tracker where it stands anew, show or hide it."""
        static_scene = new.static_scene
        if static_scene is None:
            return
        T_base_tracker = static_scene.T_base_tracker
        if changed(old, new, "static_scene"):
            body = bar()
            self.nodes.mesh(CAMERA, Mesh(T_base_tracker @ body.vertices, body.faces), STEEL)
            self.nodes.label(NAME, "Tracker", T_base_tracker @ (0.0, -110.0, 0.0))
            if static_scene.T_base_basemarker is not None:
                self._base_marker(static_scene.T_base_basemarker)
        if changed(old, new, "static_scene", "session.setup.devices.tracker.profile"):
            profile = new.session.setup.devices.tracker.profile
            lines = outline(VOLUMES[profile], T_base_tracker)
            self.nodes.lines(VOLUME, lines, VOLUME_COLOR, width_px=1.0)
            rims = lines.reshape(-1, 3)
            self.nodes.label(EXTENT, "Tracker volume", rims[np.argmax(rims[:, 2])])
        for node in (CAMERA, VOLUME, NAME, EXTENT, PLATE, SPHERES, BASE):
            self.nodes.show(node, self.shown(new))

    def _base_marker(self, T_base_basemarker: Pose) -> None:
        """Draw the marker body on the robot base with the bracket that holds it."""
        points = T_base_basemarker @ GEOMETRIES["basemarker"].positions_marker
        hub = T_base_basemarker.translation
        foot = np.array((0.0, 0.0, hub[2]))
        rods = [np.stack((hub, point)) for point in (*points, foot)]
        self.nodes.lines(PLATE, np.array(rods), STEEL, width_px=4.0)
        self.nodes.cloud(SPHERES, points, (245, 245, 245), size_mm=9.0)
        self.nodes.label(BASE, "Base marker", hub + (0.0, 0.0, 90.0))


def outline(volume: Volume, T_base_tracker: Pose) -> Floats:
    """Return a volume as segments (n, 2, 3) in ``base``: three sections, four edges."""
    near, far = volume.near_mm, volume.far_mm
    rings = [volume.section(z) for z in (near, 0.5 * (near + far), far)]
    parts = [segments(ring) for ring in rings]
    parts += [np.stack((rings[0][k], rings[2][k]))[None] for k in range(0, 48, 12)]
    pairs = np.concatenate(parts)
    return (T_base_tracker @ pairs.reshape(-1, 3)).reshape(-1, 2, 3)


def bar() -> Mesh:
    """Return a camera bar with two lenses, looking along +z, in ``tracker``."""
    parts = [trimesh.creation.box((600.0, 90.0, 80.0), translation_matrix((0.0, 0.0, -40.0)))]
    for x_mm in (-240.0, 240.0):
        place = translation_matrix((x_mm, 0.0, 12.5))
        parts.append(trimesh.creation.cylinder(36.0, 25.0, sections=24, transform=place))
    # own corners for each face, so that edges stay sharp
    corners = np.concatenate([part.triangles for part in parts]).reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))
