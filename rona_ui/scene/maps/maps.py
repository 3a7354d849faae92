"""Step 9: boundary maps in viridis, positions of A-scans, reference points, tilted passes."""

import numpy as np

from rona_core.app.dependencies.staleness import CAPTURE, stale_reason
from rona_core.app.steps.acoustics.view import ReferenceRow, reference_rows
from rona_core.app.steps.boundaries.ascan_view import ScanName, scan_number_at, scan_poses
from rona_core.app.steps.boundaries.step import (
    CAPTURES,
    DETECTIONS,
    detection_of_scan,
    scans_of,
)
from rona_core.app.steps.handheld.derivation import HAND_POSES
from rona_core.app.steps.maps.view import SecondView, layers_of, second_cells, second_view
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.mesh import Mesh
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_ui.presentation.colors import (
    BONE_RIM,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    YELLOW,
    Rgb,
    diverging,
    viridis,
)
from rona_ui.presentation.snapshot import (
    Snapshot,
    changed,
    map_errors,
    map_sigma,
    shown_growing_map,
    shown_maps,
    shown_maps_key,
    shown_volume,
    shows_handheld_maps,
    shows_second_path,
)
from rona_ui.scene.cut_plane import Plane, crossings, cut_key, cut_plane
from rona_ui.scene.viser_nodes import (
    NO_LINES,
    NO_POINTS,
    Layer,
    SceneNodes,
    grid_faces,
    lift,
    on_bone,
    segments,
)

NODE = "/scan/growing"
SIZE_MM = 1.2
GROWING_LIFT_MM = 2.2  # so that neither the skull nor the path hides it


class GrowingMapLayer(Layer):
    """Draws the outer boundary as far as the robot has scanned it."""

    layer = "scan"

    def shown(self, snapshot: Snapshot) -> bool:
        """Show it in every step while the robot scans, afterwards where A-scans are shown."""
        wanted = snapshot.scanning and self.layer not in snapshot.view.hidden
        return wanted or super().shown(snapshot)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the map where it has grown; remove it once there is a real one."""
        growing = shown_growing_map(new)
        if growing is None:
            self.nodes.remove(NODE)
            return
        if old is None or shown_growing_map(old) is not growing:
            share = (growing.heights_mm - growing.low_mm) / (growing.high_mm - growing.low_mm)
            points = growing.points_base + lift(new, GROWING_LIFT_MM)
            self.nodes.cloud(NODE, points, viridis(share), size_mm=SIZE_MM)
        self.nodes.show(NODE, self.shown(new))


class OfMaps(Layer):
    """What is drawn of maps; it gives way while the echo volume is looked at, as it lies in it."""

    def stale(self, snapshot: Snapshot) -> bool:
        """Return whether the shown maps are stale."""
        name = "sono_maps" if shows_handheld_maps(snapshot) else "maps"
        return stale_reason(name, snapshot.session) is not None

    def shown(self, snapshot: Snapshot) -> bool:
        """Return whether the layer is switched on, and the volume is not in its place."""
        return super().shown(snapshot) and shown_volume(snapshot) is None


BAND, OUTER, INNER = "/cut_bone", "/cut_outer", "/cut_inner"
MAPS = ("outer", "inner", "fused")


class ProfileLayer(OfMaps):
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


SCAN, NOW = "/scan/points", "/scan/now"
LIFT_MM = 0.8  # of the places of A-scans over the bone
SCAN_PX, NOW_PX = 4.0, 13.0


class MapLayer(OfMaps):
    """Draws one of the three maps."""

    def __init__(self, nodes: SceneNodes, name: str) -> None:
        super().__init__(nodes)
        self.layer = name
        self._node = f"/maps/{name}"

    def shown(self, snapshot: Snapshot) -> bool:
        """Leave the colours to the probability of a bed where that is shown."""
        chances = snapshot.view.step == "implant" and snapshot.view.shows("chance")
        return super().shown(snapshot) and not chances

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the map where it, its quantity or its cut is another one."""
        if old is None or _map_key(old) != _map_key(new):
            self.draw(new)
        self.nodes.show(self._node, self.shown(new))

    def draw(self, new: Snapshot) -> None:
        """Draw the points that the cut leaves."""
        maps = shown_maps(new)
        if maps is None:
            self.nodes.remove(self._node)
            return
        shown = layers_of(maps, new.view.quantity, map_sigma(new), map_errors(new))
        part = shown.part(self.layer)
        points, share = part.points_base, part.values_mm - shown.low_mm
        share = share / (shown.high_mm - shown.low_mm)
        plane = cut_plane(new) if new.view.cut_maps else None
        if plane is not None:
            kept = plane.heights_mm(points) < 0.0
            points, share = points[kept], share[kept]
        colors = diverging if new.view.quantity.startswith("error") else viridis
        self.nodes.cloud(self._node, points, colors(share), size_mm=part.cell_mm)


