"""Step 7: roll candidates, path coloured by margins, and the map of base poses."""

import numpy as np
from numpy.typing import NDArray

from rona_core.app.steps.roll.step import PlacementView, placement_view
from rona_core.app.steps.roll.view import (
    PathMargins,
    joint_curves,
    path_margins,
    place_of_roll,
    point_at,
    roll_poses,
    shown_roll,
    shows_varying,
)
from rona_core.app.steps.scan.planned_motion import motion_stale
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_ui.presentation.colors import (
    BLOCKED,
    BLUE,
    GREEN,
    INK,
    ORANGE,
    SKY,
    VERMILLION,
    Rgb,
    viridis,
)
from rona_ui.presentation.snapshot import MARGIN_SCALE_MAX, Snapshot, changed, shows_margins
from rona_ui.scene.viser_nodes import (
    NO_LINES,
    NO_POINTS,
    Layer,
    SceneNodes,
    lift,
    on_bone,
    segments,
)

WORKS, FAILS, CHOSEN = "/rolls/works", "/rolls/fails", "/rolls/shown"
FOOT_MM, HUB_MM = 1.4, 1.5  # from the bone to the fan; from the axis of the probe to an arrow
ARROW_MM, CHOSEN_MM, BARB_MM = 7.5, 10.0, 1.8
MOST_FANS, APART_MM = 9, 17.0  # fans along the path, and how far they are apart at least
PATH, CASING = "/margins/path", "/margins/casing"
STOP, WORDS = "/margins/stop", "/margins/words"
LIFT_MM, CASING_MM = 0.7, 0.3  # of the path over the bone, and over its dark edge
MAP = "/places/map"
MARKS = (("smallest", "nearest pose", ORANGE), ("best", "largest margin", SKY))
CELL_PX, GAP_PX = 24, 1
OPAQUE, FAINT = 225, 110  # of places that seem to work, and of the others
RING_MM, ABOVE_MM = 90.0, 4.0  # radius of the mark; over the floor, so that it is seen


class RollsLayer(Layer):
    """Draws the rolls as fans of arrows along the path: green if feasible, red if not."""

    layer = "rolls"
    follows = ("session.results.roll", "view.shown_roll", "view.place", "static_scene")
    names = (WORKS, FAILS, CHOSEN)

    def shown(self, snapshot: Snapshot) -> bool:
        """Hide rolls evaluated for another robot, path or work cell."""
        return Layer.shown(self, snapshot) and motion_stale(snapshot.session) is None

    def draw(self, new: Snapshot) -> None:
        """Draw lines, which are unlit, so that their colours are those of the legend."""
        works = fails = chosen = NO_LINES
        searched = new.session.results.roll
        index = shown_roll(new.session, new.view.shown_roll)
        if searched is not None and index is not None:
            plan = searched.value
            looked_at = place_of_roll(new.session, new.view.shown_roll, new.view.place)
            places = spread(plan.search.path.points_base, point_at(plan, looked_at))
            fans, feasible = roll_poses(plan, places)
            drawn = np.array([arrows(poses, ARROW_MM) for poses in fans])
            works = drawn[feasible].reshape(-1, 2, 3)
            fails = drawn[~feasible].reshape(-1, 2, 3)
            rolls_rad = np.deg2rad(plan.search.verdicts[index].roll_deg)
            if shows_varying(plan, new.view.shown_roll):
                rolls_rad = plan.search.rolls_rad
            posed = plan.search.path.Ts_base_probe(rolls_rad).select(places)
            chosen = arrows(posed, CHOSEN_MM)
        self.nodes.lines(WORKS, works, GREEN, width_px=1.6)
        self.nodes.lines(FAILS, fails, VERMILLION, width_px=1.6)
        self.nodes.lines(CHOSEN, chosen.reshape(-1, 2, 3), BLUE, width_px=3.0)


