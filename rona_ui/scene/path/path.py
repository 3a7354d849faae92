"""Demonstrated, smoothed and painted: path, points, normals, warnings and regions.

Path editing by mouse in steps 5 and 6: path points, pattern centre and boundary. A click gives a
ray. It is intersected with the measured surface, not with the drawn skull, so that the true shape
never enters the path.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.path.messages import (
    DeletePathPoint,
    InsertPathPoint,
    MovePathPoint,
    PaintRegion,
    PinPathSample,
)
from rona_core.app.steps.path.path_checks import check_path
from rona_core.app.steps.path.step import is_kept, nearest_piece, nearest_point, sight
from rona_core.errors import InvalidInputError, RonaError
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.path.zones import PaintedStroke, PaintKind
from rona_core.session.document import Session
from rona_ui.presentation.colors import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    STEEL,
    VERMILLION,
    YELLOW,
    Rgb,
    viridis,
)
from rona_ui.presentation.mouse_input import corners_of, extended, held_place, held_point, holding
from rona_ui.presentation.snapshot import (
    Snapshot,
    changed,
    shown_path,
    shown_path_key,
    shows_margins,
)
from rona_ui.presentation.view_state import PAINTING, Point, ViewState
from rona_ui.scene.viser_nodes import (
    NO_LINES,
    NO_POINTS,
    Layer,
    SceneNodes,
    lift,
    on_bone,
    segments,
    skull_normals,
)

COLORS: dict[PaintKind, Rgb] = {"scan": GREEN, "avoid": VERMILLION}
PAINT_LIFT_MM: dict[PaintKind, float] = {
    "scan": 0.5,
    "avoid": 0.8,
}  # off the skull; avoid lies on top
OPACITY = 0.55
HALVINGS = 3  # of the edges of the drawn skull, so that the rim looks round


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
    mesh = footprint(scene.skull, strokes, PAINT_LIFT_MM[kind])
    if len(mesh.faces):
        nodes.mesh(name, mesh, COLORS[kind], opacity=OPACITY, side="double")
    else:
        nodes.remove(name)


def footprint(skull: Mesh, strokes: tuple[PaintedStroke, ...], lift_mm: float) -> Mesh:
    """Return what strokes cover of a drawn skull, lifted off it along its normals."""
    depths = _depths_mm(strokes, skull.vertices)
    edge_mm = float(np.linalg.norm(np.ptp(skull.vertices[skull.faces[:200]], axis=1), axis=1).max())
    near = skull.faces[(depths[skull.faces] > -edge_mm).any(axis=1)]
    corners = np.concatenate((skull.vertices, skull_normals(skull)), axis=1)[near]  # (k, 3, 6)
    for _ in range(HALVINGS):
        a, b, c = (corners[:, i] for i in range(3))
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    covered = _depths_mm(strokes, corners[:, :, :3].mean(axis=1)) >= 0.0
    points = corners[covered].reshape(-1, 6)
    faces = np.arange(len(points), dtype=np.int64).reshape(-1, 3)
    return Mesh(points[:, :3] + lift_mm * points[:, 3:], faces)


def _depths_mm(strokes: tuple[PaintedStroke, ...], places: Floats) -> Floats:
    depths = np.full(len(places), -np.inf)
    for stroke in strokes:
        depths = np.maximum(depths, stroke.radius_mm - stroke.zone().distances_mm(places))
    return depths


RAW, SMOOTH, CORNERS, AXES = "/path/raw", "/path/smooth", "/path/points", "/path/axes"
DEVIATION, TILTED, THIN = "/path/deviation", "/path/tilted", "/path/thin"
RAW_MM, SMOOTH_MM, CORNERS_MM = 0.3, 0.7, 0.9  # over the bone, the later the higher
LINE_PX, CORNER_PX, MARK_PX = 2.0, 7.0, {TILTED: 11.0, THIN: 8.0}
AXIS_MM, AXIS_PX = 7.0, 1.2
MOST_AXES = 120


class PathLayer(Layer):
    """Draws the demonstrated path in orange; after step 5 it gives way to the smoothed one."""

    layer = "path"
    results = ("path",)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the path where it is another one."""
        if changed(old, new, "static_scene", "session.results.path"):
            raw = new.session.results.path
            points = NO_POINTS if raw is None else raw.value.points_base
            placed = on_bone(points, new.static_scene, RAW_MM)
            self.nodes.lines(RAW, segments(placed), ORANGE, width_px=LINE_PX)
        smoothed = new.session.results.smoothing is not None
        wanted = new.view.step == "path" or not smoothed or new.view.all_layers
        self.nodes.show(RAW, self.shown(new) and _clear(new) and wanted)


