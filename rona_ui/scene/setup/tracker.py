"""Tracker on its stand, its measuring volume, and the base marker."""

import numpy as np
import trimesh
from trimesh.transformations import translation_matrix

from rona_core.devices.trackers import GEOMETRIES, VOLUMES, Volume
from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.solids import merged, rod
from rona_ui.presentation.colors import STEEL
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import SceneNodes, segments

CAMERA, LENSES, STAND = "/tracker/camera", "/tracker/lenses", "/tracker/stand"
VOLUME, PLATE, SPHERES = "/tracker/volume", "/tracker/plate", "/tracker/spheres"
VOLUME_COLOR = (116, 130, 144)
HOUSING, GLASS = (84, 92, 102), (30, 34, 40)
LENSES_TRACKER = np.array(((-240.0, 0.0, 25.0), (240.0, 0.0, 25.0)))
HOUSING_MM = np.array((600.0, 90.0, 80.0))
POLE_MM, FOOT_MM = 22.0, (320.0, 24.0)  # radius of the pole; radius and height of its foot


class TrackerLayer(Layer):
    """Draws the cameras on their stand and three sections of the measuring volume."""

    layer = "tracker"

    def __init__(self, nodes: SceneNodes, floor_mm: float) -> None:
        super().__init__(nodes)
        self._floor_mm = floor_mm

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the tracker where it stands anew, show or hide it."""
        static_scene = new.static_scene
        if static_scene is None:
            return
        T_base_tracker = static_scene.T_base_tracker
        if changed(old, new, "static_scene"):
            for node, part, color in ((CAMERA, housing(), HOUSING), (LENSES, lenses(), GLASS)):
                self.nodes.mesh(node, Mesh(T_base_tracker @ part.vertices, part.faces), color)
            self.nodes.mesh(STAND, stand(T_base_tracker, self._floor_mm), STEEL)
            if static_scene.T_base_basemarker is not None:
                self._base_marker(static_scene.T_base_basemarker)
        if changed(old, new, "static_scene", "session.setup.devices.tracker.profile"):
            profile = new.session.setup.devices.tracker.profile
            lines = outline(VOLUMES[profile], T_base_tracker)
            self.nodes.lines(VOLUME, lines, VOLUME_COLOR, width_px=1.0)
        for node in (CAMERA, LENSES, STAND, VOLUME, PLATE, SPHERES):
            self.nodes.show(node, self.shown(new))

    def _base_marker(self, T_base_basemarker: Pose) -> None:
        """Draw the marker body on the robot base with the bracket that holds it."""
        points = T_base_basemarker @ GEOMETRIES["basemarker"].positions_marker
        hub = T_base_basemarker.translation
        foot = np.array((0.0, 0.0, hub[2]))
        rods = [np.stack((hub, point)) for point in (*points, foot)]
        self.nodes.lines(PLATE, np.array(rods), STEEL, width_px=4.0)
        self.nodes.cloud(SPHERES, points, (245, 245, 245), size_mm=9.0)


def outline(volume: Volume, T_base_tracker: Pose) -> Floats:
    """Return a volume as segments (n, 2, 3) in ``base``: three sections, four edges."""
    near, far = volume.near_mm, volume.far_mm
    rings = [volume.section(z) for z in (near, 0.5 * (near + far), far)]
    parts = [segments(ring) for ring in rings]
    parts += [np.stack((rings[0][k], rings[2][k]))[None] for k in range(0, 48, 12)]
    pairs = np.concatenate(parts)
    return (T_base_tracker @ pairs.reshape(-1, 3)).reshape(-1, 2, 3)


def housing() -> Mesh:
    """Return the housing of the cameras, its front at z = 0, in ``tracker``."""
    half = 0.5 * HOUSING_MM
    parts = [trimesh.creation.box(2.0 * half, translation_matrix((0.0, 0.0, -half[2])))]
    for x_mm, y_mm, _ in LENSES_TRACKER:
        place = translation_matrix((x_mm, y_mm, 8.0))
        parts.append(trimesh.creation.cylinder(42.0, 16.0, sections=32, transform=place))
    return _sharp(parts)


def lenses() -> Mesh:
    """Return the two lenses, looking along +z, in ``tracker``."""
    return _sharp(
        [
            trimesh.creation.cylinder(
                34.0, 2.0, sections=32, transform=translation_matrix((x, y, 16.5))
            )
            for x, y, _ in LENSES_TRACKER
        ]
    )


def stand(T_base_tracker: Pose, floor_mm: float) -> Mesh:
    """Return pole and foot under the tracker, in ``base``."""
    top = T_base_tracker @ np.array((0.0, 0.0, -HOUSING_MM[2]))
    foot, high_mm = np.array((*top[:2], floor_mm)), FOOT_MM[1]
    pole = rod(foot, top, POLE_MM, around=16)
    plate = rod(foot, foot + (0.0, 0.0, high_mm), FOOT_MM[0], around=32)
    return merged(pole, plate)


def _sharp(parts: list[trimesh.Trimesh]) -> Mesh:
    """Return solids as one mesh with own corners for each face, so that edges stay sharp."""
    corners = np.concatenate([part.triangles for part in parts]).reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))
