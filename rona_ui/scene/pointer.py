"""The hand-held pointer and what it touched: strokes, landmarks and the surface cloud."""

from itertools import pairwise

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from rona_core.app.steps.scan.landmarks.view import LandmarkReport, landmark_report
from rona_core.devices.settings import SONO
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull
from rona_ui.presentation.colors import BLUE, GREEN, ORANGE, PURPLE, STEEL, VERMILLION, Rgb
from rona_ui.presentation.mouse_input import starts
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.cut_plane import Plane, crossings
from rona_ui.scene.viser_nodes import NO_LINES, NO_POINTS, Layer, lift, on_bone, segments

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
        self.nodes.lines(LINE, np.concatenate(lines), ORANGE, width_px=2.5)
        self.nodes.dots(PICKS, points + up, ORANGE, size_px=6.0)


def over_skull(points_base: Floats, scene: StaticScene | None) -> Floats:
    """Return the line (m, 3) through points (n, 3), led over the drawn skull between them."""
    if scene is None or len(points_base) < 2:
        return points_base
    lengths = np.linalg.norm(np.diff(points_base, axis=0), axis=1)
    way = np.concatenate(([0.0], np.cumsum(lengths)))
    inner = [np.arange(a + STEP_MM, b, STEP_MM) for a, b in pairwise(way)]
    at = np.sort(np.concatenate((way, *inner)))
    line = np.column_stack([np.interp(at, way, part) for part in points_base.T])
    return on_bone(line, scene, 0.0)


ROBOT, POINTER, APART = "/landmarks/robot", "/landmarks/pointer", "/landmarks/apart"
LABEL = "/landmarks/label"
ARM_MM, DOT_MM = 7.0, 3.5
UP_MM = (0.0, 0.0, 16.0)  # of a label
COLORS: dict[str, Rgb] = {"passed": GREEN, "failed": VERMILLION, "overridden": ORANGE}


class LandmarkLayer(Layer):
    """Draws a cross where the robot's tip touched, a dot where the pointer is said to be."""

    layer = "landmarks"
    follows = ("session", "view.step", "view.all_layers", "view.hidden")
    names = (ROBOT, POINTER, APART)

    def draw(self, new: Snapshot) -> None:
        """Draw crosses, dots, and a label with the distance at each."""
        report = landmark_report(new.session)
        color = COLORS.get(report.state, STEEL)
        self.nodes.lines(ROBOT, crosses(report), STEEL, width_px=3.0)
        dots = [row.pointer_base_mm for row in report.rows if row.pointer_base_mm is not None]
        points = np.array(dots, dtype=np.float64).reshape(-1, 3)
        self.nodes.cloud(POINTER, points if len(points) else NO_POINTS, color, size_mm=DOT_MM)
        pairs = [
            (row.robot_base_mm, row.pointer_base_mm)
            for row in report.rows
            if row.pointer_base_mm is not None
        ]
        apart = np.array(pairs, dtype=np.float64).reshape(-1, 2, 3) if pairs else NO_LINES
        self.nodes.lines(APART, apart, color, width_px=4.0)
        self._label(report if self.shown(new) else LandmarkReport(report.state, ""))

    def _label(self, report: LandmarkReport) -> None:
        wanted = {f"{LABEL}/{i}": row for i, row in enumerate(report.rows)}
        for name in self.nodes.names():
            if name.startswith(LABEL) and name not in wanted:
                self.nodes.remove(name)
        for name, row in wanted.items():
            far = "not seen" if row.distance_mm is None else f"{row.distance_mm:.2f} mm"
            self.nodes.label(name, f"{row.name}: {far}", np.add(row.robot_base_mm, UP_MM))


def crosses(report: LandmarkReport) -> np.ndarray:
    """Return three short lines through each landmark (3 n, 2, 3)."""
    if not report.rows:
        return NO_LINES
    places = np.array([row.robot_base_mm for row in report.rows])
    arms = ARM_MM * np.eye(3)
    return np.stack((places[:, None] - arms, places[:, None] + arms), axis=2).reshape(-1, 2, 3)


CLOUD, REGION, CONTOURS = "/surface/cloud", "/region", "/registered_skull"
STROKE = "/surface/stroke"
MOST_POINTS = 20_000  # drawn; the session keeps all
POINT_PX, POINT_MM = 3.0, 0.6  # size, and height over the bone
APART_MM = 12.0  # from contour to contour
SURFACE_LIFT_MM = 0.4  # off the mesh, so that the contours are to be seen where both skulls agree


