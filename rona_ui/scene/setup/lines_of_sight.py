"""Lines of sight from the tracker to each marker body: green where it is seen, red where not."""

from typing import Literal

import numpy as np

from rona_core.devices.samples import WITH_POSE, TrackerFrame
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.robot.kinematics.catalog import robot_model
from rona_ui.presentation.colors import GREEN, VERMILLION, Rgb
from rona_ui.presentation.shown import shown_joints, shows_roll_preview
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer
from rona_ui.scene.setup.tracker import LENSES_TRACKER
from rona_ui.scene.viser_nodes import NO_LINES, SceneNodes

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
