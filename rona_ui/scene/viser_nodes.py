"""Layers, their nodes of viser by name (millimetres become viser's metres), places on the bone."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, ClassVar, TypeVar

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.session.memo import Memo
from rona_ui.presentation.colors import Rgb
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.line_colors import sent_color, sent_colors
from rona_ui.viewer.unseen_node import UnseenNode

M_PER_MM = 0.001
HANDLE_PX = 5.0  # width of a handle; the viewer takes a press up to twice as far beside it
UPRIGHT = Pose.from_rotvec((np.pi, 0.0, 0.0))  # the viewer counts the rows of pictures along +y
DOT_MM = 0.03  # length of the line that a dot of some pixels is drawn by
GREYED = (110.0, 0.3)  # grey of something black that is stale, and the share of its light beyond
NO_POINTS, NO_LINES = np.zeros((0, 3)), np.zeros((0, 2, 3))
Colors = Rgb | NDArray[np.uint8]
Scalar = TypeVar("Scalar", bound=np.generic)


def metres(lengths_mm: ArrayLike) -> NDArray[np.float32]:
    """Return lengths or positions in metres, as single precision."""
    return (np.asarray(lengths_mm, dtype=np.float64) * M_PER_MM).astype(np.float32)


def segments(points: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return a polyline (n, 3), or its colours, as segments (n - 1, 2, 3)."""
    return np.stack((points[:-1], points[1:]), axis=1)


def grid_faces(ok: Bools) -> Ints:
    """Return triangles (n, 3) of a grid of points (nx, ny), counted row by row, all four ``ok``."""
    number = np.arange(ok.size, dtype=np.int64).reshape(ok.shape)
    whole = ok[:-1, :-1] & ok[1:, :-1] & ok[1:, 1:] & ok[:-1, 1:]
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    a, b, c, d = (corner[whole] for corner in corners)
    return np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))


def greyed(colors: Colors) -> NDArray[np.uint8]:
    """Return colours as light greys, the lighter the more light they have."""
    light = np.asarray(colors, dtype=np.float64) @ (0.299, 0.587, 0.114)
    grey = np.round(GREYED[0] + GREYED[1] * light).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=-1)