def _map_key(snapshot: Snapshot) -> tuple[object, ...]:
    """Return the key of a drawing of a map."""
    cut = cut_key(snapshot) if snapshot.view.cut_maps else None
    return shown_maps_key(snapshot), snapshot.view.quantity, id(map_errors(snapshot)), cut


class ScanLayer(Layer):
    """Draws A-scan positions: green where the inner boundary was found, red where not."""

    layer = "scan"

    def stale(self, snapshot: Snapshot) -> bool:
        """Return whether the A-scans or what was detected in them are stale."""
        names = (f"{CAPTURE}{CAPTURES[snapshot.scan]}", DETECTIONS[snapshot.scan])
        return any(stale_reason(name, snapshot.session) for name in names)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the points of the pass that is looked at, and the one under the replay cursor."""
        redrawn = old is None or _scan_key(old) != _scan_key(new)
        moved = old is None or old.scan_cursor != new.scan_cursor
        if redrawn or moved:
            places = on_bone(scan_places(new), new.static_scene, LIFT_MM)
            if redrawn:
                self._draw_points(places, new, new.scan)
            number = None
            if new.scan_cursor is not None:
                number = scan_number_at(new.session, new.scan_cursor, new.scan)
            mark = places[number : number + 1] if number is not None else places[:0]
            self.nodes.dots(NOW, mark, YELLOW, size_px=NOW_PX)
        seen = self.shown(new) and not new.scanning  # while it scans they are of the scan before
        self.nodes.show(SCAN, seen)
        looking = new.scan_cursor is not None and new.view.step == "maps"
        self.nodes.show(NOW, (seen or looking) and not new.scanning)

    def _draw_points(self, places: Floats, new: Snapshot, scan: ScanName) -> None:
        colors = np.tile(np.array(SKY, dtype=np.uint8), (len(places), 1))
        detected = detection_of_scan(new.session, scan)
        if detected is not None:
            found = detected.inner_ok[:, None]
            colors = np.where(found, GREEN, VERMILLION).astype(np.uint8)
        self.nodes.dots(SCAN, places, colors, size_px=SCAN_PX)


def scan_places(snapshot: Snapshot) -> Floats:
    """Return where the A-scans that are looked at were taken (n, 3), as the scene shows them."""
    if snapshot.scan != "hand":
        poses = scan_poses(snapshot.session, snapshot.scan)
        return NO_POINTS if poses is None else poses.translations
    found = HAND_POSES.read(snapshot.session)
    if found is None:
        return NO_POINTS
    frame, poses = found
    if frame == "base":
        return poses.translations
    drawn = None if snapshot.static_scene is None else snapshot.static_scene.T_base_basemarker
    return NO_POINTS if drawn is None else drawn @ poses.translations


def _scan_key(snapshot: Snapshot) -> tuple[object, ...]:
    """Return the key of a drawing of the points."""
    session, results, scan = snapshot.session, snapshot.session.results, snapshot.scan
    of_hand = (id(results.tool), id(results.sono)) if scan == "hand" else ()
    found = results.get(DETECTIONS[scan])
    drawn = id(scans_of(session, scan)), id(found), id(snapshot.static_scene)
    return *drawn, id(session.boundary_edits), scan, *of_hand


POINTS = "/references/points"
REFERENCE_PX = 9.0
POINT_MM, LABEL_MM = 1.0, 4.0  # above the outer boundary


class ReferencesLayer(OfMaps):
    """Draws the reference points of step 9; doubtful ones are orange and labelled so."""

    layer = "references"

    def stale(self, snapshot: Snapshot) -> bool:
        """Return whether the points are of another set-up: they do not rest on the maps."""
        return stale_reason(f"{CAPTURE}references", snapshot.session) is not None

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._labels = 0
        self._rows: tuple[ReferenceRow, ...] = ()

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the points where they, what is said of them, or the region are others."""
        if changed(old, new, "static_scene", "session"):
            rows = reference_rows(new.session)
            moved = changed(old, new, "static_scene", "session.captures.references")
            if moved or rows != self._rows:
                self._rows = rows
                self._draw(new)
        for node in (POINTS, *map(_label, range(self._labels))):
            self.nodes.show(node, self.shown(new))

    def _draw(self, new: Snapshot) -> None:
        held, rows = new.session.captures.references, self._rows
        places = NO_POINTS if held is None else held.places_base
        up = lift(new, 1.0)
        colors = np.array([PURPLE if row.counts else ORANGE for row in rows], dtype=np.uint8)
        self.nodes.dots(POINTS, places + POINT_MM * up, colors.reshape(-1, 3), size_px=REFERENCE_PX)
        for row, place in zip(rows, places, strict=True):
            self.nodes.label(_label(row.number), label_words(row), place + LABEL_MM * up)
        for number in range(len(rows), self._labels):
            self.nodes.remove(_label(number))
        self._labels = len(rows)


