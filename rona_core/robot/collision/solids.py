"""Solids of robot and tool: turned parts, slabs, rods and balls, edges rounded.

Vertices are shared within a smooth face and doubled along sharp edges, so that a viewer that
averages normals over shared vertices shades both as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.protocols import Mesh
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import Pose

AROUND = 26  # vertices around a turned part
CREASE_RAD = np.deg2rad(40.0)  # a profile that bends by more has an edge there
ARC_POINTS = 3  # of a rounded edge


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A named solid that moves with a link."""

    frame: int  # index of the link frame of ``RobotModel.joint_poses`` it is attached to
    name: str
    mesh: Mesh  # mm, in that link frame


def rounded(profile: Sequence[tuple[float, float]], radius_mm: float) -> Floats:
    """Return a profile (m, 2) of (radius, height) with its inner corners rounded."""
    corners = np.array(profile, dtype=np.float64)
    points = [corners[0]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        back, ahead = before - corner, after - corner
        reach = min(radius_mm, np.linalg.norm(back) / 2.0, np.linalg.norm(ahead) / 2.0)
        a = corner + reach * back / np.linalg.norm(back)
        b = corner + reach * ahead / np.linalg.norm(ahead)
        for t in np.linspace(0.0, 1.0, ARC_POINTS):  # a parabola through both ends
            points.append((1 - t) ** 2 * a + 2 * t * (1 - t) * corner + t**2 * b)
    points.append(corners[-1])
    return np.array(points)


def turned(
    profile: Sequence[tuple[float, float]], *, edge_mm: float = 0.0, around: int = AROUND
) -> Mesh:
    """Return the solid that a profile of (radius, height) from bottom to top makes about z."""
    outline = rounded(profile, edge_mm) if edge_mm > 0.0 else np.array(profile, dtype=np.float64)
    angles = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    circle = np.stack((np.cos(angles), np.sin(angles), np.zeros(around)), axis=1)
    loops = [r * circle + np.array((0.0, 0.0, z)) for r, z in outline]
    return _creased(loops, outline)


def slab(
    bottom_mm: tuple[float, float],
    top_mm: tuple[float, float],
    y_mm: tuple[float, float],
    *,
    edge_mm: float,
) -> Mesh:
    """Return a plate across y whose outline is the hull of two circles in the x-z plane.

    Args:
        bottom_mm: Height and radius of the lower circle.
        top_mm: Height and radius of the upper circle.
        y_mm: From where to where the plate reaches.
        edge_mm: Rounding of its edges.
    """
    (z0, r0), (z1, r1), (y0, y1) = bottom_mm, top_mm, y_mm
    tilt = np.arcsin(np.clip((r0 - r1) / (z1 - z0), -1.0, 1.0))
    upper = np.linspace(tilt, np.pi - tilt, AROUND // 2)
    lower = np.linspace(np.pi - tilt, 2.0 * np.pi + tilt, AROUND // 2)
    angles = np.concatenate((upper, lower))
    heights = np.repeat((z1, z0), AROUND // 2)
    radii = np.repeat((r1, r0), AROUND // 2)
    quarter = np.linspace(0.0, np.pi / 2.0, ARC_POINTS + 1)
    insets = edge_mm * np.concatenate((1.0 - np.sin(quarter), 1.0 - np.sin(quarter[::-1])))
    ys = np.concatenate(
        (y0 + edge_mm * (1 - np.cos(quarter)), y1 - edge_mm * (1 - np.cos(quarter[::-1])))
    )
    loops = [
        np.stack(
            (
                (radii - inset) * np.cos(angles),
                np.full(AROUND, y),
                heights + (radii - inset) * np.sin(angles),
            ),
            axis=1,
        )[::-1]
        for inset, y in zip(insets, ys, strict=True)
    ]
    first, last = (np.tile((0.0, y, (z0 + z1) / 2.0), (AROUND, 1)) for y in (y0, y1))
    return merged(_strip([first, loops[0]]), _strip(loops), _strip([loops[-1], last]))


def ball(radius_mm: float, *, around: int = 14) -> Mesh:
    """Return a sphere about the origin."""
    tilts = np.linspace(-np.pi / 2.0, np.pi / 2.0, around // 2 + 1)
    profile = [(radius_mm * np.cos(t), radius_mm * np.sin(t)) for t in tilts]
    return turned(profile, around=around)


def rod(start: ArrayLike, end: ArrayLike, radius_mm: float, *, around: int = 9) -> Mesh:
    """Return a round bar between two points (3,)."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    profile = ((0.0, 0.0), (radius_mm, 0.0), (radius_mm, length), (0.0, length))
    bar = turned(profile, around=around)
    return moved(bar, _along((b - a) / length, a))


def along_axis(mesh: Mesh, axis: str, at: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a mesh made about z turned to lie about ``axis`` (x, y or z), then shifted."""
    directions = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    return moved(mesh, _along(np.array(directions[axis]), np.asarray(at, dtype=np.float64)))


def moved(mesh: Mesh, pose: Pose) -> Mesh:
    """Return the mesh at another pose."""
    return Mesh(readonly(pose @ mesh.vertices), mesh.faces)


def merged(*meshes: Mesh) -> Mesh:
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return Mesh(readonly(vertices), readonly(np.concatenate(faces)))


def _along(direction: Floats, at: Floats) -> Pose:
    """Return the pose whose z axis has a direction (3,)."""
    helper = np.array((0.0, 1.0, 0.0)) if abs(direction[1]) < 0.9 else np.array((0.0, 0.0, 1.0))
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return Pose(np.column_stack((x, np.cross(direction, x), direction)), at)


def _creased(loops: list[Floats], outline: Floats) -> Mesh:
    """Return strips between loops, with loops doubled where the outline has an edge."""
    steps = np.diff(outline, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    edges = np.flatnonzero(np.abs(np.diff(headings)) > CREASE_RAD) + 1
    cuts = [0, *edges.tolist(), len(loops) - 1]
    return merged(*(_strip(loops[a : b + 1]) for a, b in pairwise(cuts)))


def _strip(loops: list[Floats]) -> Mesh:
    """Return the surface between successive loops of equal count; faces without area left out."""
    count, rows = len(loops[0]), len(loops)
    vertices = np.concatenate(loops)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(rows - 1), np.arange(count), indexing="ij"))
    k = (j + 1) % count
    a, b, c, d = i * count + j, i * count + k, (i + 1) * count + k, (i + 1) * count + j
    faces: Ints = np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1))).astype(np.int64)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return Mesh(readonly(vertices), readonly(faces[np.linalg.norm(normals, axis=1) > 1e-9]))


def force_sensor() -> Mesh:
    """Return the force sensor between flange and tool, in ``flange``."""
    return turned(((0, 0), (42, 0), (42, 22), (0, 22)), edge_mm=3.0)
