"""Cut plane of the drawn skull, and meshes clipped at a plane. Base frame, mm."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3
from rona_core.geometry.mesh import Mesh
from rona_ui.presentation.camera import SURGEON
from rona_ui.presentation.colors import VERMILLION, WHITE, Rgb
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.viser_nodes import NO_LINES, SceneNodes

STEEPEST = 0.9  # cosine to the region's normal from which an axis says nothing about the region


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Cut plane; the side its unit normal points to is removed."""

    point_base: Vector3
    normal_base: Vector3

    def heights_mm(self, points_base: Floats) -> Floats:
        """Return how far each point (n, 3) lies in front of the plane, negative behind it."""
        return (points_base - self.point_base) @ self.normal_base


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Intersections of a plane with the edges of a mesh, two for each cut triangle."""

    start: Ints  # (e,) vertex at one end of each edge
    end: Ints  # (e,) vertex at the other
    share: Floats  # (e,) of the way from start to end, 0 to 1
    corners: Ints  # (k, 3) triangles that are cut, the corner alone on its side first
    edges: Ints  # (k, 2) edges from that corner to the second and to the third
    one_kept: Bools  # (k,) that corner is what remains; else the other two are

    def points(self, vertices: Floats) -> Floats:
        """Return the places (e, 3) on edges between vertices (n, 3)."""
        from_start = vertices[self.end] - vertices[self.start]
        return vertices[self.start] + self.share[:, None] * from_start

    def rim_base(self, vertices_base: Floats) -> Floats:
        """Return the cut as one segment for each triangle, (k, 2, 3)."""
        return self.points(vertices_base)[self.edges]


def cut_key(snapshot: Snapshot) -> tuple[str, float] | None:
    """Return what the plane depends on besides the backdrop; None while nothing is cut.

    While it is drawn on, the skull is whole, so that every place can be pointed at.
    """
    view = snapshot.view
    if view.cut_direction == "off" or view.drawing is not None or snapshot.static_scene is None:
        return None
    return view.cut_direction, view.cut_offset_mm


def cut_plane(snapshot: Snapshot) -> Plane | None:
    """Return the plane of a picture, upright on the region; None while nothing is cut.

    "lengthwise" runs from front to back, "crosswise" at right angles to it. The half towards the
    camera of the region is taken away, and the more, the larger ``slice_mm`` is.
    """
    if cut_key(snapshot) is None or snapshot.static_scene is None:
        return None
    center, normal = (
        snapshot.static_scene.region_center_base,
        snapshot.static_scene.region_normal_base,
    )
    along = lengthwise(snapshot.static_scene)
    across = np.cross(normal, along)
    away = across if snapshot.view.cut_direction == "lengthwise" else along
    if away @ SURGEON < 0.0:
        away = -away
    return Plane(center - snapshot.view.cut_offset_mm * away, away)


def lengthwise(static_scene: StaticScene) -> Vector3:
    """Return the unit direction (3,) in the plane of the region that runs from back to front.

    Where the axes of the head are not known, y of the base stands for the front; where the region
    lies on the front or back itself, the top of the head does (z of the base).
    """
    axes = np.eye(3) if static_scene.head_axes_base is None else static_scene.head_axes_base
    normal = static_scene.region_normal_base
    front = axes[:, 1] if abs(axes[:, 1] @ normal) < STEEPEST else axes[:, 2]
    along = front - (front @ normal) * normal
    return along / np.linalg.norm(along)


def crossings(mesh: Mesh, plane: Plane) -> Crossings:
    """Return where a plane goes through a mesh."""
    n, faces = len(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)
    height = plane.heights_mm(mesh.vertices)
    kept = height < 0.0
    count = kept[faces].sum(axis=1)
    mixed = (count == 1) | (count == 2)
    one, cut_faces = count[mixed] == 1, faces[mixed]
    lone = np.argmax(kept[cut_faces] == one[:, None], axis=1)
    corners = np.take_along_axis(cut_faces, (lone[:, None] + np.arange(3)) % 3, axis=1)
    first, others = corners[:, :1], corners[:, 1:]
    low, high = np.minimum(first, others), np.maximum(first, others)
    keys, edges = np.unique(low * n + high, return_inverse=True)
    start, end = np.divmod(keys, max(n, 1))
    share = height[start] / (height[start] - height[end])
    return Crossings(start, end, share, corners, edges.reshape(-1, 2), one)


def cut(mesh: Mesh, plane: Plane) -> Mesh:
    """Return the part of a mesh behind a plane; triangles that it goes through are clipped.

    New vertices are shared by the triangles on both sides of an edge, vertices that are no longer
    used are left out, and triangles keep their sense of rotation.
    """
    faces, found = np.asarray(mesh.faces, dtype=np.int64), crossings(mesh, plane)
    whole = faces[(plane.heights_mm(mesh.vertices)[faces] < 0.0).all(axis=1)]
    (a, b, c), (ab, ac) = found.corners.T, len(mesh.vertices) + found.edges.T
    one, two = found.one_kept, ~found.one_kept
    clipped = (
        whole,
        np.column_stack((a, ab, ac))[one],
        np.column_stack((ab, b, c))[two],
        np.column_stack((ab, c, ac))[two],
    )
    vertices = np.concatenate((mesh.vertices, found.points(mesh.vertices)))
    return _used(vertices, np.concatenate(clipped))


def _used(vertices: Floats, faces: Ints) -> Mesh:
    """Return a mesh without the vertices that no triangle has."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    return Mesh(vertices[used], (np.cumsum(used) - 1)[faces])


def draw_cut(
    nodes: SceneNodes,
    names: tuple[str, str],
    mesh: Mesh | None,
    color: Rgb,
    plane: Plane | None,
    opacity: float | None = None,
) -> None:
    """Draw what the cut leaves of a mesh, and its outline in the cut; None draws nothing."""
    body, outline = names
    if mesh is None:
        nodes.remove(body)
        nodes.remove(outline)
        return
    rim = NO_LINES
    if plane is not None:
        rim = crossings(mesh, plane).rim_base(mesh.vertices)
        mesh = cut(mesh, plane)
    if len(mesh.faces):
        nodes.mesh(body, mesh, color, opacity=opacity, side="double")
    else:
        nodes.remove(body)
    nodes.lines(outline, rim, WHITE if opacity is None else VERMILLION, width_px=3.0)