def label_words(row: ReferenceRow) -> str:
    """Return the number of a point in the table of the panel, and whether it is doubtful."""
    number = str(row.number + 1)
    return number if row.counts else f"{number} doubtful"


def _label(number: int) -> str:
    return f"/references/label{number}"


PATH, AXES, CELLS = "/second/path", "/second/axes", "/second/cells"
AXIS_MM = 6.0
MOST_AXES = 240
CELLS_MM = 1.2  # of the cells over the bone
CELL_PX = 2.0
WHITE: Rgb = (255, 255, 255)


class SecondLayer(Layer):
    """Draws the second path until it is scanned, and while that pass is selected."""

    layer = "second"
    results = ("maps", "second")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the path where it is another one, and the cells where the maps are."""
        if changed(old, new, "session.results.second", "static_scene"):
            self._draw_path(second_view(new.session), new)
        if changed(old, new, "session.results.maps", "session.captures.second", "static_scene"):
            cells = second_cells(new.session)
            points = NO_POINTS if cells is None else cells.points_base + lift(new, CELLS_MM)
            self.nodes.dots(CELLS, points, WHITE, size_px=CELL_PX)
        shown = self.shown(new) and shown_volume(new) is None
        for node in (PATH, AXES):
            self.nodes.show(node, shown and shows_second_path(new))
        mapped = new.view.shows("inner") and not shows_handheld_maps(new)
        mapped = mapped and not new.view.quantity.startswith("error")  # white is no error there
        self.nodes.show(CELLS, shown and mapped and not self.stale(new))

    def _draw_path(self, view: SecondView | None, new: Snapshot) -> None:
        """Draw the path, and at some places the probe's axis out of the bone."""
        points = axes = NO_POINTS
        if view is not None:
            points = on_bone(view.points_base, new.static_scene, LIFT_MM)
            every = 1 + len(points) // MOST_AXES
            axes = np.stack((points, points - AXIS_MM * view.axes_base), axis=1)[::every]
        self.nodes.lines(PATH, segments(points), SKY, width_px=2.0)
        self.nodes.lines(AXES, axes, SKY, width_px=1.0)
