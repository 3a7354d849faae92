"""The hand-held pointer while somebody holds it, and what has been drawn on the skull by mouse."""

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.settings import SONO
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import ORANGE, SKY, STEEL
from rona_ui.scene.viser_nodes import segments
from rona_ui.view_state import Picture

SHAFT, MARKERS, TIP = "/pointer/shaft", "/pointer/markers", "/pointer/tip"
LINE, PICKS = "/drawing/line", "/drawing/points"
LIFT_MM = 0.6  # off the skull, so that a line on it is seen


class PointerLayer(Layer):
    """Draws shaft, marker spheres and tip of the pointer in use."""

    layer = "pointer"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Move the pointer; take it away while it lies aside."""
        pose = new.T_base_pointermarker if self.shown(new) else None
        if pose is None:
            for node in (SHAFT, MARKERS, TIP):
                self.stage.remove(node)
        elif old is None or old.T_base_pointermarker is not pose or self.toggled(old, new):
            held = new.session.setup.devices.pointer
            markers, tip = pointer_points(pose, SONO if holds_probe(new) else held)
            hub = markers.mean(axis=0)
            rods = np.concatenate(([np.stack((hub, tip))], [np.stack((hub, m)) for m in markers]))
            self.stage.lines(SHAFT, rods, STEEL, width_px=4.0)
            self.stage.cloud(MARKERS, markers, (245, 245, 245), size_mm=7.0)
            self.stage.cloud(TIP, tip[None], ORANGE, size_mm=2.5)


def holds_probe(picture: Picture) -> bool:
    """Return whether it is the ultrasound probe that somebody holds in the hand."""
    return (
        picture.busy
        and picture.job is not None
        and picture.job.activity.startswith("StartHandheld")
    )


def pointer_points(T_base_pointermarker: Pose, pointer: str) -> tuple[Floats, Floats]:
    """Return marker positions (m, 3) and nominal tip (3,) in ``base``, as far as drawing needs."""
    geometry = GEOMETRIES[pointer]
    markers_base = T_base_pointermarker @ geometry.positions_marker
    return markers_base, T_base_pointermarker @ geometry.nominal_tip_marker


class DrawingLayer(Layer):
    """Draws the places that were clicked on the skull and the line through them."""

    layer = "drawing"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow the picks."""
        if old is not None and old.view.picks is new.view.picks:
            return
        points = np.array(new.view.picks, dtype=np.float64).reshape(-1, 3)
        if len(points) and new.backdrop is not None:
            points = points + LIFT_MM * new.backdrop.region_normal_base
        self.stage.lines(LINE, segments(points), SKY, width_px=4.0)
        self.stage.cloud(PICKS, points, ORANGE, size_mm=1.0)
