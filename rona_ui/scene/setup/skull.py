"""Drawn skull, with a window over the region once it is mapped, clipped at the cut plane."""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.devices.protocols import DrawnHead
from rona_core.geometry.mesh import Mesh
from rona_ui.presentation.colors import BONE, BONE_RIM, SUTURE
from rona_ui.presentation.snapshot import Snapshot, opens_window
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.cut_plane import Plane, crossings, cut, cut_key, cut_plane
from rona_ui.scene.viser_nodes import NO_LINES, Layer, SceneNodes

NODE, RIM = "/skull", "/skull_rim"
FACE, SUTURES = "/head/face", "/head/sutures"
RIM_MM = 3.0  # by which the window is wider than the region
DARKEST = 0.12  # light that still reaches the deepest place of the face


def window_open(snapshot: Snapshot) -> bool:
    """Return whether the skull is shown with a window over the region."""
    view = snapshot.view
    results = snapshot.session.results
    mapped = results.maps is not None or results.sono_maps is not None
    return mapped and opens_window(view)


def shown_head(snapshot: Snapshot) -> DrawnHead | None:
    """Return the head that is drawn in place of the whole outer surface."""
    static_scene, view = snapshot.static_scene, snapshot.view
    shown = view.shows("skull") and view.shows("head")
    return None if static_scene is None or not shown else static_scene.head


class SkullLayer(Layer):
    """Draws the outer surface; under a head only the calvaria of it."""

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
        head = shown_head(snapshot)
        drawn = static_scene if head is None else replace(static_scene, skull=head.calvaria)
        mesh = with_window(drawn) if window_open(snapshot) else drawn.skull
        rim = NO_LINES
        plane = cut_plane(snapshot)
        if plane is not None:
            rim = crossings(mesh, plane).rim_base(mesh.vertices)
            mesh = cut(mesh, plane)
        self._empty = not len(mesh.faces)
        self.nodes.mesh(NODE, drawn.skull if self._empty else mesh, BONE, side="double")
        self.nodes.lines(RIM, rim, BONE_RIM, width_px=2.0)


class HeadLayer(Layer):
    """Draws face and sutures, by which front and sides are known."""

    layer = "head"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw them where the head, its window or its cut has changed."""
        if old is not None and _key(old) == _key(new):
            return
        head = shown_head(new)
        if head is None:
            self.nodes.remove(FACE)
            self.nodes.remove(SUTURES)
            return
        plane, face, shades = cut_plane(new), head.face, head.shades
        if plane is not None:
            face = cut(head.face, plane)
            if len(face.faces):
                shades = head.shades[KDTree(head.face.vertices).query(face.vertices)[1]]
        if len(face.faces):
            shades = DARKEST + (1.0 - DARKEST) * shades
            self.nodes.shaded_mesh(FACE, face, BONE, shades)
        else:
            self.nodes.remove(FACE)
        self.nodes.lines(SUTURES, _sutures(new, head, plane), SUTURE, width_px=1.2)


def _sutures(snapshot: Snapshot, head: DrawnHead, plane: Plane | None) -> np.ndarray:
    """Return the sutures (k, 2, 3) on what is drawn of the calvaria."""
    lines, scene = head.sutures, snapshot.static_scene
    if plane is not None:
        lines = lines[(plane.heights_mm(lines.reshape(-1, 3)).reshape(-1, 2) < 0.0).all(axis=1)]
    if scene is not None and window_open(snapshot):
        apart = np.linalg.norm(lines - scene.region_center_base, axis=2)
        lines = lines[(apart > scene.region_radius_mm + RIM_MM).all(axis=1)]
    return lines


def _key(snapshot: Snapshot) -> tuple[object, ...]:
    drawn = id(snapshot.static_scene), id(shown_head(snapshot))
    return *drawn, window_open(snapshot), cut_key(snapshot)


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
