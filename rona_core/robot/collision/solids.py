"""Solids of robot and tool: turned parts, slabs, rods and balls, edges rounded.

Vertices are shared within a smooth face and doubled along sharp edges, so that a viewer that
averages normals over shared vertices shades both as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose

AROUND = 26  # vertices around a turned part
CREASE_RAD = np.deg2rad(46.0)  # faces that meet at a larger angle have an edge there
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
    return _shaded(trimesh.creation.revolve(outline, sections=around))


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
    angles = 2.0 * np.pi * np.arange(AROUND) / AROUND
    quarter = np.linspace(0.0, np.pi / 2.0, ARC_POINTS + 1)
    insets, depths = edge_mm * (1.0 - np.sin(quarter)), edge_mm * (1.0 - np.cos(quarter))
    points = [
        (radius * np.cos(angles), np.full(AROUND, y), height + radius * np.sin(angles))
        for height, outer in (bottom_mm, top_mm)
        for radius, depth in zip(outer - insets, depths, strict=True)
        for y in (y_mm[0] + depth, y_mm[1] - depth)
    ]
    return _shaded(trimesh.convex.convex_hull(np.concatenate(points, axis=1).T))


def ball(radius_mm: float, *, around: int = 12) -> Mesh:
    """Return a sphere about the origin."""
    return _shaded(trimesh.creation.uv_sphere(radius_mm, count=(around // 2, around)))


def rod(start: ArrayLike, end: ArrayLike, radius_mm: float, *, around: int = 9) -> Mesh:
    """Return a round bar between two points (3,)."""
    return _shaded(
        trimesh.creation.cylinder(radius_mm, segment=np.array((start, end)), sections=around)
    )


def along_axis(mesh: Mesh, axis: str, at: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a mesh made about z turned to lie about ``axis`` (y or z), then shifted."""
    turn = (-np.pi / 2.0, 0.0, 0.0) if axis == "y" else (0.0, 0.0, 0.0)
    return moved(mesh, Pose.from_rotvec(turn, at))


def moved(mesh: Mesh, pose: Pose) -> Mesh:
    """Return the mesh at another pose."""
    return Mesh(readonly(pose @ mesh.vertices), mesh.faces)


def merged(*meshes: Mesh) -> Mesh:
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return Mesh(readonly(vertices), readonly(np.concatenate(faces)))


def force_sensor() -> Mesh:
    """Return the force sensor between flange and tool, in ``flange``."""
    return turned(((0, 0), (42, 0), (42, 22), (0, 22)), edge_mm=3.0)


def _shaded(solid: trimesh.Trimesh) -> Mesh:
    """Return a solid with its vertices doubled along sharp edges."""
    smooth = trimesh.graph.smooth_shade(solid, angle=float(CREASE_RAD))
    vertices: Floats = np.asarray(smooth.vertices, dtype=np.float64)
    return Mesh(readonly(vertices), readonly(np.asarray(smooth.faces, dtype=np.int64)))