class SceneNodes:
    """Scene nodes of one browser by name. Everything that goes in is in mm and in ``base``."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self._nodes: dict[str, Any] = {}
        self._waiting = False
        self._greyed = False

    def names(self) -> frozenset[str]:
        """Return the names of the nodes that exist, sent or not."""
        return frozenset(self._nodes)

    def node(self, name: str) -> Any:
        """Return the viewer's handle of a node, to listen to the mouse; None while it has none."""
        node = self._nodes.get(name)
        return None if isinstance(node, UnseenNode) else node

    @contextmanager
    def sent_when_seen(self) -> Generator[None]:
        """Send new nodes at the end, and those that are hidden then not before they are shown."""
        self._waiting = True
        try:
            yield
        finally:
            self._waiting = False
            for name in list(self._nodes):
                if all(self._is_seen(each) for each in _with_parents(name)):
                    self._send(name)

    @contextmanager
    def drawn_as_stale(self, stale: bool) -> Generator[None]:
        """Draw all that is drawn meanwhile in grey, if it is stale."""
        self._greyed = stale
        try:
            yield
        finally:
            self._greyed = False

    def _one_color(self, color: Rgb) -> Rgb:
        """Return a colour as it is to be drawn now."""
        if not self._greyed:
            return color
        r, g, b = greyed(color).tolist()
        return r, g, b

    def _is_seen(self, name: str) -> bool:
        node = self._nodes.get(name)
        return not isinstance(node, UnseenNode) or node.visible

    def _add(self, kind: str, name: str, **options: Any) -> None:
        self._nodes[name] = UnseenNode(kind, options)
        if not self._waiting:
            self._send(name)

    def _send(self, name: str) -> None:
        node = self._nodes[name]
        if isinstance(node, UnseenNode):
            self._nodes[name] = getattr(self._scene, f"add_{node.kind}")(name, **node.options)

    def mesh(
        self,
        name: str,
        mesh: Mesh,
        color: Rgb,
        *,
        opacity: float | None = None,
        side: str = "front",
    ) -> None:
        """Draw a shaded mesh; its opacity is fixed when it is drawn first."""
        vertices, faces = metres(mesh.vertices), np.asarray(mesh.faces, dtype=np.uint32)
        color = self._one_color(color)
        node = self._nodes.get(name)
        if node is None:
            mesh_options = {"color": color, "opacity": opacity, "side": side}
            self._add("mesh_simple", name, vertices=vertices, faces=faces, **mesh_options)
        else:
            node.vertices, node.faces, node.color = vertices, faces, color

    def shaded_mesh(self, name: str, mesh: Mesh, color: Rgb, shades: Floats) -> None:
        """Draw a mesh anew, from both sides, darker where its shade (n,) from 0 to 1 is less."""
        self.remove(name)
        linear = (np.array(color) / 255.0) ** 2.2 * shades[:, None]  # glTF counts light, not sRGB
        colors = np.column_stack((np.round(255.0 * linear), np.full(len(shades), 255.0)))
        matt = TextureVisuals(material=PBRMaterial(metallicFactor=0.0, doubleSided=True))
        matt.vertex_attributes["color"] = colors.astype(np.uint8)
        solid = trimesh.Trimesh(metres(mesh.vertices), mesh.faces, visual=matt, process=False)
        _ = solid.vertex_normals  # once known they are sent; without them each face is flat
        self._add("mesh_trimesh", name, mesh=solid)

    def paint(self, name: str, color: Rgb) -> None:
        """Give a mesh that exists another colour."""
        self._nodes[name].color = color

    def cloud(self, name: str, points: Floats, colors: Colors, *, size_mm: float = 1.0) -> None:
        """Draw unlit points (n, 3) of a size in mm, in the colours of the colour bar."""
        if not len(points):
            self.remove(name)
            return
        drawn = greyed(colors) if self._greyed else colors
        size, colored = float(M_PER_MM * size_mm), _colors(drawn, (len(points), 3))
        node = self._nodes.get(name)
        if node is None:
            self._add(
                "point_cloud",
                name,
                points=metres(points),
                colors=colored,
                point_size=size,
                point_shape="circle",
                point_shading="flat",
                precision="float32",
            )
        else:
            node.points, node.colors, node.point_size = metres(points), colored, size

    def dots(self, name: str, points: Floats, colors: Colors, *, size_px: float) -> None:
        """Draw unlit points (n, 3) of a size in pixels; see :meth:`lines`.

        The viewer has no points of so many pixels, but lines, and their ends are round.
        """
        pairs = np.stack((points, points + DOT_MM / np.sqrt(3.0)), axis=1)
        each = np.asarray(colors, dtype=np.uint8)
        self.lines(name, pairs, each if each.ndim == 1 else each[:, None], width_px=size_px)

    def lines(
        self,
        name: str,
        pairs: Floats,
        colors: Colors,
        *,
        width_px: float = 2.0,
        width_mm: float | None = None,
    ) -> None:
        """Draw unlit line segments (n, 2, 3) of a width in pixels or in mm.

        Colours are one for all, one for each segment (n, 1, 3), or one for each end (n, 2, 3).
        """
        if not len(pairs):
            self.remove(name)
            return
        drawn = np.asarray(greyed(colors) if self._greyed else colors, dtype=np.uint8)
        if drawn.ndim > 1:
            self.remove(name)  # points and colours change in one step
            drawn = np.ascontiguousarray(np.broadcast_to(sent_colors(drawn), pairs.shape))
        else:
            drawn = sent_color(drawn)
        node = self._nodes.get(name)
        if node is None:
            self._add(
                "line_segments",
                name,
                points=metres(pairs),
                colors=drawn,
                thickness=width_px if width_mm is None else float(M_PER_MM * width_mm),
                thickness_units="screen" if width_mm is None else "world",
            )
        else:
            node.points, node.colors = metres(pairs), drawn

    def frame(self, name: str, pose: Pose) -> None:
        """Place an invisible parent for other nodes."""
        node = self._nodes.get(name)
        if node is None:
            self._add("frame", name, show_axes=False)
            node = self._nodes[name]
        node.wxyz, node.position = pose.wxyz(), metres(pose.translation)

    def label(self, name: str, text: str, place: ArrayLike) -> None:
        """Write a short text at a place."""
        node = self._nodes.get(name)
        if node is None:
            self._add("label", name, text=text, position=metres(place))
        else:
            node.text, node.position = text, metres(place)

    def floor(self, name: str, height_mm: float) -> None:
        """Draw the floor as a grid of 100 mm cells."""
        self._add(
            "grid",
            name,
            width=6.0,
            height=6.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(86, 94, 104),
            section_color=(108, 117, 128),
            cell_thickness=0.6,
            section_thickness=1.0,
            fade_distance=5.0,
            shadow_opacity=0.0,
            position=(0.0, 0.0, float(M_PER_MM * height_mm)),
        )

    def image(
        self, name: str, picture: NDArray[np.uint8], pose: Pose, *, size_mm: tuple[float, float]
    ) -> None:
        """Lay a picture (h, w, 4) flat into the x-y plane of a pose: x to its right, y upwards."""
        self.remove(name)
        self._add(
            "image",
            name,
            image=picture,
            render_width=M_PER_MM * size_mm[0],
            render_height=M_PER_MM * size_mm[1],
            format="png",
            cast_shadow=False,
            receive_shadow=False,
            wxyz=(pose @ UPRIGHT).wxyz(),
            position=metres(pose.translation),
        )

    def rotation_handles(self, name: str, pose: Pose, *, size_mm: float) -> None:
        """Draw handles that rotate a pose about its axes when they are dragged."""
        self.remove(name)
        self._add(
            "transform_controls",
            name,
            scale=M_PER_MM * size_mm,
            disable_axes=True,
            disable_sliders=True,
            depth_test=False,
            line_width=HANDLE_PX,
            wxyz=pose.wxyz(),
            position=metres(pose.translation),
        )

    def show(self, name: str, visible: bool) -> None:
        """Show or hide a node, if it exists."""
        node = self._nodes.get(name)
        if node is not None:
            node.visible = visible

    def remove(self, name: str) -> None:
        """Remove a node, if it exists."""
        node = self._nodes.pop(name, None)
        if node is not None:
            node.remove()


