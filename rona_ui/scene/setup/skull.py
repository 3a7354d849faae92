"""Drawn skull, with a window over the region once it is mapped, clipped at the cut plane."""

import numpy as np

from rona_core.devices.display import Mesh
from rona_ui.presentation.colors import BONE, BONE_RIM
from rona_ui.presentation.shown import opens_window
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.cut_plane import crossings, cut, cut_key, cut_plane
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import NO_LINES, SceneNodes

NODE, RIM = "/skull", "/skull_rim"
RIM_MM = 3.0  # by which the window is wider than the region


def window_open(snapshot: Snapshot) -> bool:
    """Return whether the skull is shown with a window over the region."""
    view = snapshot.view
    results = snapshot.session.results
    mapped = results.maps is not None or results.sono_maps is not None
    return mapped and opens_window(view)


class SkullLayer(Layer):
    """Draws the outer surface."""

    layer = "skull"

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._empty = False  # the plane has left nothing

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the skull where it, its window or its cut has changed."""
        static_scene = new.static_scene
        if static_scene is None:
            self.nodes.remove(NODE)
            self.nodes.remove(RIM)
            return
        if old is None or _key(old) != _key(new):
            self._draw(new, static_scene)
        self.nodes.show(NODE, self.shown(new) and not self._empty)
        self.nodes.show(RIM, self.shown(new))

    def _draw(self, snapshot: Snapshot, static_scene: StaticScene) -> None:
        """Draw what is left; a node that listens to the mouse stays, though nothing be left."""
        mesh = with_window(static_scene) if window_open(snapshot) else static_scene.skull
        rim = NO_LINES
        plane = cut_plane(snapshot)
        if plane is not None:
            rim = crossings(mesh, plane).rim_base(mesh.vertices)
            mesh = cut(mesh, plane)
        self._empty = not len(mesh.faces)
        self.nodes.mesh(NODE, static_scene.skull if self._empty else mesh, BONE, side="double")
        self.nodes.lines(RIM, rim, BONE_RIM, width_px=2.0)


def _key(snapshot: Snapshot) -> tuple[object, ...]:
    return id(snapshot.static_scene), window_open(snapshot), cut_key(snapshot)


def with_window(static_scene: StaticScene) -> Mesh:
    """Return the skull with a round hole over the region; vertices in it are moved to its rim."""
    skull, normal = static_scene.skull, static_scene.region_normal_base
    from_center = skull.vertices - static_scene.region_center_base
    along = from_center @ normal
    aside = from_center - along[:, None] * normal
    distance = np.linalg.norm(aside, axis=1)
    radius_mm = static_scene.region_radius_mm + RIM_MM
    inside = (distance < radius_mm) & (np.abs(along) < radius_mm)
    faces = skull.faces[~inside[skull.faces].all(axis=1)]
    vertices = np.array(skull.vertices)
    share = radius_mm / np.maximum(distance[inside], 1e-9)
    vertices[inside] += (share - 1.0)[:, None] * aside[inside]
    return Mesh(vertices, faces)
