"""Names of what is drawn, on demand."""

import numpy as np

from rona_core.devices.trackers import VOLUMES
from rona_core.geometry.arrays import Vector3
from rona_core.robot.kinematics.catalog import robot_model
from rona_ui.presentation.shown import shown_joints
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer
from rona_ui.scene.setup.lines_of_sight import marker_places, sight_of
from rona_ui.scene.viser_nodes import SceneNodes

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
        if changed(old, new, *parts, "session.setup"):
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
