"""Head fixture: a three-pin clamp that holds the head from below, and the ring it rests on.

Scenery: it is no obstacle, and stays below the middle of the head, away from what is scanned.
"""

import numpy as np
import trimesh

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.solids import merged, rod

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
