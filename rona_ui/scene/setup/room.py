"""Operating room: floor, walls, table with the head fixture, and the pedestal of the robot.

Every sheet is seen from its front alone, so that no camera is ever behind something. The table
stands where the set-up says; the rest is scenery and no obstacle.

Head fixture: a three-pin clamp that holds the head from below, and the ring it rests on. Scenery:
it is no obstacle, and stays below the middle of the head, away from what is scanned.
"""

import numpy as np
import trimesh

from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.devices.workcell import workcell_pose
from rona_core.geometry.arrays import Floats, Ints, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.solids import merged, rod, turned
from rona_core.session.document import Session
from rona_ui.presentation.colors import FLOOR, PAD, PEDESTAL, SHEET, STEEL, WALL, Rgb
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.scene.viser_nodes import Layer, SceneNodes

CLEAR_MM = 26.0  # of the clamp's arc from the head
BELOW_MM = 22.0  # of the arc below the middle of the head
LEVEL_MM = 8.0  # half the thickness of the slice of the head that the arc goes round
ENDS_DEG, PINS_DEG = 82.0, (-78.0, 60.0, 78.0)  # from the side of the foot
ARC_MM, SLEEVE_MM, PIN_MM, FOOT_MM = 8.0, 6.0, 2.0, 12.0  # radii
RING_MM = (44.0, 11.0)  # radii of the ring that the head rests on


def head_fixture(skull_base: Floats, top: Pose) -> tuple[Mesh, Mesh]:
    """Return clamp and ring in ``base``.

    Args:
        skull_base: Vertices (n, 3) of the drawn skull.
        top: Middle of the table's top, z upwards, x along the table.
    """
    middle = 0.5 * (skull_base.min(axis=0) + skull_base.max(axis=0))
    at = middle - (0.0, 0.0, BELOW_MM)
    level = skull_base[np.abs(skull_base[:, 2] - at[2]) < LEVEL_MM]
    out = top.rotation[:, 0] * np.sign((middle - top.translation) @ top.rotation[:, 0] or 1.0)
    side = np.cross((0.0, 0.0, 1.0), out)
    reach_mm = float(np.linalg.norm((level - at)[:, :2], axis=1).max()) + CLEAR_MM

    def on_arc(degrees: float) -> Vector3:
        turn = np.deg2rad(degrees)
        return at + reach_mm * (np.cos(turn) * out + np.sin(turn) * side)

    arc = [on_arc(degrees) for degrees in np.linspace(-ENDS_DEG, ENDS_DEG, 25)]
    parts = [tube(np.array(arc), ARC_MM)]
    for start in (on_arc(degrees) for degrees in PINS_DEG):
        way = at - start
        tip = start + _gap_mm(level, start, way) / reach_mm * way
        parts += [rod(start - 0.12 * way, start + 0.6 * (tip - start), SLEEVE_MM)]
        parts += [rod(start, tip, PIN_MM)]
    foot = on_arc(0.0)
    parts.append(rod(np.array((*foot[:2], top.translation[2] - 60.0)), foot, FOOT_MM))
    return merged(*parts), rest(skull_base)


def rest(skull_base: Floats) -> Mesh:
    """Return the ring under the lowest place of the head; it touches the head and is not in it."""
    major, minor = RING_MM
    lowest = skull_base[np.argmin(skull_base[:, 2])]
    aside = np.linalg.norm(skull_base[:, :2] - lowest[:2], axis=1) - major
    over = (np.abs(aside) < minor) & (skull_base[:, 2] < skull_base[:, 2].mean())
    above = skull_base[over, 2] - np.sqrt(minor**2 - aside[over] ** 2)
    height = float(above.min(initial=float(lowest[2])))
    ring = trimesh.creation.torus(major, minor, major_sections=32, minor_sections=10)
    placed = np.asarray(ring.vertices) + (*lowest[:2], height)
    return Mesh(placed, np.asarray(ring.faces, dtype=np.int64))


