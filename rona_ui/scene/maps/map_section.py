"""Bone section: outer and inner boundary map intersected with the cut plane."""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.mesh import Mesh
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_ui.presentation.colors import BONE_RIM, ORANGE, SKY
from rona_ui.presentation.shown import shown_maps, shown_maps_key
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.cut_plane import Plane, crossings, cut_key, cut_plane
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import NO_LINES, SceneNodes, grid_faces

BAND, OUTER, INNER = "/cut_bone", "/cut_outer", "/cut_inner"
MAPS = ("outer", "inner", "fused")


class ProfileLayer(Layer):
    """Draws both boundaries as lines in the cut and, where both are mapped, the bone between."""

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._bone = False  # there is some in the cut

    def shown(self, snapshot: Snapshot) -> bool:
        """Show the bone while any of the maps is to be seen."""
        return any(snapshot.view.shows(name) for name in MAPS)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the bone where the cut or the maps are others."""
        if old is None or _key(old) != _key(new):
            self._draw(shown_maps(new), cut_plane(new))
        for node in (OUTER, INNER, BAND):
            self.nodes.show(node, self.shown(new) and (self._bone or node != BAND))

    def _draw(self, maps: Maps | None, plane: Plane | None) -> None:
        outer = inner = between = NO_LINES
        if maps is not None and plane is not None:
            outer, inner = profile(maps.outer, plane), profile(maps.inner, plane)
            between = band(maps, plane)
        self.nodes.lines(OUTER, outer, SKY, width_px=4.0)
        self.nodes.lines(INNER, inner, ORANGE, width_px=4.0)
        self._bone = len(between) > 0
        if self._bone:
            corners = between.reshape(-1, 3)
            faces = np.arange(0, len(corners), 4)[:, None] + np.array((0, 1, 2, 0, 2, 3))
            mesh = Mesh(corners, faces.reshape(-1, 3))
            self.nodes.mesh(BAND, mesh, BONE_RIM, side="double")


def _key(snapshot: Snapshot) -> tuple[object, ...]:
    return cut_key(snapshot), shown_maps_key(snapshot)


def profile(boundary: BoundaryMap, plane: Plane) -> Floats:
    """Return the line (k, 2, 3) in which a plane goes through a map, in base."""
    sheet = _sheet(boundary, boundary.ok)
    return crossings(sheet, plane).rim_base(sheet.vertices)


def band(maps: Maps, plane: Plane) -> Floats:
    """Return quads (k, 4, 3) from the outer boundary in the plane to the inner one beneath it.

    Beneath means at the same place of the maps' grid, which is how thickness is counted. Places
    where either boundary is not known have no quad.
    """
    both = maps.outer.ok & maps.inner.ok
    outer, inner = _sheet(maps.outer, both), _sheet(maps.inner, both)
    found = crossings(outer, plane)
    upper, lower = found.rim_base(outer.vertices), found.rim_base(inner.vertices)
    return np.concatenate((upper, lower[:, ::-1]), axis=1)


def _sheet(boundary: BoundaryMap, ok: Bools) -> Mesh:
    """Return the cells of a map as a surface in base; none where a corner is not ``ok``."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    points_map = np.stack((u, v, boundary.height_mm), axis=-1).reshape(-1, 3)
    return Mesh(boundary.T_base_map @ points_map, grid_faces(ok))
