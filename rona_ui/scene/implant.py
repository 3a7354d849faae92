"""Step 10: implant, bed and milling path in their place, and the bone as it is milled."""

import time

import numpy as np

from rona_core.app.steps.implant.derivation import LACKS, ImplantBed
from rona_core.app.steps.implant.milling import MillingView
from rona_core.app.steps.implant.view import (
    bone_left_mm,
    bone_over_bed,
    expected_outline,
    outline_base,
)
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.planning.bed import Bed
from rona_core.planning.milling.milling_path import Move, bed_mesh
from rona_core.planning.robot_milling import BoneOverBed
from rona_ui.presentation.colors import (
    BONE,
    BONE_RIM,
    INK,
    MILLING_COLORS,
    PURPLE,
    SKY,
    STEEL,
    VERMILLION,
    WHITE,
    viridis,
)
from rona_ui.presentation.snapshot import Snapshot, shown_milling
from rona_ui.scene.cut_plane import cut_key, cut_plane, draw_cut
from rona_ui.scene.viser_nodes import (
    NO_LINES,
    Layer,
    SceneNodes,
    grid_faces,
    lift,
    on_bone,
    segments,
)

IMPLANT, IMPLANT_CUT, SCREWS = "/implant/body", "/implant/cut", "/implant/screws"
OUTLINE, EXPECTED = "/implant/outline", "/implant/expected"
EXPECTED_MM = 1.2  # over the bone: above the path
ASTRAY = "/implant/unmapped"
POCKET, POCKET_CUT = "/bed/pocket", "/bed/cut"
THINNEST, THINNEST_LABEL, LEADER = "/bed/thinnest", "/bed/thinnest_label", "/bed/leader"
MOVED = "/implant/moved"
CELLS, SAFE, RING = "/chance/cells", "/chance/safe", "/chance/ring"
POCKET_OPACITY = 0.45
EVERY = 2  # cell of the bed is drawn
MARK_PX = 10.0
BESIDE_MM = 5.0  # from the rim of the bed to its label
# above the outer boundary, so that the skull does not hide them
CHANCE_MM, SAFE_MM, RING_MM = 1.5, 2.0, 3.0


class OfBed(Layer):
    """What is drawn of the bed, and cut with the skull."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw anew where the bed or the cut is another one."""
        if old is None or old.milling is not new.milling or cut_key(old) != cut_key(new):
            self.draw(new)
        for name in self.names:
            self.nodes.show(name, self.shown(new))

    def shown(self, snapshot: Snapshot) -> bool:
        """Show it unless the milling is replayed: then it is not there yet."""
        return Layer.shown(self, snapshot) and shown_milling(snapshot) is None


class ImplantLayer(OfBed):
    """Draws the implant in its bed with its outline, and its screws."""

    layer = "implant"
    names = (IMPLANT, IMPLANT_CUT, OUTLINE, SCREWS)

    def draw(self, new: Snapshot) -> None:
        """Draw body and screws anew, or nothing without a bed."""
        view = new.milling
        self.nodes.remove(SCREWS)  # another one may have screws of another width
        body = None if view is None else view.implant_base()
        plane = cut_plane(new)
        draw_cut(self.nodes, (IMPLANT, IMPLANT_CUT), body, STEEL, plane)
        outline = NO_LINES if view is None or body is None else outline_on(view, body)
        if plane is not None:
            outline = outline[plane.heights_mm(outline.mean(axis=1)) < 0.0]
        self.nodes.lines(OUTLINE, outline, INK, width_px=2.0)
        if view is None:
            return
        screws = view.implant.screws
        if screws:
            ends = np.array(
                [((s.x_mm, s.y_mm, 0.0), (s.x_mm, s.y_mm, -s.length_mm)) for s in screws]
            )
            pairs = (view.placed.T_base_bed @ ends.reshape(-1, 3)).reshape(-1, 2, 3)
            self.nodes.lines(SCREWS, pairs, PURPLE, width_mm=screws[0].diameter_mm)


