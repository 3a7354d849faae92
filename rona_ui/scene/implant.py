"""Step 10: implant, bed and milling path in their place, and the probability over positions."""

import numpy as np

from rona_core.app.steps.implant.bed_milling import MillingView
from rona_core.app.steps.implant.implant_bed import LACKS, ImplantBed
from rona_core.app.steps.implant.view import outline_base
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.mesh import Mesh
from rona_core.mapping.boundary_map import Maps
from rona_core.planning.bed import Bed
from rona_core.planning.milling.milling_path import Move, bed_mesh
from rona_ui.presentation.colors import (
    BONE_RIM,
    MILLING_COLORS,
    SKY,
    STEEL,
    VERMILLION,
    WHITE,
    YELLOW,
    viridis,
)
from rona_ui.presentation.shown import shown_milling
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.cut_plane import cut_key, cut_plane, draw_cut
from rona_ui.scene.layer import Layer, lift
from rona_ui.scene.viser_nodes import NO_LINES, segments

IMPLANT, IMPLANT_CUT, SCREWS = "/implant/body", "/implant/cut", "/implant/screws"
ASTRAY = "/implant/unmapped"
POCKET, POCKET_CUT = "/bed/pocket", "/bed/cut"
THINNEST, THINNEST_LABEL = "/bed/thinnest", "/bed/thinnest_label"
MOVED = "/implant/moved"
CELLS, SAFE, RING = "/chance/cells", "/chance/safe", "/chance/ring"
POCKET_OPACITY = 0.45
EVERY = 2  # cell of the bed is drawn
MARK_MM = 1.6
LABEL_MM = 6.0  # under the thinnest place, so that the bed does not hide it
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
    """Draws the implant in its bed, and its screws."""

    layer = "implant"
    names = (IMPLANT, IMPLANT_CUT, SCREWS)

    def draw(self, new: Snapshot) -> None:
        """Draw body and screws anew, or nothing without a bed."""
        view = new.milling
        self.nodes.remove(SCREWS)  # another one may have screws of another width
        body = None if view is None else view.implant_base()
        draw_cut(self.nodes, (IMPLANT, IMPLANT_CUT), body, STEEL, cut_plane(new))
        if view is None:
            return
        screws = view.implant.screws
        if screws:
            ends = np.array(
                [((s.x_mm, s.y_mm, 0.0), (s.x_mm, s.y_mm, -s.length_mm)) for s in screws]
            )
            pairs = (view.placed.T_base_bed @ ends.reshape(-1, 3)).reshape(-1, 2, 3)
            self.nodes.lines(SCREWS, pairs, YELLOW, width_mm=screws[0].diameter_mm)


class BedLayer(OfBed):
    """Draws the pocket that the burr cuts, and where the least bone is left below it."""

    layer = "bed"
    names = (POCKET, POCKET_CUT, THINNEST, THINNEST_LABEL)

    def draw(self, new: Snapshot) -> None:
        """Draw the pocket anew, or nothing without a bed."""
        view = new.milling
        pocket = None if view is None else pocket_base(view)
        draw_cut(self.nodes, (POCKET, POCKET_CUT), pocket, BONE_RIM, cut_plane(new), POCKET_OPACITY)
        placed = None if view is None else view.placed
        if placed is None or placed.thinnest_base is None:
            self.nodes.remove(THINNEST)
            self.nodes.remove(THINNEST_LABEL)
            return
        at = placed.thinnest_base
        out = placed.T_base_bed.rotation[:, 2]
        self.nodes.cloud(THINNEST, at[None], VERMILLION, size_mm=MARK_MM)
        self.nodes.label(THINNEST_LABEL, bone_words(placed.residual_mm), at - LABEL_MM * out)


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
