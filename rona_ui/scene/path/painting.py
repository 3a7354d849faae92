"""Painted regions on the drawn skull: green to scan, vermillion to avoid, and the new stroke."""

import numpy as np
import trimesh

from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.path.zones import PaintedStroke, PaintKind
from rona_core.session.memo import Memo
from rona_ui.presentation.colors import GREEN, VERMILLION, Rgb
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import PAINTING
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import SceneNodes

COLORS: dict[PaintKind, Rgb] = {"scan": GREEN, "avoid": VERMILLION}
LIFT_MM: dict[PaintKind, float] = {"scan": 0.5, "avoid": 0.8}  # off the skull; avoid lies on top
OPACITY = 0.55
HALVINGS = 3  # of the edges of the drawn skull, so that the rim looks round
NORMALS: Memo[Floats] = Memo(2)


class PaintedLayer(Layer):
    """Draws what is painted, and the stroke that is being painted."""

    layer = "painted"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw each kind where it is another one, and the stroke as it grows."""
        fresh = changed(old, new, "static_scene")
        if fresh or changed(old, new, "session.painted"):
            for kind in COLORS:
                _draw(self.nodes, f"/painted/{kind}", kind, new, new.session.painted.of(kind))
        if fresh or changed(old, new, "view.stroke", "view.drawing"):
            for kind in COLORS:
                growing = new.view.stroke if PAINTING.get(new.view.drawing or "") == kind else ()
                strokes = (PaintedStroke(kind, growing, new.view.brush_mm),) if growing else ()
                _draw(self.nodes, f"/painting/{kind}", kind, new, strokes)
        for kind in COLORS:
            self.nodes.show(f"/painted/{kind}", self.shown(new))


def _draw(
    nodes: SceneNodes, name: str, kind: PaintKind, new: Snapshot, strokes: tuple[PaintedStroke, ...]
) -> None:
    scene = new.static_scene
    if scene is None or not strokes:
        nodes.remove(name)
        return
    mesh = footprint(scene.skull, strokes, LIFT_MM[kind])
    if len(mesh.faces):
        nodes.mesh(name, mesh, COLORS[kind], opacity=OPACITY, side="double")
    else:
        nodes.remove(name)


def footprint(skull: Mesh, strokes: tuple[PaintedStroke, ...], lift_mm: float) -> Mesh:
    """Return what strokes cover of a drawn skull, lifted off it along its normals."""
    depths = _depths_mm(strokes, skull.vertices)
    edge_mm = float(np.linalg.norm(np.ptp(skull.vertices[skull.faces[:200]], axis=1), axis=1).max())
    near = skull.faces[(depths[skull.faces] > -edge_mm).any(axis=1)]
    corners = np.concatenate((skull.vertices, _normals(skull)), axis=1)[near]  # (k, 3, 6)
    for _ in range(HALVINGS):
        a, b, c = (corners[:, i] for i in range(3))
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    covered = _depths_mm(strokes, corners[:, :, :3].mean(axis=1)) >= 0.0
    points = corners[covered].reshape(-1, 6)
    faces = np.arange(len(points), dtype=np.int64).reshape(-1, 3)
    return Mesh(points[:, :3] + lift_mm * points[:, 3:], faces)


def _normals(skull: Mesh) -> Floats:
    def compute() -> Floats:
        solid = trimesh.Trimesh(skull.vertices, skull.faces, process=False)
        return np.asarray(solid.vertex_normals, dtype=np.float64)

    return NORMALS.get((skull,), compute)


def _depths_mm(strokes: tuple[PaintedStroke, ...], places: Floats) -> Floats:
    depths = np.full(len(places), -np.inf)
    for stroke in strokes:
        depths = np.maximum(depths, stroke.radius_mm - stroke.zone().distances_mm(places))
    return depths