class ExpectedOutlineLayer(Layer):
    """Draws the outline of the implant on the bone, for a path that is still to be drawn."""

    layer = "implant_outline"
    follows = ("session.results", "static_scene")
    names = (EXPECTED,)

    def draw(self, new: Snapshot) -> None:
        """Draw the outline; the bone hides no part of it."""
        rings = expected_outline(new.session, EXPECTED_MM)
        placed = [segments(on_bone(ring, new.static_scene, EXPECTED_MM)) for ring in rings]
        lines = np.concatenate(placed) if placed else NO_LINES
        self.nodes.lines(EXPECTED, lines, INK, width_px=2.5)


def outline_on(view: MillingView, body: Mesh) -> Floats:
    """Return the outline of an implant at its top (n, 2, 3), in base."""
    T_base_bed = view.placed.T_base_bed
    top_mm = float((T_base_bed.inv() @ body.vertices)[:, 2].max()) + 0.1
    rings = [np.column_stack((r, np.full(len(r), top_mm))) for r in view.implant.outline()]
    return np.concatenate([segments(T_base_bed @ ring) for ring in rings])


class BedLayer(OfBed):
    """Draws the pocket that the burr cuts, and where the least bone is left below it."""

    layer = "bed"
    names = (POCKET, POCKET_CUT, THINNEST, THINNEST_LABEL, LEADER)

    def draw(self, new: Snapshot) -> None:
        """Draw the pocket anew, or nothing without a bed."""
        view = new.milling
        pocket = None if view is None else pocket_base(view)
        draw_cut(self.nodes, (POCKET, POCKET_CUT), pocket, BONE_RIM, cut_plane(new), POCKET_OPACITY)
        placed = None if view is None else view.placed
        if view is None or placed is None or placed.thinnest_base is None:
            for name in (THINNEST, THINNEST_LABEL, LEADER):
                self.nodes.remove(name)
            return
        at = placed.thinnest_base
        leader = leader_base(view, at)
        self.nodes.dots(THINNEST, at[None], VERMILLION, size_px=MARK_PX)
        self.nodes.lines(LEADER, segments(leader), VERMILLION, width_px=1.6)
        self.nodes.label(THINNEST_LABEL, bone_words(placed.residual_mm), leader[-1])


def leader_base(view: MillingView, place_base: Floats) -> Floats:
    """Return a line (3, 3) from a place in the bed up and aside, to where a label hides nothing."""
    T_base_bed = view.placed.T_base_bed
    x, y, _ = place_bed = T_base_bed.inv() @ place_base
    reach_mm = max(np.hypot(*np.abs(ring).max(axis=0)) for ring in view.implant.outline())
    aside = np.array((x, y)) / max(np.hypot(x, y), 1e-9) if np.hypot(x, y) > 1.0 else (1.0, 0.0)
    corner = np.array((x, y, RING_MM))
    end = np.array((*((reach_mm + BESIDE_MM) * np.asarray(aside)), RING_MM))
    return T_base_bed @ np.stack((place_bed, corner, end))


def bone_words(residual_mm: float | None) -> str:
    """Return how much bone is left, or how far the bed goes through it."""
    left_mm = residual_mm or 0.0
    return f"{left_mm:.2f} mm of bone" if left_mm >= 0.0 else f"{-left_mm:.2f} mm through the bone"


def pocket_base(view: MillingView) -> Mesh:
    """Return walls and floor of a bed without its lid, in base."""
    fine = view.bed
    bed = Bed(fine.x_mm[::EVERY], fine.y_mm[::EVERY], fine.depth_mm[::EVERY, ::EVERY])
    closed = bed_mesh(bed, view.placed.T_base_bed)
    n_top = len(closed.points_base) // 2  # corners of the lid, then those of the floor below them
    open_above = (closed.triangles >= n_top).any(axis=1)
    return Mesh(closed.points_base, np.asarray(closed.triangles[open_above], dtype=np.int64))


class MillingLayer(Layer):
    """Draws the way of the burr's tip, coloured by what each move is for."""

    layer = "milling"
    follows = ("milling",)
    names = tuple(f"/milling/{kind}" for kind in MILLING_COLORS)

    def draw(self, new: Snapshot) -> None:
        """Draw the moves of each kind anew."""
        view = new.milling
        for kind, (_, color) in MILLING_COLORS.items():
            pairs = NO_LINES if view is None else moves_base(view, Move[kind.upper()])
            self.nodes.lines(f"/milling/{kind}", pairs, color, width_px=1.5)