def _with_parents(name: str) -> list[str]:
    """Return a node's name and those of its parents."""
    parts = name.split("/")
    return ["/".join(parts[:n]) for n in range(2, len(parts) + 1)]


def _colors(colors: Colors, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return one colour per point: a change of their number then never meets an old array."""
    each = np.asarray(colors, dtype=np.uint8)
    return np.ascontiguousarray(np.broadcast_to(each, shape))


class Layer:
    """Nodes under one name of ``view_state.LAYERS``, shown or hidden together.

    It draws one kind of object from snapshots; it sends no messages and keeps no session.
    """

    layer: str = ""
    follows: ClassVar[tuple[str, ...]] = ()  # parts of the snapshot that it is drawn from
    names: ClassVar[tuple[str, ...]] = ()  # of the nodes that are shown with the layer
    results: ClassVar[tuple[str, ...]] = ()  # that it draws, in grey where one of them is stale

    def __init__(self, nodes: SceneNodes) -> None:
        self.nodes = nodes

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw what differs from ``old``, None for the first time; show it where switched on."""
        if changed(old, new, *self.follows):
            self.draw(new)
        for name in self.names:
            self.nodes.show(name, self.shown(new))

    def draw(self, new: Snapshot) -> None:
        """Draw all nodes anew."""

    def stale(self, snapshot: Snapshot) -> bool:
        """Return whether a result that the layer draws is stale: then it is drawn in grey."""
        return any(stale_reason(name, snapshot.session) for name in self.results)

    def shown(self, snapshot: Snapshot) -> bool:
        """Return whether the layer is switched on in this browser."""
        return snapshot.view.shows(self.layer)


def lift(snapshot: Snapshot, height_mm: float) -> Vector3:
    """Return the offset (3,) that lifts things off the region, so that the skull does not hide."""
    scene = snapshot.static_scene
    return np.zeros(3) if scene is None else height_mm * scene.region_normal_base


FAR_MM = 15.0  # from the skull: such a place is not on it
_TREES: Memo[KDTree] = Memo(2)
_NORMALS: Memo[Floats] = Memo(2)


def on_bone(points_base: Floats, scene: StaticScene | None, height_mm: float) -> Floats:
    """Return points (n, 3) in ``base``, raised to a height over the drawn skull where below it.

    Measured points scatter about the bone, and a dot that lies within it is half hidden. Points
    that are as high already, or far from the skull, stay where they are.
    """
    if scene is None or not len(points_base) or not len(scene.skull.vertices):
        return points_base
    vertices = scene.skull.vertices
    tree, normals = _TREES.get((scene.skull,), lambda: KDTree(vertices)), skull_normals(scene.skull)
    if normals[tree.query(scene.region_center_base)[1]] @ scene.region_normal_base < 0.0:
        normals = -normals  # a skull whose triangles are counted the other way round
    apart, nearest = tree.query(points_base)
    normals = normals[nearest]
    heights = np.einsum("ij,ij->i", points_base - vertices[nearest], normals)
    below = np.where(apart < FAR_MM, np.maximum(height_mm - heights, 0.0), 0.0)
    return points_base + below[:, None] * normals


def skull_normals(skull: Mesh) -> Floats:
    """Return the outward normal (n, 3) at each vertex of a drawn skull."""
    return _NORMALS.get((skull,), lambda: _normals(skull))


def _normals(skull: Mesh) -> Floats:
    a, b, c = (skull.vertices[skull.faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    total = np.zeros_like(skull.vertices)
    for corner in skull.faces.T:
        for axis in range(3):
            total[:, axis] += np.bincount(corner, areas[:, axis], len(total))
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]
