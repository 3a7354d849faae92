"""The skull for the eye, with a window over the scanned region once it has been mapped."""

import numpy as np

from rona_core.devices.protocols import Mesh
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import BONE
from rona_ui.view_state import Backdrop, Picture

NODE = "/skull"
RIM_MM = 3.0  # by which the window is wider than the region


def window_open(picture: Picture) -> bool:
    """Return whether the skull is shown with a window over the region."""
    view = picture.view
    return view.step == "maps" and view.cut and picture.session.results.maps is not None


class SkullLayer(Layer):
    """Draws the outer surface."""

    layer = "skull"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the skull where it or its window has changed."""
        backdrop = new.backdrop
        if backdrop is None:
            self.stage.remove(NODE)
            return
        before = None if old is None else old.backdrop
        if backdrop is not before or old is None or window_open(old) != window_open(new):
            mesh = opened(backdrop) if window_open(new) else backdrop.skull
            self.stage.mesh(NODE, mesh, BONE, side="double")
        self.stage.show(NODE, self.shown(new))


def opened(backdrop: Backdrop) -> Mesh:
    """Return the skull with a round hole over the region; vertices in it are moved to its rim."""
    skull, normal = backdrop.skull, backdrop.region_normal_base
    from_center = skull.vertices - backdrop.region_center_base
    along = from_center @ normal
    aside = from_center - along[:, None] * normal
    distance = np.linalg.norm(aside, axis=1)
    radius_mm = backdrop.region_radius_mm + RIM_MM
    inside = (distance < radius_mm) & (np.abs(along) < radius_mm)
    faces = skull.faces[~inside[skull.faces].all(axis=1)]
    vertices = np.array(skull.vertices)
    share = radius_mm / np.maximum(distance[inside], 1e-9)
    vertices[inside] += (share - 1.0)[:, None] * aside[inside]
    return Mesh(vertices, faces)