def tube(line: Floats, radius_mm: float, around: int = 10) -> Mesh:
    """Return a tube along a level line (n, 3), closed at both ends by a point."""
    ahead = np.gradient(line, axis=0)
    aside = np.cross(ahead, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    turns = 2.0 * np.pi * np.arange(around) / around
    rings = line[:, None] + radius_mm * (
        np.cos(turns)[:, None] * aside[:, None] + np.sin(turns)[:, None] * np.array((0.0, 0.0, 1.0))
    )
    corner = np.arange(around)
    following = (corner + 1) % around
    first = np.concatenate(
        (
            np.column_stack((corner, following, corner + around)),
            np.column_stack((following, following + around, corner + around)),
        )
    )
    sides = (first + around * np.arange(len(line) - 1)[:, None, None]).reshape(-1, 3)
    last = around * (len(line) - 1)
    ends = (len(line) * around, len(line) * around + 1)
    caps = (
        np.column_stack((following, corner, np.full(around, ends[0]))),
        np.column_stack((last + corner, last + following, np.full(around, ends[1]))),
    )
    vertices = np.concatenate((rings.reshape(-1, 3), line[[0, -1]]))
    return Mesh(vertices, np.concatenate((sides, *caps))[:, ::-1].astype(np.int64))


def _gap_mm(level: Floats, start: Vector3, way: Vector3) -> float:
    """Return how far from ``start`` along ``way`` the first of the points (n, 3) beside it is."""
    unit = way / np.linalg.norm(way)
    ahead = (level - start) @ unit
    aside = np.linalg.norm(level - start - ahead[:, None] * unit, axis=1)
    return float(ahead[aside <= aside.min() + LEVEL_MM].min())


GROUND, WALLS, PLINTH = "/room/floor", "/room/walls", "/room/pedestal"
TABLE, FRAME, COLUMN = "/room/table", "/room/frame", "/room/column"
FIXTURE, REST = "/room/fixture", "/room/rest"
ON_FLOOR, ON_TABLE = "/room/shade_floor", "/room/shade_table"
NAMES = (GROUND, WALLS, PLINTH, TABLE, FRAME, COLUMN, FIXTURE, REST, ON_FLOOR, ON_TABLE)
REACH_MM = (-2600.0, -2600.0, 3000.0, 2400.0)  # of the floor: least x and y, largest x and y
HEIGHT_MM = 2600.0  # of the walls over the floor
BEHIND_MM = 500.0  # of the walls behind the tracker, where it stands far out
PLINTH_MM = (190.0, 210.0)  # radius of the pedestal above and below
MATTRESS_MM = 40.0
SHADE, RINGS, AROUND = 0.55, 6, 28  # light that is missing in the middle of a shade; its grid
SHADE_MM = (420.0, 480.0, 150.0)  # radii of the shades of pedestal, tracker and head


class RoomLayer(Layer):
    """Draws what gives the scene its place; quiet, and never before the bone."""

    layer = "room"
    names = NAMES

    def __init__(self, nodes: SceneNodes, floor_mm: float) -> None:
        super().__init__(nodes)
        self._floor_mm = floor_mm

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the room where robot, tracker, table or head stand anew."""
        scene = new.static_scene
        if scene is not None and changed(old, new, "static_scene", "session.setup"):
            self._draw(new.session, scene)
        for name in self.names:
            self.nodes.show(name, self.shown(new))

    def _draw(self, session: Session, scene: StaticScene) -> None:
        room = workcell_pose(session.setup.devices.robot)
        floor, walls = stage(scene.T_base_tracker, room, self._floor_mm)
        self.nodes.mesh(GROUND, floor, FLOOR)
        self.nodes.mesh(WALLS, walls, WALL)
        self.nodes.mesh(PLINTH, pedestal(self._floor_mm), PEDESTAL)
        ground = self._floor_mm + 1.0
        tracker = scene.T_base_tracker.translation
        standing = [
            (np.array((0.0, 0.0, ground)), SHADE_MM[0] * np.eye(3)[:2]),
            (np.array((*tracker[:2], ground)), SHADE_MM[1] * np.eye(3)[:2]),
        ]
        table = next((t for t in session_obstacles(session).things if t.name == "table"), None)
        if table is None:
            for name in (TABLE, FRAME, COLUMN, FIXTURE, REST, ON_TABLE):
                self.nodes.remove(name)
            self._shade(ON_FLOOR, standing, FLOOR)
            return
        size = np.array(session.setup.surroundings.table_size_mm)
        top = table.pose @ Pose.from_translation((0.0, 0.0, 0.5 * size[2]))
        legs = self._floor_mm - float(top.translation[2])
        self.nodes.mesh(TABLE, block(top, size[:2] - 30.0, 4.0, -MATTRESS_MM), SHEET)
        self.nodes.mesh(FRAME, block(top, size[:2], -MATTRESS_MM, -size[2]), STEEL)
        column = block(top, np.array((0.34, 0.5)) * size[:2], -size[2], legs)
        self.nodes.mesh(COLUMN, column, PEDESTAL)
        under = np.array((*top.translation[:2], ground))
        standing.append((under, (0.62 * size[:2, None]) * top.rotation.T[:2]))
        self._shade(ON_FLOOR, standing, FLOOR)
        head = 0.5 * (scene.skull.vertices.min(axis=0) + scene.skull.vertices.max(axis=0))
        on_top = np.array((*head[:2], top.translation[2] + 5.0))
        self._shade(ON_TABLE, [(on_top, SHADE_MM[2] * np.eye(3)[:2])], SHEET)
        clamp, rest = head_fixture(scene.skull.vertices, top)
        self.nodes.mesh(FIXTURE, clamp, STEEL)
        self.nodes.mesh(REST, rest, PAD, side="double")

    def _shade(self, name: str, discs: list[tuple[Vector3, Floats]], color: Rgb) -> None:
        mesh, shades = shade(discs)
        self.nodes.shaded_mesh(name, mesh, color, shades)


def shade(discs: list[tuple[Vector3, Floats]]) -> tuple[Mesh, Floats]:
    """Return flat ellipses, seen from above, and their light (n,), that fades to 1 at the rim.

    Args:
        discs: Middle (3,) and the two semi-axes (2, 3) of each.
    """
    turns = 2.0 * np.pi * np.arange(AROUND) / AROUND
    radii = np.repeat(np.arange(1, RINGS + 1) / RINGS, AROUND)
    flat = radii[:, None] * np.tile(np.column_stack((np.cos(turns), np.sin(turns))), (RINGS, 1))
    flat = np.vstack((np.zeros((1, 2)), flat))
    light = 1.0 - SHADE * (1.0 - np.append(0.0, radii) ** 2) ** 2
    inner = np.arange(AROUND) + 1
    after = np.roll(inner, -1)
    fan = np.column_stack((np.zeros_like(inner), inner, after))
    quads = [
        np.column_stack(pair)
        for pair in ((inner, inner + AROUND, after + AROUND), (inner, after + AROUND, after))
    ]
    ring = np.concatenate(quads)
    faces = np.concatenate((fan, *(ring + k * AROUND for k in range(RINGS - 1))))
    vertices = np.concatenate([middle + flat @ axes for middle, axes in discs])
    numbers = np.concatenate([faces + k * len(flat) for k in range(len(discs))])
    return Mesh(vertices, numbers.astype(np.int64)), np.tile(light, len(discs))


def sheet(corner: Vector3, u: Vector3, v: Vector3) -> tuple[Floats, Ints]:
    """Return corners (4, 3) and faces (2, 3) of a rectangle, seen from where u to v turns left."""
    corners = np.array((corner, corner + u, corner + u + v, corner + v))
    return corners, np.array(((0, 1, 2), (0, 2, 3)))


def joined(parts: list[tuple[Floats, Ints]]) -> Mesh:
    """Return sheets as one mesh, each with corners of its own."""
    offsets = np.cumsum([0, *(len(corners) for corners, _ in parts[:-1])])
    faces = [faces + offset for (_, faces), offset in zip(parts, offsets, strict=True)]
    vertices = np.concatenate([corners for corners, _ in parts])
    return Mesh(vertices, np.concatenate(faces).astype(np.int64))


def stage(T_base_tracker: Pose, room: Pose, floor_mm: float) -> tuple[Mesh, Mesh]:
    """Return the floor, and two walls behind head and tracker, in ``base``."""
    tracker = room.inv() @ T_base_tracker.translation
    left, front, right, back = REACH_MM
    right, back = max(right, tracker[0] + BEHIND_MM), max(back, tracker[1] + BEHIND_MM)
    x, y, z = np.eye(3)
    deep, wide, up = (back - front) * y, (right - left) * x, HEIGHT_MM * z
    floor = joined([sheet(np.array((left, front, floor_mm)), wide, deep)])
    walls = joined(
        [
            sheet(np.array((right, back, floor_mm)), -deep, up),
            sheet(np.array((left, back, floor_mm)), wide, up),
        ]
    )
    return Mesh(room @ floor.vertices, floor.faces), Mesh(room @ walls.vertices, walls.faces)


def block(top: Pose, size_mm: Floats, high_mm: float, low_mm: float) -> Mesh:
    """Return top and sides of a box that is open below, in ``base``; heights count from ``top``."""
    a, b = 0.5 * size_mm
    x, y, z = np.eye(3)
    fall = (high_mm - low_mm) * z
    ring = [
        np.array(p) for p in ((-a, -b, low_mm), (a, -b, low_mm), (a, b, low_mm), (-a, b, low_mm))
    ]
    parts = [sheet(np.array((-a, -b, high_mm)), 2.0 * a * x, 2.0 * b * y)]
    parts += [sheet(p, q - p, fall) for p, q in zip(ring, (*ring[1:], ring[0]), strict=True)]
    mesh = joined(parts)
    return Mesh(top @ mesh.vertices, mesh.faces)


def pedestal(floor_mm: float) -> Mesh:
    """Return what the robot stands on."""
    above, below = PLINTH_MM
    return turned(((0.0, floor_mm), (below, floor_mm), (above, -1.0), (0.0, -1.0)), around=40)
