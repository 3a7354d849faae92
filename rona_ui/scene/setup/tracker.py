"""The tracker where the display says it stands, its measuring volume, and the base marker."""

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.protocols import Mesh
from rona_core.devices.tracker_volumes import VOLUMES, Volume
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_ui.presentation.colors import STEEL
from rona_ui.presentation.snapshot import Snapshot
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
        profile = new.session.setup.devices.tracker.profile
        T_base_tracker = static_scene.T_base_tracker
        stands = old is not None and old.static_scene is static_scene
        if not stands:
            body = bar()
            self.nodes.mesh(CAMERA, Mesh(T_base_tracker @ body.vertices, body.faces), STEEL)
            self.nodes.label(NAME, "Tracker", T_base_tracker @ (0.0, -110.0, 0.0))
            if static_scene.T_base_basemarker is not None:
                self._base_marker(static_scene.T_base_basemarker)
        if old is None or not stands or old.session.setup.devices.tracker.profile != profile:
            lines = outline(VOLUMES[profile], T_base_tracker)
            self.nodes.lines(VOLUME, lines, VOLUME_COLOR, width_px=1.0)
            rims = lines.reshape(-1, 3)
            self.nodes.label(EXTENT, "Tracker volume", rims[np.argmax(rims[:, 2])])
        for node in (CAMERA, VOLUME, NAME, EXTENT):
            self.nodes.show(node, self.shown(new))
        if static_scene.T_base_basemarker is not None:
            for node in (PLATE, SPHERES, BASE):
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
    parts = [_box((0.0, 0.0, -40.0), (300.0, 45.0, 40.0))]
    parts += [_lens(x) for x in (-240.0, 240.0)]
    vertices, faces, count = [], [], 0
    for part in parts:
        vertices.append(part.vertices)
        faces.append(part.faces + count)
        count += len(part.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def _box(center: tuple[float, float, float], half: tuple[float, float, float]) -> Mesh:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    corners = np.asarray(center) + signs * np.asarray(half)
    triangles = corners[np.array(faces)]  # own corners for each face, so that edges stay sharp
    return Mesh(triangles.reshape(-1, 3), np.arange(36, dtype=np.int64).reshape(-1, 3))


def _lens(x_mm: float, radius_mm: float = 36.0, n: int = 24) -> Mesh:
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    rim = np.stack((x_mm + radius_mm * np.cos(angle), radius_mm * np.sin(angle)), axis=1)
    back = np.column_stack((rim, np.zeros(n)))
    front = np.column_stack((rim, np.full(n, 25.0)))
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate((np.stack((i, j, n + j), 1), np.stack((i, n + j, n + i), 1)))
    cap = np.stack((np.full(n, 2 * n), n + i, n + j), 1)
    vertices = np.concatenate((back, front, [[x_mm, 0.0, 25.0]]))
    return Mesh(vertices, np.concatenate((sides, cap)).astype(np.int64))
