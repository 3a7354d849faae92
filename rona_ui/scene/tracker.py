"""The tracker where the display says it stands, and the outline of its measuring volume."""

import numpy as np

from rona_core.arrays import Floats
from rona_core.devices.protocols import Mesh
from rona_core.geometry.pose import Pose
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import STEEL
from rona_ui.scene.metres import segments
from rona_ui.view_state import Picture

CAMERA, VOLUME, NAME = "/tracker/camera", "/tracker/volume", "/tracker/name"
EXTENT = "/tracker/extent"  # words at the volume
VOLUME_COLOR = (158, 170, 184)
NEAR_MM, FAR_MM, RADIUS_MM = 1400.0, 2400.0, 500.0  # silo along the line of sight (z)
MIDDLE_MM = 0.5 * (NEAR_MM + FAR_MM)


class TrackerLayer(Layer):
    """Draws a bar with two lenses and three rings of the silo."""

    layer = "tracker"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the tracker where it stands anew, show or hide it."""
        backdrop = new.backdrop
        if backdrop is None:
            return
        if old is None or old.backdrop is not backdrop:
            T_base_tracker = backdrop.T_base_tracker
            body = bar()
            self.stage.mesh(CAMERA, Mesh(T_base_tracker @ body.vertices, body.faces), STEEL)
            self.stage.lines(VOLUME, silo(T_base_tracker), VOLUME_COLOR, width_px=1.0)
            self.stage.label(NAME, "Tracker", T_base_tracker @ (0.0, -110.0, 0.0))
            rims = silo(T_base_tracker).reshape(-1, 3)
            self.stage.label(EXTENT, "Tracker volume", rims[np.argmax(rims[:, 2])])
        for node in (CAMERA, VOLUME, NAME, EXTENT):
            self.stage.show(node, self.shown(new))


def silo(T_base_tracker: Pose) -> Floats:
    """Return the measuring volume as segments (n, 2, 3) in ``base``: three rings, four edges."""
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = RADIUS_MM * np.stack((np.cos(angle), np.sin(angle), np.zeros(49)), axis=1)
    parts = [segments(ring + np.array([0.0, 0.0, z])) for z in (NEAR_MM, MIDDLE_MM, FAR_MM)]
    for corner in ring[:48:12]:
        depths = np.array([[0.0, 0.0, NEAR_MM], [0.0, 0.0, FAR_MM]])
        parts.append((corner + depths)[None])
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