class CloudLayer(Layer):
    """Draws the surface points; grey while another stroke is recorded."""

    layer = "cloud"
    names = (CLOUD,)
    results = ("surface",)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the cloud anew when it is another one, or when a stroke begins or ends."""
        before = old is not None and old.stroke is not None
        another = changed(old, new, "session.results.surface", "static_scene")
        if another or before != (new.stroke is not None):
            surface = new.session.results.surface
            points = NO_POINTS if surface is None else surface.value.points_base
            color = BLUE if new.stroke is None else STEEL
            placed = on_bone(thinned(points), new.static_scene, POINT_MM)
            self.nodes.dots(CLOUD, placed, color, size_px=POINT_PX)
        super().render(old, new)


class StrokeLayer(Layer):
    """Draws where the tip of the pointer has been in the stroke under way; never hidden."""

    follows = ("stroke",)

    def draw(self, new: Snapshot) -> None:
        """Draw the stroke."""
        points = NO_POINTS if new.stroke is None else new.stroke
        placed = on_bone(thinned(points), new.static_scene, POINT_MM)
        self.nodes.dots(STROKE, placed, BLUE, size_px=POINT_PX)


def thinned(points: Floats) -> Floats:
    """Return as many of the points (n, 3) as are drawn."""
    return points[:: 1 + len(points) // MOST_POINTS]


class RegionLayer(Layer):
    """Draws the rim of the region as a ring round the place to be scanned."""

    layer = "region"
    follows = ("static_scene",)
    names = (REGION,)

    def draw(self, new: Snapshot) -> None:
        """Draw the ring."""
        lines = NO_LINES if new.static_scene is None else segments(ring(new.static_scene))
        self.nodes.lines(REGION, lines, PURPLE, width_px=2.0)


class RegisteredSkullLayer(Layer):
    """Draws the contours of the registered skull, beside the skull as it is drawn."""

    layer = "registered_skull"
    follows = ("session.results.registration", "session.setup.specimen")
    names = (CONTOURS,)
    results = ("registration",)

    def draw(self, new: Snapshot) -> None:
        """Draw the contours."""
        self.nodes.lines(CONTOURS, contours(new.session), GREEN, width_px=1.5)


def ring(static_scene: StaticScene, n: int = 96) -> Floats:
    """Return the rim of the region (n + 1, 3), laid onto the drawn skull."""
    normal, center = static_scene.region_normal_base, static_scene.region_center_base
    across = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    angle = np.linspace(0.0, 2.0 * np.pi, n + 1)[:, None]
    rim = center + static_scene.region_radius_mm * (np.cos(angle) * across + np.sin(angle) * along)
    near = static_scene.skull.vertices - center
    heights, aside = near @ normal, near - (near @ normal)[:, None] * normal
    close = (np.linalg.norm(aside, axis=1) < static_scene.region_radius_mm + 8.0) & (
        heights > -40.0
    )
    if close.any():
        flat = aside[close]
        for i, place in enumerate(rim - center):
            nearest = int(np.argmin(((flat - place) ** 2).sum(axis=1)))
            rim[i] = center + place + (heights[close][nearest] + 1.0) * normal
        smooth = np.convolve(
            np.pad((rim - center) @ normal, 4, mode="wrap"), np.ones(9) / 9, "valid"
        )
        rim += (smooth - (rim - center) @ normal)[:, None] * normal
    rim[-1] = rim[0]
    return rim


def contours(session: Session) -> Floats:
    """Return segments (n, 2, 3) in ``base`` round the registered skull; none without one."""
    registered, skull = session.results.registration, session.setup.specimen
    if registered is None or not isinstance(skull, LoadedSkull):
        return NO_LINES
    vertices = np.asarray(skull.mesh_vertices_skull, dtype=np.float64)
    faces = np.asarray(skull.mesh_faces, dtype=np.int64)
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    mesh = Mesh(vertices + SURFACE_LIFT_MM * normals, faces)
    lines: list[Floats] = []
    for axis in np.eye(3)[:2]:
        heights = mesh.vertices @ axis
        for height in np.arange(heights.min() + APART_MM / 2.0, heights.max(), APART_MM):
            lines.append(crossings(mesh, Plane(height * axis, axis)).rim_base(mesh.vertices))
    T_base_skull = registered.value.T_b_a.inv()
    return (T_base_skull @ np.concatenate(lines).reshape(-1, 3)).reshape(-1, 2, 3)
