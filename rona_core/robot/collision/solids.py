"""Solids of robot and tool: turned parts, slabs, rods and balls, edges rounded.

Vertices are shared within a smooth face and doubled along sharp edges, so that a viewer that
averages normals over shared vertices shades both as they are.

Solids of the UR arms: tubes between round joint housings with covers. Their hulls are the collision
bodies of these arms, and they are what is drawn of them. Each solid is nearly convex, so that its
hull is a close bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.wrists import ParallelArm

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


JOINT_RADIUS = 0.44  # of the lateral offset of the shoulder
ELBOW_RADIUS = 0.84  # of the joint
WRIST_RADIUS = 0.40  # of the distance between axes 4 and 6
SPREAD = 0.48  # half the width of the upper arm's housings, of that lateral offset
ELBOW_SPLIT = 0.35  # where upper arm and forearm meet, of the way between them
PLATE_MM = 26.0  # the turning flange is so thick


def ur_solids(arm: ParallelArm) -> tuple[Solid, ...]:
    """Return the solids of a UR arm without its tool."""
    return (*_column(arm), *_upper_arm(arm), *_forearm(arm), *_wrist(arm))


def radii_mm(arm: ParallelArm) -> tuple[float, float, float]:
    """Return the radii of the housings at shoulder, elbow and wrist."""
    joint = JOINT_RADIUS * arm.shoulder_side_mm
    return joint, ELBOW_RADIUS * joint, WRIST_RADIUS * arm.wrist_mm


def _round(radius: float, low: float, high: float, *, edge: float = 8.0) -> Mesh:
    """Return a cylinder about z with rounded edges."""
    return turned(((0, low), (radius, low), (radius, high), (0, high)), edge_mm=edge)


def _across(
    radius: float, low: float, high: float, height: float = 0.0, *, edge: float = 8.0
) -> Mesh:
    """Return a cylinder about y at a height on z."""
    return along_axis(_round(radius, low, high, edge=edge), "y", (0.0, 0.0, height))


def _column(arm: ParallelArm) -> tuple[Solid, ...]:
    joint, _, _ = radii_mm(arm)
    top = arm.shoulder_mm - 0.78 * joint
    foot = turned(
        ((0, 0), (joint + 16, 0), (joint + 16, 12), (joint + 2, 20), (joint - 2, top), (0, top)),
        edge_mm=4.0,
    )
    neck = arm.shoulder_side_mm * (1.0 - SPREAD)
    body = _round(joint, -0.78 * joint, 0.8 * joint)
    ring = _across(0.92 * joint, neck - 8, neck, edge=0.0)
    cover = turned(
        ((0, 0.78 * joint), (0.9 * joint, 0.78 * joint), (0.8 * joint, joint), (0, joint))
    )
    return (
        Solid(0, "base", foot),
        Solid(1, "shoulder", body),
        Solid(1, "shoulder neck", _across(0.97 * joint, 0.0, neck - 6)),
        Solid(1, "shoulder ring", ring),
        Solid(1, "shoulder cover", cover),
    )


def _upper_arm(arm: ParallelArm) -> tuple[Solid, ...]:
    joint, elbow, _ = radii_mm(arm)
    half = SPREAD * arm.shoulder_side_mm
    meeting = ELBOW_SPLIT * arm.elbow_side_mm
    length = arm.upper_arm_mm
    root = _across(joint, -half, half - 12)
    head = _across(elbow, meeting, half - 12, length)
    return (
        Solid(2, "upper arm root", root),
        Solid(2, "upper arm", _round(0.72 * joint, 0.0, length, edge=0.0)),
        Solid(2, "upper arm head", head),
        Solid(2, "root cover", _across(0.94 * joint, half - 14, half, edge=6.0)),
        Solid(2, "head cover", _across(0.94 * elbow, half - 14, half, length, edge=6.0)),
    )


def _forearm(arm: ParallelArm) -> tuple[Solid, ...]:
    _, elbow, wrist = radii_mm(arm)
    inner = (ELBOW_SPLIT - 1.0) * arm.elbow_side_mm  # where it meets the upper arm
    low, length = -0.9 * elbow, arm.forearm_mm
    head = _across(1.05 * wrist, -wrist, arm.wrist_side_mm - wrist, length, edge=5.0)
    root_cover = _across(0.85 * elbow, low, low + 14, edge=6.0)
    head_cover = _across(wrist, -wrist - 10, -wrist + 2, length, edge=4.0)
    return (
        Solid(3, "forearm root", _across(0.9 * elbow, low + 12, inner)),
        Solid(3, "forearm", _round(0.62 * elbow, 0.0, length, edge=0.0)),
        Solid(3, "forearm head", head),
        Solid(3, "forearm root cover", root_cover),
        Solid(3, "forearm head cover", head_cover),
    )


def _wrist(arm: ParallelArm) -> tuple[Solid, ...]:
    _, _, wrist = radii_mm(arm)
    first = merged(
        _across(wrist, -wrist, wrist, edge=5.0),
        _round(0.96 * wrist, 0.0, arm.wrist_mm - wrist, edge=0.0),
    )
    first_cover = _round(0.92 * wrist, -wrist - 9, -0.6 * wrist, edge=4.0)
    plate = arm.flange_mm - PLATE_MM
    second = merged(
        _round(wrist, -wrist, wrist, edge=5.0), _across(0.96 * wrist, 0.0, plate, edge=0.0)
    )
    second_cover = _across(0.92 * wrist, -wrist - 9, -0.6 * wrist, edge=4.0)
    flange = _round(0.92 * wrist, -PLATE_MM, 0.0, edge=3.0)
    return (
        Solid(4, "wrist 1", first),
        Solid(4, "wrist 1 cover", first_cover),
        Solid(5, "wrist 2", second),
        Solid(5, "wrist 2 cover", second_cover),
        Solid(6, "flange", flange),
    )
