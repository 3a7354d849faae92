"""The tracker: its stand, its volume, its lines of sight, and names of what is drawn."""

from typing import Literal

import numpy as np
import trimesh
from trimesh.transformations import translation_matrix

from rona_core.devices.samples import WITH_POSE, TrackerFrame
from rona_core.devices.trackers import GEOMETRIES, VOLUMES, Volume
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.solids import merged, rod
from rona_core.robot.kinematics.catalog import robot_model
from rona_ui.presentation.colors import GREEN, STEEL, VERMILLION, Rgb
from rona_ui.presentation.snapshot import Snapshot, changed, shown_joints, shows_roll_preview
from rona_ui.scene.viser_nodes import NO_LINES, Layer, SceneNodes, segments

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


SEEN, HIDDEN = "/sight/seen", "/sight/hidden"
DASH_MM, SHARE = 60.0, 0.5  # of hidden lines: not by colour alone
Sight = Literal["seen", "hidden"]
DRAWN_AS: tuple[tuple[Sight, str, Rgb], ...] = (
    ("seen", SEEN, GREEN),
    ("hidden", HIDDEN, VERMILLION),
)


class SightLayer(Layer):
    """Draws what the newest frame of the tracker says of the tools that are drawn."""

    layer = "sight"
    names = (SEEN, HIDDEN)

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._drawn: dict[str, Floats] = {}

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw where frame, tools or tracker are others."""
        parts = ("static_scene", "frame", "live.joints", "T_base_pointermarker", "view", "busy")
        if changed(old, new, *parts, "session.setup"):
            lines = lines_of_sight(new)
            for kind, name, color in DRAWN_AS:
                if not np.array_equal(self._drawn.get(name, NO_LINES), lines[kind]):
                    self._drawn[name] = lines[kind]
                    pairs = lines[kind] if kind == "seen" else dashed(lines[kind])
                    self.nodes.lines(name, pairs, color, width_px=1.6)
        for name in self.names:
            self.nodes.show(name, self.shown(new))


def lines_of_sight(snapshot: Snapshot) -> dict[Sight, Floats]:
    """Return segments (n, 2, 3) in ``base`` from both lenses to each drawn marker body."""
    scene, frame = snapshot.static_scene, snapshot.frame
    found: dict[Sight, list[Floats]] = {"seen": [], "hidden": []}
    if scene is not None and frame is not None:
        lenses = scene.T_base_tracker @ LENSES_TRACKER
        for tool, place in marker_places(snapshot).items():
            kind = sight_of(frame, tool)
            if kind is not None:
                found[kind] += [np.stack((lens, place)) for lens in lenses]
    return {kind: np.array(pairs) if pairs else NO_LINES for kind, pairs in found.items()}


def sight_of(frame: TrackerFrame, tool: str) -> Sight | None:
    """Return whether the tracker sees a tool; None where it does not look for it."""
    sample = frame.tool(tool)
    if sample is None:
        return None
    return "seen" if sample.status in WITH_POSE else "hidden"


def marker_places(snapshot: Snapshot) -> dict[str, Vector3]:
    """Return the middle (3,) of each drawn marker body in ``base`` by its tool.

    The tool of the robot is left out while the robot is drawn where it is not.
    """
    places: dict[str, Vector3] = {}
    scene, q_rad = snapshot.static_scene, shown_joints(snapshot)
    elsewhere = snapshot.view.cursor is not None or shows_roll_preview(snapshot)
    if q_rad is not None and not (elsewhere and not snapshot.busy):
        model = robot_model(snapshot.session.setup.devices.robot.model)
        T_base_flange = model.joint_poses(q_rad)[6]
        places["toolmarker"] = (T_base_flange @ model.T_flange_toolmarker).translation
    if scene is not None and scene.T_base_basemarker is not None:
        places["basemarker"] = scene.T_base_basemarker.translation
    if snapshot.T_base_pointermarker is not None:
        held = snapshot.session.setup.devices.pointer
        middle = GEOMETRIES[held].positions_marker.mean(axis=0)
        places[held] = snapshot.T_base_pointermarker @ middle
    return places


def dashed(pairs: Floats) -> Floats:
    """Return segments (n, 2, 3) as dashes (m, 2, 3)."""
    dashes: list[Floats] = []
    for start, end in pairs:
        length = float(np.linalg.norm(end - start))
        count = max(1, int(length / DASH_MM))
        at = np.arange(count)[:, None, None] + np.array((0.0, SHARE))[:, None]
        dashes.append(start + (end - start) * at / count)
    return np.concatenate(dashes) if dashes else NO_LINES


ROOT = "/labels"
MARKERS = {"toolmarker": "Tool marker", "basemarker": "Base marker"}
SIDES = (("Right", 0, 1.0), ("Left", 0, -1.0), ("Front", 1, 1.0), ("Top", 2, 1.0))
OFF_MM = 12.0  # of the names of the sides from the head


class LabelsLayer(Layer):
    """Writes a name at each thing; names of what is hidden or not there are left out."""

    layer = "labels"

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._written: dict[str, tuple[str, Vector3]] = {}

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Write the names anew where something has moved or been hidden."""
        if not self.shown(new):
            if old is not None and self.shown(old):
                self._keep({})
            return
        parts = ("static_scene", "frame", "live.joints", "T_base_pointermarker", "view")
        if changed(old, new, *parts, "session.setup", "session.results"):
            self._keep(labels(new))

    def _keep(self, wanted: dict[str, Vector3]) -> None:
        """Write these names, and remove all others."""
        nodes = {f"{ROOT}/{text.split(':')[0]}": (text, place) for text, place in wanted.items()}
        for name in self.nodes.names():
            if name.startswith(f"{ROOT}/") and name not in nodes:
                self.nodes.remove(name)
        for name, (text, place) in nodes.items():
            before = self._written.get(name)
            if before is None or before[0] != text or not np.array_equal(before[1], place):
                self.nodes.label(name, text, place)
        self._written = nodes


