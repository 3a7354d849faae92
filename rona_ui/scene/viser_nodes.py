"""The one place where millimetres become the viewer's metres: named nodes, updated in place."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rona_core.devices.protocols import Mesh
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses

M_PER_MM = 0.001
UPRIGHT = Pose.from_rotvec((np.pi, 0.0, 0.0))  # the viewer counts the rows of pictures along +y
Colors = tuple[int, int, int] | NDArray[np.uint8]


def metres(lengths_mm: ArrayLike) -> NDArray[np.float32]:
    """Return lengths or positions in metres, as single precision."""
    return (np.asarray(lengths_mm, dtype=np.float64) * M_PER_MM).astype(np.float32)


def segments(points: Floats) -> Floats:
    """Return a polyline (n, 3) as segments (n - 1, 2, 3)."""
    return np.stack((points[:-1], points[1:]), axis=1)


class SceneNodes:
    """Scene nodes of one browser by name. Everything that goes in is in mm and in ``base``."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self._nodes: dict[str, Any] = {}

    def names(self) -> frozenset[str]:
        """Return the names of the nodes that exist."""
        return frozenset(self._nodes)

    def node(self, name: str) -> Any:
        """Return the viewer's handle of a node, to listen to the mouse on it."""
        return self._nodes[name]

    def mesh(
        self,
        name: str,
        mesh: Mesh,
        color: tuple[int, int, int],
        *,
        opacity: float | None = None,
        side: str = "front",
    ) -> None:
        """Draw a shaded mesh; its opacity is fixed when it is drawn first."""
        vertices, faces = metres(mesh.vertices), np.asarray(mesh.faces, dtype=np.uint32)
        node = self._nodes.get(name)
        if node is None:
            self._nodes[name] = self._scene.add_mesh_simple(
                name, vertices, faces, color=color, opacity=opacity, side=side
            )
        else:
            node.vertices, node.faces, node.color = vertices, faces, color

    def paint(self, name: str, color: tuple[int, int, int]) -> None:
        """Give a mesh that exists another colour."""
        self._nodes[name].color = color

    def cloud(self, name: str, points: Floats, colors: Colors, *, size_mm: float = 1.0) -> None:
        """Draw unlit points (n, 3), so that their colours are those of the colour bar."""
        if not len(points):
            self.remove(name)
            return
        size, colored = float(M_PER_MM * size_mm), _colors(colors, (len(points), 3))
        node = self._nodes.get(name)
        if node is None:
            self._nodes[name] = self._scene.add_point_cloud(
                name,
                metres(points),
                colored,
                point_size=size,
                point_shape="circle",
                point_shading="flat",
                precision="float32",
            )
        else:
            node.points, node.colors, node.point_size = metres(points), colored, size

    def lines(
        self,
        name: str,
        pairs: Floats,
        color: tuple[int, int, int],
        *,
        width_px: float = 2.0,
        width_mm: float | None = None,
    ) -> None:
        """Draw line segments (n, 2, 3) of a width in pixels or in mm, all in one colour.

        The viewer draws one colour as it is, but colours per point brighter than they are.
        """
        if not len(pairs):
            self.remove(name)
            return
        node = self._nodes.get(name)
        if node is None:
            self._nodes[name] = self._scene.add_line_segments(
                name,
                metres(pairs),
                color,
                thickness=width_px if width_mm is None else float(M_PER_MM * width_mm),
                thickness_units="screen" if width_mm is None else "world",
            )
        else:
            node.points, node.colors = metres(pairs), np.array(color, dtype=np.uint8)

    def axes(self, name: str, poses: Poses, *, length_mm: float, radius_mm: float = 0.3) -> None:
        """Draw many small coordinate crosses."""
        self.remove(name)
        if len(poses):
            self._nodes[name] = self._scene.add_batched_axes(
                name,
                poses.wxyz(),
                metres(poses.translations),
                axes_length=M_PER_MM * length_mm,
                axes_radius=M_PER_MM * radius_mm,
            )

    def frame(self, name: str, pose: Pose, *, length_mm: float = 0.0) -> None:
        """Place a coordinate cross, or an invisible parent for other nodes (length 0)."""
        node = self._nodes.get(name)
        if node is None:
            node = self._nodes[name] = self._scene.add_frame(
                name,
                show_axes=length_mm > 0,
                axes_length=M_PER_MM * max(length_mm, 1.0),
                axes_radius=M_PER_MM * max(length_mm, 1.0) / 40.0,
            )
        node.wxyz, node.position = pose.wxyz(), metres(pose.translation)

    def label(self, name: str, text: str, place: ArrayLike) -> None:
        """Write a short text at a place."""
        node = self._nodes.get(name)
        if node is None:
            self._nodes[name] = self._scene.add_label(name, text, position=metres(place))
        else:
            node.text, node.position = text, metres(place)

    def floor(self, name: str, height_mm: float) -> None:
        """Draw a quiet grid of 100 mm cells as a measure of size."""
        self._nodes[name] = self._scene.add_grid(
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
        self._nodes[name] = self._scene.add_image(
            name,
            picture,
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
        self._nodes[name] = self._scene.add_transform_controls(
            name,
            scale=M_PER_MM * size_mm,
            disable_axes=True,
            disable_sliders=True,
            depth_test=False,
            wxyz=pose.wxyz(),
            position=metres(pose.translation),
        )

    def show(self, name: str, visible: bool) -> None:
        """Show or hide a node, if it exists."""
        node = self._nodes.get(name)
        if node is not None:
            node.visible = visible

    def remove(self, name: str) -> None:
        """Take a node away, if it exists."""
        node = self._nodes.pop(name, None)
        if node is not None:
            node.remove()


def _colors(colors: Colors, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return one colour per point: a change of their number then never meets an old array."""
    each = np.asarray(colors, dtype=np.uint8)
    return np.ascontiguousarray(np.broadcast_to(each, shape))