def moves_base(view: MillingView, kind: Move) -> Floats:
    """Return the moves of one kind (n, 2, 3) in base; a move belongs to the place it ends at."""
    tips = view.tips_base()
    pairs = np.stack((tips[:-1], tips[1:]), axis=1)
    return pairs[view.path.moves[1:] == kind]


class UnmappedLayer(Layer):
    """Draws only the outline of an implant that does not lie wholly in the maps."""

    layer = "implant"
    follows = ("session",)
    names = (ASTRAY,)

    def draw(self, new: Snapshot) -> None:
        """Draw the outline anew."""
        held = new.session.results.get("bed")
        placed = None if held is None else held.value.placed
        lost = placed is not None and placed.residual_mm is None
        self.nodes.lines(ASTRAY, ring_base(new) if lost else NO_LINES, VERMILLION, width_px=3.0)


class ChanceLayer(Layer):
    """Draws the probability with the middle of the bed in each cell, on the outer boundary."""

    layer = "chance"
    names = (CELLS, SAFE, RING)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the cells where the bed or the maps are others; white dots where it is safe."""
        if old is None or _made(old) != _made(new):
            self.draw(new)
        for name in self.names:
            self.nodes.show(name, self.shown(new))

    def draw(self, new: Snapshot) -> None:
        """Draw the cells anew."""
        self.nodes.remove(CELLS)
        self.nodes.remove(SAFE)
        self.nodes.lines(RING, ring_base(new), VERMILLION, width_px=3.0)
        held, maps = new.session.results.get("bed"), new.session.results.maps
        if held is None or maps is None or new.step("implant").state == "stale":
            return
        bed: ImplantBed = held.value
        if bed.probability is None or bed.lacks is None:
            return
        mapped = maps.value.outer.ok & (bed.lacks != LACKS.index("maps"))
        points = _cells_base(maps.value, mapped)
        cell_mm = float(maps.value.outer.u_mm[1] - maps.value.outer.u_mm[0])
        colors = viridis(bed.probability[mapped])
        self.nodes.cloud(CELLS, points + lift(new, CHANCE_MM), colors, size_mm=cell_mm)
        safe = _cells_base(maps.value, mapped & (bed.lacks == LACKS.index("nothing")))
        self.nodes.cloud(SAFE, safe + lift(new, SAFE_MM), WHITE, size_mm=0.35 * cell_mm)


class MovedBedLayer(Layer):
    """Draws the outline of the implant where it is moved to; never hidden."""

    follows = ("view.drawing", "view.move_target", "session")

    def draw(self, new: Snapshot) -> None:
        """Draw the outline anew; it stays parallel to that of the bed, which follows."""
        rings = ring_base(new) if new.view.drawing == "implant" else NO_LINES
        held, target = new.session.results.get("bed"), new.view.move_target
        if len(rings) and held is not None and target is not None:
            T_base_bed = held.value.placed.T_base_bed
            rings = rings + (np.array(target) - T_base_bed.translation)
        self.nodes.lines(MOVED, rings, SKY, width_px=4.0)


def ring_base(snapshot: Snapshot) -> Floats:
    """Return the outline of the implant in its place (n, 2, 3), over the bone, in base."""
    held = snapshot.session.results.get("bed")
    if held is None or held.value.placed is None or snapshot.step("implant").state == "stale":
        return NO_LINES
    return np.concatenate([segments(ring) for ring in outline_base(held.value, RING_MM)])


def _made(snapshot: Snapshot) -> tuple[object, ...]:
    """Return the key of a drawing of the cells."""
    results = snapshot.session.results
    stale = snapshot.step("implant").state == "stale"
    return id(results.get("bed")), id(results.maps), id(snapshot.static_scene), stale


def _cells_base(maps: Maps, chosen: Bools) -> Floats:
    """Return the places (n, 3) of cells on the outer boundary, in base."""
    outer = maps.outer
    u, v = np.meshgrid(outer.u_mm, outer.v_mm, indexing="ij")
    points_map = np.stack((u, v, outer.height_mm), axis=-1)[chosen]
    return outer.T_base_map @ points_map


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