def labels(snapshot: Snapshot) -> dict[str, Vector3]:
    """Return names and their places (3,) in ``base``."""
    scene, view = snapshot.static_scene, snapshot.view
    found: dict[str, Vector3] = {}
    if scene is None:
        return found
    if view.shows("tracker"):
        found["Tracker"] = scene.T_base_tracker @ np.array((0.0, -110.0, 0.0))
        volume = VOLUMES[snapshot.session.setup.devices.tracker.profile]
        found["Tracker volume"] = scene.T_base_tracker @ volume.section(volume.near_mm)[0]
    for tool, place in marker_places(snapshot).items():
        if view.shows("robot" if tool == "toolmarker" else "tracker"):
            seen = None if snapshot.frame is None else sight_of(snapshot.frame, tool)
            name = MARKERS.get(tool, "Pointer")
            found[name if seen is None else f"{name}: {seen}"] = place + (0.0, 0.0, 60.0)
    q_rad = shown_joints(snapshot)
    if view.shows("robot") and q_rad is not None:
        model = robot_model(snapshot.session.setup.devices.robot.model)
        poses = model.joint_poses(q_rad)
        found["Force sensor"] = poses[6] @ np.array((0.0, 0.0, 11.0))
        found["Probe"] = (poses[6] @ model.T_flange_tip).translation
        found["Robot"] = poses[2].translation
    if view.shows("skull") and scene.head_axes_base is not None:
        skull = scene.skull.vertices
        middle = 0.5 * (skull.min(axis=0) + skull.max(axis=0))
        for name, column, sign in SIDES:
            towards = sign * scene.head_axes_base[:, column]
            reach = float(((skull - middle) @ towards).max()) + OFF_MM
            found[name] = middle + reach * towards
    return found
