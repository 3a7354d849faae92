"""Hand-held pointer, its pivot handles, and strokes drawn on the skull by mouse."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from rona_core.devices.settings import SONO
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.session.memo import Memo
from rona_ui.presentation.colors import ORANGE, STEEL
from rona_ui.presentation.mouse_input import starts
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.layer import Layer, lift
from rona_ui.scene.viser_nodes import segments

SHAFT, MARKERS, TIP = "/pointer/shaft", "/pointer/markers", "/pointer/tip"
LINE, PICKS = "/drawing/line", "/drawing/points"
PIVOT_HANDLES = "/pivot_handles"
HANDLES_MM = 400.0  # radius 0.65 of it, about the distance of the markers from the tip
# viser draws each handle as an arc between two axes; turned so, they face the usual camera
HANDLES_START = Pose.from_rotvec((0.0, 0.0, -np.pi / 2.0))
STEP_MM = 2.0  # between places at which a line is led over the skull
LIFT_MM = 0.6  # off the skull, so that a line on it is seen


class PointerLayer(Layer):
    """Draws shaft, marker spheres and tip of the pointer in use."""

    layer = "pointer"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Move the pointer; remove it while it is not in use."""
        pose = new.T_base_pointermarker if self.shown(new) else None
        if pose is None:
            for node in (SHAFT, MARKERS, TIP):
                self.nodes.remove(node)
        elif changed(old, new, "T_base_pointermarker", "view"):
            held = new.session.setup.devices.pointer
            markers, tip = pointer_points(pose, SONO if holds_probe(new) else held)
            hub = markers.mean(axis=0)
            rods = np.concatenate(([np.stack((hub, tip))], [np.stack((hub, m)) for m in markers]))
            self.nodes.lines(SHAFT, rods, STEEL, width_px=4.0)
            self.nodes.cloud(MARKERS, markers, (245, 245, 245), size_mm=7.0)
            self.nodes.cloud(TIP, tip[None], ORANGE, size_mm=2.5)


def holds_probe(snapshot: Snapshot) -> bool:
    """Return whether the handheld tool is the ultrasound probe."""
    return (
        snapshot.busy
        and snapshot.job is not None
        and snapshot.job.activity.startswith("StartHandheld")
    )


def pointer_points(T_base_pointermarker: Pose, pointer: str) -> tuple[Floats, Floats]:
    """Return marker positions (m, 3) and nominal tip (3,) in ``base``, as far as drawing needs."""
    geometry = GEOMETRIES[pointer]
    markers_base = T_base_pointermarker @ geometry.positions_marker
    return markers_base, T_base_pointermarker @ geometry.nominal_tip_marker


class PivotHandlesLayer(Layer):
    """Draws rotation handles at the tip while the pointer is pivoted by hand; never hidden."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Place the handles at the tip at the start; they stay there."""
        pose = new.T_base_pointermarker
        if not new.pivoting_by_hand:
            self.nodes.remove(PIVOT_HANDLES)
        elif pose is not None and PIVOT_HANDLES not in self.nodes.names():
            _, tip_base = pointer_points(pose, new.session.setup.devices.pointer)
            self.nodes.rotation_handles(
                PIVOT_HANDLES, Pose(HANDLES_START.rotation, tip_base), size_mm=HANDLES_MM
            )


def handle_rotation(wxyz: ArrayLike) -> Floats:
    """Return the rotation (4,) wxyz since the start of handles at this orientation, in ``base``."""
    return (Pose.from_wxyz(wxyz) @ HANDLES_START.inv()).wxyz()


class DrawingLayer(Layer):
    """Draws the points clicked on the skull and the line through them."""

    follows = ("view.picks", "view.lifts")

    def draw(self, new: Snapshot) -> None:
        """Follow the picks."""
        points, up = np.array(new.view.picks, dtype=np.float64).reshape(-1, 3), lift(new, LIFT_MM)
        strokes = np.split(points, starts(new.view)[1:])
        lines = [segments(over_skull(stroke, new.static_scene) + up) for stroke in strokes]
        self.nodes.lines(LINE, np.concatenate(lines), ORANGE, width_px=4.0)
        self.nodes.cloud(PICKS, points + up, ORANGE, size_mm=1.0)


_TREES: Memo[KDTree] = Memo(1)  # of the vertices of the drawn skull


def over_skull(points_base: Floats, scene: StaticScene | None) -> Floats:
    """Return the line (m, 3) through points (n, 3), led over the drawn skull between them."""
    if scene is None or len(points_base) < 2:
        return points_base
    lengths = np.linalg.norm(np.diff(points_base, axis=0), axis=1)
    way = np.concatenate(([0.0], np.cumsum(lengths)))
    inner = [np.arange(a + STEP_MM, b, STEP_MM) for a, b in pairwise(way)]
    at = np.sort(np.concatenate((way, *inner)))
    line = np.column_stack([np.interp(at, way, part) for part in points_base.T])
    vertices, normal = scene.skull.vertices, scene.region_normal_base
    nearest = _TREES.get((scene.skull,), lambda: KDTree(vertices)).query(line)[1]
    below = np.maximum((vertices[nearest] - line) @ normal, 0.0)
    return line + below[:, None] * normal
