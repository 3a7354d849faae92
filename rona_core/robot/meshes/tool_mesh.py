"""Drawn meshes of the tool: force sensor, holder, probe and marker plate on a flange."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.devices.protocols import Mesh
from rona_core.robot.collision.solids import (
    along_axis,
    ball,
    force_sensor,
    merged,
    moved,
    rod,
    slab,
    turned,
)
from rona_core.robot.kinematics.robot_model import RobotModel

Rgb = tuple[int, int, int]

WHITE: Rgb = (232, 230, 222)
GREY: Rgb = (74, 79, 86)
STEEL: Rgb = (176, 182, 188)
BLACK: Rgb = (38, 40, 44)
DELAY_LINE: Rgb = (120, 196, 214)
SPHERE: Rgb = (214, 220, 226)

SPHERE_RADIUS_MM = 5.75  # the common reflective marker
PROBE_RADIUS_MM = 3.175  # a quarter of an inch across


@dataclass(frozen=True, slots=True, eq=False)
class LinkShape:
    """One coloured solid that moves with a link."""

    frame: int  # index of the link frame of ``RobotModel.joint_poses`` it is attached to
    name: str
    color_rgb: Rgb  # 0 to 255
    mesh: Mesh  # mm, in that link frame


def tool_shapes(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the solids on the flange; all move with link 6."""
    return (
        LinkShape(6, "force sensor", BLACK, force_sensor()),
        *_tool(model),
        *_marker_plate(model),
    )


def _tool(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return holder, probe body and delay line, built about the tool axis (z of ``tip``)."""
    T_flange_tip = model.T_flange_tip
    height_mm = float(T_flange_tip.translation[2])
    plate = turned(((0, 22), (36, 22), (36, 30), (0, 30)), edge_mm=2.0)
    block = slab((30.0, 24.0), (height_mm, 17.0), (-17.0, 17.0), edge_mm=5.0)
    clamp = turned(((0, -128), (27, -128), (27, -92), (0, -92)), edge_mm=4.0)
    body = turned(
        ((0, -136), (14, -136), (19, -128), (19, -66), (12, -46), (9, -34), (0, -34)), edge_mm=4.0
    )
    ring = turned(((0, -36), (10, -36), (10, -30), (0, -30)), around=24)
    cone = turned(((0, -30), (8.5, -30), (PROBE_RADIUS_MM, 0.0), (0, 0)), around=24)
    solids = (
        ("probe body", STEEL, body),
        ("probe ring", BLACK, ring),
        ("delay line", DELAY_LINE, cone),
    )
    return (
        LinkShape(6, "tool holder", GREY, merged(plate, block, moved(clamp, T_flange_tip))),
        *(LinkShape(6, name, color, moved(mesh, T_flange_tip)) for name, color, mesh in solids),
    )


def _marker_plate(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the rigid body of four reflective balls on a cross, carried by a stem."""
    T_flange_toolmarker = model.T_flange_toolmarker
    positions = GEOMETRIES["toolmarker"].positions_marker
    behind = np.array((0.0, 0.0, -12.0))
    hub = positions.mean(axis=0) + behind
    bars = [rod(hub + 0.15 * (place - hub), place, 4.0) for place in positions + behind]
    posts = [rod(position + behind, position, 2.2) for position in positions]
    T_toolmarker_tip = T_flange_toolmarker.inv() @ model.T_flange_tip
    root = T_toolmarker_tip @ np.array((0.0, 0.0, -112.0))
    stem = rod(root, hub, 6.0)
    disc = along_axis(turned(((0, -4), (13, -4), (13, 4), (0, 4)), edge_mm=2.0), "z", hub)
    balls = merged(*(along_axis(ball(SPHERE_RADIUS_MM), "z", position) for position in positions))
    cross = merged(*bars, *posts, stem, disc)
    return (
        LinkShape(6, "marker plate", BLACK, moved(cross, T_flange_toolmarker)),
        LinkShape(6, "marker balls", SPHERE, moved(balls, T_flange_toolmarker)),
    )