def spread(points: Floats, first: int) -> Ints:
    """Return the numbers of some points (n, 3) far from each other, beginning with ``first``."""
    chosen, apart = [first], np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < MOST_FANS and apart.max() >= APART_MM:
        chosen.append(int(apart.argmax()))
        apart = np.minimum(apart, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def arrows(Ts_base_probe: Poses, length_mm: float) -> Floats:
    """Return an arrow along +x of each probe, off the bone (-z): segments (n, 3, 2, 3) in base."""
    tip, barb = length_mm, length_mm - BARB_MM
    ends = ((HUB_MM, 0.0), (tip, 0.0), (barb, 0.5 * BARB_MM), (tip, 0.0))
    ends = (*ends, (barb, -0.5 * BARB_MM), (tip, 0.0))
    corners_probe = np.array([(x, y, -FOOT_MM) for x, y in ends])
    placed = [pose @ corners_probe for pose in Ts_base_probe]
    return np.array(placed, dtype=np.float64).reshape(-1, 3, 2, 3)


class MarginsLayer(Layer):
    """Draws the path in step 7: viridis for the margin, red where it is infeasible."""

    layer = "path"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw where search, roll, quantity or surroundings are others."""
        if not (self.shown(new) and shows_margins(new)):
            for node in (PATH, CASING, STOP, WORDS):
                self.nodes.remove(node)
            return
        drawn = old is not None and self.shown(old) and shows_margins(old)
        parts = ("session.results", "session.setup", "static_scene", "view.shown_roll")
        if not drawn or changed(old, new, *parts, "view.margin"):
            self.draw(new)

    def draw(self, new: Snapshot) -> None:
        """Draw the path, and where the robot cannot go on."""
        session, shown, up = new.session, new.view.shown_roll, lift(new, LIFT_MM)
        found = path_margins(session, shown)
        points, colors = (NO_POINTS, viridis([])) if found is None else colored(found, new)
        line = segments(on_bone(points, new.static_scene, LIFT_MM))
        self.nodes.lines(CASING, line, INK, width_px=5.0)
        above = segments(on_bone(points, new.static_scene, LIFT_MM + CASING_MM))
        self.nodes.lines(PATH, above, segments(colors), width_px=3.0)
        curves, searched = joint_curves(session, shown), session.results.roll
        if curves is None or searched is None or curves.feasible:
            self.nodes.remove(STOP)
            self.nodes.remove(WORDS)
            return
        verdict = searched.value.search.verdicts[shown_roll(session, shown) or 0]
        stop = searched.value.search.path.points_base[verdict.index] + up
        words = stop_words(verdict.reason, verdict.joint, verdict.value, verdict.limit)
        self.nodes.dots(STOP, stop[None], VERMILLION, size_px=12.0)
        self.nodes.label(WORDS, words, stop + 3.0 * up)


def colored(found: PathMargins, snapshot: Snapshot) -> tuple[Floats, NDArray[np.uint8]]:
    """Return the points of the path (n, 3) and their colours (n, 3)."""
    quantity = snapshot.view.margin
    colors = viridis(found.values(quantity) / MARGIN_SCALE_MAX[quantity])
    colors[found.fails(quantity)] = VERMILLION
    return found.points_base, colors


def stop_words(reason: str, joint: int, value: float, limit: float) -> str:
    """Return the cause of failure as a short label."""
    if reason == "reach":
        return f"out of reach by {-value:.0f} mm"
    if reason == "limit":
        return f"joint {joint}: {value:.1f}° (limit {limit:.1f}°)"
    if reason == "jump":
        return f"joint {joint} jumps by {value:.1f}°"
    if reason == "singularity":
        if joint == 1:
            return f"wrist {value:.0f} mm from axis 1"
        return f"joint {joint} {value:.1f}° from straight"
    return reason


class PlacesLayer(Layer):
    """Draws the map of the last search while it holds."""

    layer = "places"
    follows = ("session.results", "session.setup")
    names = (MAP, *(f"/places/{n}/{part}" for n, _, _ in MARKS for part in ("ring", "label")))

    def __init__(self, nodes: SceneNodes, floor_mm: float) -> None:
        super().__init__(nodes)
        self._height_mm = floor_mm + ABOVE_MM

    def draw(self, new: Snapshot) -> None:
        """Draw the floor map, and a mark for each proposed pose."""
        view = placement_view(new.session)
        self.nodes.remove(MAP)
        for name, words, color in MARKS:
            pose = None if view is None else getattr(view, name)
            self._mark(f"/places/{name}", words, color, pose)
        if view is None:
            return
        cell_mm = np.array((_step(view.x_mm), _step(view.y_mm)))
        middle = np.array((view.x_mm.mean(), view.y_mm.mean(), 0.0))
        place = view.room @ Pose.from_translation(middle)
        lifted = Pose(place.rotation, np.array((*place.translation[:2], self._height_mm)))
        size_mm = cell_mm * (len(view.x_mm), len(view.y_mm))
        self.nodes.image(MAP, place_image(view), lifted, size_mm=(size_mm[0], size_mm[1]))

    def _mark(self, node: str, words: str, color: Rgb, pose: Pose | None) -> None:
        """Draw a ring on the floor, a pole up to the base, and an arrow along its x axis."""
        if pose is None:
            for part in ("/ring", "/label"):
                self.nodes.remove(f"{node}{part}")
            return
        self.nodes.lines(f"{node}/ring", base_mark(pose, self._height_mm), color, width_px=5.0)
        self.nodes.label(f"{node}/label", words, pose.translation)


def base_mark(place: Pose, floor_mm: float) -> Floats:
    """Return ring, pole and arrow of a place as segments (n, 2, 3) in ``base``."""
    angles = np.linspace(0.0, 2.0 * np.pi, 33)
    ring = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(33))) * RING_MM
    arrow = np.array(((0.0, 0, 0), (2.4, 0, 0), (1.9, 0.3, 0), (2.4, 0, 0), (1.9, -0.3, 0)))
    lines = [place @ part for part in (ring, arrow * RING_MM)]
    for line in lines:
        line[:, 2] = floor_mm
    foot = np.array((*place.translation[:2], floor_mm))
    return np.concatenate(
        [*(segments(line) for line in lines), np.stack((foot, place.translation))[None]]
    )


def place_image(view: PlacementView) -> NDArray[np.uint8]:
    """Return the cells as a picture (h, w, 4): x to the right, y upwards."""
    works = (view.margins >= 0.0) & ~view.blocked
    top = max(float(view.margins[works].max(initial=0.0)), 1e-9)
    cells = np.zeros((*works.shape, 4), dtype=np.uint8)
    cells[:, :, :3] = VERMILLION
    cells[:, :, 3] = FAINT
    cells[view.blocked, :3] = BLOCKED
    cells[works, :3] = viridis(np.clip(view.margins[works] / top, 0.0, 1.0))
    cells[works, 3] = OPAQUE
    upright = cells.transpose(1, 0, 2)[::-1]
    image = np.repeat(np.repeat(upright, CELL_PX, axis=0), CELL_PX, axis=1)
    gaps = np.arange(CELL_PX) < GAP_PX
    image[np.tile(gaps, upright.shape[0])] = 0
    image[:, np.tile(gaps, upright.shape[1])] = 0
    return np.ascontiguousarray(image)


def _step(ticks_mm: Floats) -> float:
    return float(ticks_mm[1] - ticks_mm[0]) if len(ticks_mm) > 1 else 100.0
