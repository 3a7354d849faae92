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
    return picture.view.cut and picture.session.results.maps is not None


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
    """Return the skull without the faces over the region."""
    skull = backdrop.skull
    centers = skull.vertices[skull.faces].mean(axis=1) - backdrop.region_center_base
    radius_mm = backdrop.region_radius_mm + RIM_MM
    along = centers @ backdrop.region_normal_base
    aside = np.linalg.norm(centers - along[:, None] * backdrop.region_normal_base, axis=1)
    keep = (aside > radius_mm) | (np.abs(along) > radius_mm)
    return Mesh(skull.vertices, skull.faces[keep])