class SmoothLayer(Layer):
    """Draws the smoothed path in blue, and in step 6 how far the demonstrated one is from it."""

    layer = "path"
    results = ("smoothing",)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the path where it is another one."""
        fresh = changed(old, new, "static_scene")
        if fresh or old is None or shown_path_key(old) != shown_path_key(new):
            self.draw(new)
        later = self.shown(new) and _clear(new) and (new.view.step != "path" or new.view.all_layers)
        later = later and not shows_margins(new)
        for node in (SMOOTH, CORNERS):
            self.nodes.show(node, later)
        self.nodes.show(DEVIATION, self.shown(new) and new.view.step == "smoothing")

    def draw(self, new: Snapshot) -> None:
        """Draw the smoothed path with its points, and the deviation of the raw one."""
        view, smooth = shown_path(new), new.session.results.smoothing
        corners = dense = NO_POINTS
        if smooth is not None:
            corners, dense = smooth.value.corners_base, smooth.value.path.points_base
        if view is not None:
            corners = view.corners_base
            dense = corners if view.preview else dense
        line = segments(on_bone(dense, new.static_scene, SMOOTH_MM))
        self.nodes.lines(SMOOTH, line, BLUE, width_px=LINE_PX)
        placed = on_bone(corners, new.static_scene, CORNERS_MM)
        self.nodes.dots(CORNERS, placed, BLUE, size_px=CORNER_PX)
        if view is None:
            self.nodes.remove(DEVIATION)
            return
        pairs = segments(on_bone(view.raw_base, new.static_scene, RAW_MM))
        colors = viridis(view.from_raw_mm / max(view.tolerance_mm, 1e-9))
        self.nodes.lines(DEVIATION, pairs, segments(colors), width_px=LINE_PX)


def _clear(snapshot: Snapshot) -> bool:
    """Return whether a path would not hide the points of a scan on it."""
    scanned = snapshot.session.captures.scan is not None and not snapshot.scanning
    return snapshot.view.all_layers or not (snapshot.view.step == "scan" and scanned)


class AxesLayer(Layer):
    """Draws the axes of the probe as short lines out of the bone."""

    layer = "arrows"
    follows = ("session.results.smoothing", "session.setup.devices.probe.name")
    names = (AXES,)
    results = ("smoothing",)

    def shown(self, snapshot: Snapshot) -> bool:
        """Hide them while a preview is dragged: those of a preview are not known."""
        return Layer.shown(self, snapshot) and snapshot.preview_mm is None

    def draw(self, new: Snapshot) -> None:
        """Draw every k-th axis."""
        check, pairs = check_path(new.session), NO_LINES
        if check is not None:
            every = 1 + len(check.sigma_deg) // MOST_AXES
            feet, normals = check.places_base[::every], check.normals[::every]
            pairs = np.stack((feet, feet + AXIS_MM * normals), axis=1)
        self.nodes.lines(AXES, pairs, STEEL, width_px=AXIS_PX)


class WarningsLayer(AxesLayer):
    """Marks places of too large probe tilt, and places to sample again."""

    layer = "warnings"
    follows = (*AxesLayer.follows, "static_scene")
    names = (TILTED, THIN)

    def draw(self, new: Snapshot) -> None:
        """Draw the marks."""
        check = check_path(new.session)
        for node, color in ((TILTED, VERMILLION), (THIN, PURPLE)):
            points = NO_POINTS
            if check is not None:
                points = check.places_base[check.tilted if node == TILTED else check.thin]
            placed = on_bone(points, new.static_scene, SMOOTH_MM)
            self.nodes.dots(node, placed, color, size_px=MARK_PX[node])


EDITING_LIFT_MM = 2.0
HELD_PX = 10.0
MOVED_POINT, MOVE_TARGET = "/edit/grabbed", "/edit/place"
BOUNDARY, CENTER = "/pattern/boundary", "/pattern/center"
MARKS = ("view.drawing", "view.moved_point", "view.move_target", "view.center", "view.boundary")


def point_at(
    session: Session, view: ViewState, eye_base: Vector3, ray: Vector3, phase: str
) -> tuple[ViewState, Any | None]:
    """Return the view after a click on the skull, and the command to send, or None.

    Args:
        session: As it is now.
        view: Its ``drawing`` says what is being done.
        eye_base: Where the eye is (3,), mm.
        ray: Direction of sight (3,).
        phase: "click", or "start", "update" and "end" of a drag.

    Raises:
        RonaError: there is nothing at this place; it says what to do.
    """
    if view.drawing == "move":
        return _move(session, view, eye_base, ray, phase)
    if view.drawing == "boundary":
        if phase == "end":
            return view, None
        corner = _point(sight(session, eye_base, ray))
        return replace(view, boundary=extended(view.boundary, corner)), None
    if view.drawing in PAINTING:
        return _paint(session, view, eye_base, ray, phase)
    if phase not in ("click", "end"):
        return view, None
    if view.drawing == "center":
        return replace(view, center=_point(sight(session, eye_base, ray)), drawing=None), None
    if view.drawing == "pair":
        return replace(view, pair_place=_point(sight(session, eye_base, ray)), drawing=None), None
    if view.drawing == "insert":
        place = sight(session, eye_base, ray)
        after = nearest_piece(corners_of(session), place)
        return view, InsertPathPoint(after, _point(place), _point(eye_base))
    if view.drawing == "delete":
        return view, DeletePathPoint(_found(corners_of(session), eye_base, ray))
    if view.drawing == "pin" and session.results.path is not None:
        sample = _found(session.results.path.value.points_base, eye_base, ray)
        return view, PinPathSample(sample, not is_kept(session, sample))
    return view, None


def _paint(
    session: Session, view: ViewState, eye_base: Vector3, ray: Vector3, phase: str
) -> tuple[ViewState, Any | None]:
    """One drag is one stroke; so is a click."""
    begun = view.stroke if phase in ("update", "end") else ()
    try:
        stroke = extended(begun, _point(sight(session, eye_base, ray)))
    except RonaError:  # beside the surface: reported only if nothing else was painted
        if phase == "click" or (phase == "end" and not begun):
            raise
        stroke = begun
    if phase in ("start", "update"):
        return replace(view, stroke=stroke), None
    kind = PAINTING[view.drawing or ""]
    return replace(view, stroke=()), PaintRegion(kind, stroke, view.brush_mm)


def _move(
    session: Session, view: ViewState, eye_base: Vector3, ray: Vector3, phase: str
) -> tuple[ViewState, Any | None]:
    """Two clicks, or one drag: from a point to its new place."""
    if phase == "start" or (phase == "click" and view.moved_point is None):
        return holding(view, session, _found(corners_of(session), eye_base, ray)), None
    held = held_point(view, session)
    if held is None:
        return view, None
    if phase == "update":
        try:
            return replace(view, move_target=_point(sight(session, eye_base, ray))), None
        except RonaError:  # beside the surface: reported only if it is let go there
            return replace(view, move_target=None), None
    let_go = replace(view, moved_point=None, move_target=None, held_path=None)
    try:
        place = _point(sight(session, eye_base, ray))
    except RonaError:
        if phase == "end":
            return let_go, None
        raise
    return let_go, MovePathPoint(held, place, _point(eye_base))


def _found(points: Floats, eye_base: Vector3, ray: Vector3) -> int:
    number = nearest_point(points, eye_base, ray)
    if number is None:
        raise InvalidInputError("no point of the path lies there: point nearer to one")
    return number


def _point(place: Vector3) -> Point:
    x, y, z = (float(part) for part in place)
    return x, y, z


class EditLayer(Layer):
    """Draws the point being moved, and centre and boundary of a pattern."""

    layer = "path"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the view."""
        view = new.view
        if changed(old, new, "static_scene", "session", *MARKS):
            corners = corners_of(new.session)
            held = held_point(view, new.session)
            up = lift(new, EDITING_LIFT_MM)
            self._mark(MOVED_POINT, None if held is None else corners[held], YELLOW, up)
            self._mark(MOVE_TARGET, held_place(view, new.session), SKY, up)
            ring = np.array(view.boundary, dtype=np.float64).reshape(-1, 3)
            closed = np.vstack((ring, ring[:1])) + up
            pairs = segments(closed) if len(ring) > 1 else NO_LINES
            self.nodes.lines(BOUNDARY, pairs, PURPLE, width_px=4.0)
            self._mark(CENTER, view.center, PURPLE, up)
        for node in (BOUNDARY, CENTER):
            self.nodes.show(node, self.shown(new) and (view.step == "path" or view.all_layers))

    def _mark(self, node: str, place: object, color: Rgb, up: Vector3) -> None:
        points = np.array([] if place is None else [place], dtype=np.float64).reshape(-1, 3)
        self.nodes.dots(node, points + up, color, size_px=HELD_PX)
