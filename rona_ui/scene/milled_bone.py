"""Replay of a milling: the bone over the bed disappears as the burr comes along."""

import time

import numpy as np

from rona_core.app.steps.implant.bone_left import bone_left_mm, bone_over_bed
from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.planning.robot_milling import BoneOverBed
from rona_ui.presentation.colors import BONE, BONE_RIM
from rona_ui.presentation.shown import shown_milling
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.cut_plane import cut_key, cut_plane, draw_cut
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import SceneNodes, grid_faces

WHOLE, WHOLE_CUT = "/bone_left/whole", "/bone_left/whole_cut"
MILLED, MILLED_CUT = "/bone_left/milled", "/bone_left/milled_cut"
AROUND, AROUND_CUT = "/bone_left/around", "/bone_left/around_cut"
EVERY_S = 0.15  # while it plays


class MilledBoneLayer(Layer):
    """Draws the mapped surface of the bone as far as it is milled, while that is replayed."""

    layer = "bone_left"
    names = (WHOLE, WHOLE_CUT, MILLED, MILLED_CUT, AROUND, AROUND_CUT)

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._drawn_s = -np.inf
        self._of: tuple[object, ...] = ()  # what is drawn round the bed follows from this
        self._share: float | None = None

    def shown(self, snapshot: Snapshot) -> bool:
        """Show it while the milling is replayed."""
        return Layer.shown(self, snapshot) and shown_milling(snapshot) is not None

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw what is left where the replay has gone on, not for every picture."""
        if self.shown(new):
            self._follow(new)
        for name in self.names:
            self.nodes.show(name, self.shown(new))

    def _follow(self, new: Snapshot) -> None:
        share, view, maps = shown_milling(new), new.milling, new.session.results.maps
        if share is None or view is None or maps is None:
            return
        bone, T_base_bed = bone_over_bed(new.session), view.placed.T_base_bed
        of = (view, maps, cut_key(new))
        another = self._of != of
        if another:
            self._of = of
            around = around_bed(maps.value.outer, bone, T_base_bed)
            draw_cut(self.nodes, (AROUND, AROUND_CUT), around, BONE, cut_plane(new))
        now_s = time.monotonic()
        waits = new.view.playing and now_s - self._drawn_s < EVERY_S
        if another or (share != self._share and not waits):
            self._drawn_s, self._share = now_s, share
            height_mm = bone_left_mm(new.session, share)
            if height_mm is not None:
                whole, milled = over_bed(bone, height_mm, T_base_bed)
                draw_cut(self.nodes, (WHOLE, WHOLE_CUT), whole, BONE, cut_plane(new))
                draw_cut(self.nodes, (MILLED, MILLED_CUT), milled, BONE_RIM, cut_plane(new))


def over_bed(bone: BoneOverBed, height_mm: Floats, T_base_bed: Pose) -> tuple[Mesh, Mesh]:
    """Return the surface over a bed at heights (nx, ny) in base: what is whole, what is milled."""
    x, y = np.meshgrid(bone.x_mm, bone.y_mm, indexing="ij")
    points_bed = np.stack((x, y, height_mm), axis=-1).reshape(-1, 3)
    points_base, faces = T_base_bed @ points_bed, grid_faces(bone.ok)
    milled = (height_mm < bone.surface_mm).ravel()[faces].any(axis=1)
    return Mesh(points_base, faces[~milled]), Mesh(points_base, faces[milled])


def around_bed(outer: BoundaryMap, bone: BoneOverBed, T_base_bed: Pose) -> Mesh:
    """Return the cells of the outer boundary that do not lie wholly in the grid over the bed."""
    u, v = np.meshgrid(outer.u_mm, outer.v_mm, indexing="ij")
    points_map = np.stack((u, v, outer.height_mm), axis=-1).reshape(-1, 3)
    points_base = outer.T_base_map @ points_map
    x, y, _ = (T_base_bed.inv() @ points_base).T
    over = (x > bone.x_mm[0]) & (x < bone.x_mm[-1]) & (y > bone.y_mm[0]) & (y < bone.y_mm[-1])
    faces = grid_faces(outer.ok)
    return Mesh(points_base, faces[~over[faces].all(axis=1)])
