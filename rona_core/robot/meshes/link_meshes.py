"""Drawn meshes of the robots and the tool: solids from the published dimensions, for the eye only.

The outlines of the RX90 follow its drawing (docs/algorithms/robot/rx90.md), those of the other arms
their lengths; they are not the makers' geometry and no input of any algorithm.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from rona_core.geometry.mesh import Mesh
from rona_core.robot.collision.solids import (
    along_axis,
    ball,
    force_sensor,
    merged,
    moved,
    rod,
    slab,
    turned,
    ur_solids,
)
from rona_core.robot.kinematics.robot_model import RobotModel, Spindle
from rona_core.robot.kinematics.wrists import ParallelArm, SphericalWristArm

Rgb = tuple[int, int, int]

WHITE: Rgb = (232, 230, 222)
GREY: Rgb = (74, 79, 86)
STEEL: Rgb = (176, 182, 188)
BLACK: Rgb = (38, 40, 44)
DELAY_LINE: Rgb = (120, 196, 214)
SPHERE: Rgb = (214, 220, 226)
YELLOW: Rgb = (242, 190, 58)
TUBE: Rgb = (206, 210, 214)
HOUSING: Rgb = (222, 225, 228)
COVER: Rgb = (108, 160, 204)
BURR_STEEL: Rgb = (150, 128, 74)  # coated
UR_COLORS: dict[Rgb, tuple[str, ...]] = {
    STEEL: ("base", "shoulder ring", "flange"),
    HOUSING: ("shoulder", "shoulder neck", "wrist 1", "wrist 2"),
    COVER: (
        "shoulder cover",
        "root cover",
        "head cover",
        "forearm root cover",
        "forearm head cover",
        "wrist 1 cover",
        "wrist 2 cover",
    ),
    TUBE: (
        "upper arm root",
        "upper arm",
        "upper arm head",
        "forearm root",
        "forearm",
        "forearm head",
    ),
}
SPHERE_RADIUS_MM = 5.75  # the common reflective marker
PROBE_RADIUS_MM = 3.175  # a quarter of an inch across
ARM_SIDE_MM = (96.0, 188.0)  # the upper arm runs beside the plane of the wrist


@dataclass(frozen=True, slots=True, eq=False)
class LinkShape:
    """One coloured solid that moves with a link."""

    frame: int  # index of the link frame of ``RobotModel.joint_poses`` it is attached to
    name: str
    color_rgb: Rgb  # 0 to 255
    mesh: Mesh  # mm, in that link frame


@lru_cache(maxsize=4)
def link_shapes(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the solids of a robot and its tool.

    Raises:
        InvalidInputError: no shape is known for this robot.
    """
    if isinstance(model.arm, SphericalWristArm):
        arm = _rx90(model.arm)
    elif isinstance(model.arm, ParallelArm):
        colors = {name: color for color, names in UR_COLORS.items() for name in names}
        arm = tuple(
            LinkShape(solid.frame, solid.name, colors[solid.name], solid.mesh)
            for solid in ur_solids(model.arm)
        )
    else:
        raise InvalidInputError(f"there is no shape for the build of {model.name!r}")
    return (*arm, *tool_shapes(model))


def _rx90(arm: SphericalWristArm) -> tuple[LinkShape, ...]:
    return (*_base(arm), *_upper_arm(arm), *_forearm(arm), *_wrist(), *_flange(arm))


def _base(arm: SphericalWristArm) -> tuple[LinkShape, ...]:
    up = arm.shoulder_mm
    foot = turned(
        ((0, 0), (160, 0), (160, 26), (132, 40), (122, 190), (0, 190)), edge_mm=9.0, around=36
    )
    ring = turned(((0, 190), (116, 190), (116, 204), (0, 204)), around=36)
    column = turned(((0, 204 - up), (124, 204 - up), (118, -70), (96, 40), (0, 40)), edge_mm=16.0)
    housing = along_axis(
        turned(((0, -118), (118, -118), (130, -96), (130, 92), (0, 92)), edge_mm=8.0),
        "y",
    )
    cover = along_axis(turned(((0, -128), (84, -128), (90, -117), (0, -117)), edge_mm=4.0), "y")
    return (
        LinkShape(0, "base", WHITE, foot),
        LinkShape(0, "base ring", GREY, ring),
        LinkShape(1, "shoulder", WHITE, merged(column, housing)),
        LinkShape(1, "shoulder cover", GREY, cover),
    )


def _upper_arm(arm: SphericalWristArm) -> tuple[LinkShape, ...]:
    length = arm.upper_arm_mm
    plate = slab((0.0, 128.0), (length, 104.0), ARM_SIDE_MM, edge_mm=22.0)
    caps = [
        along_axis(
            turned(((0, 186), (radius, 186), (radius - 6, 197), (0, 197)), edge_mm=4.0),
            "y",
            (0.0, 0.0, height),
        )
        for height, radius in ((0.0, 86.0), (length, 68.0))
    ]
    return (
        LinkShape(2, "upper arm", YELLOW, plate),
        LinkShape(2, "upper arm covers", GREY, merged(*caps)),
    )


def _forearm(arm: SphericalWristArm) -> tuple[LinkShape, ...]:
    hub = along_axis(
        turned(((0, -92), (94, -92), (106, -76), (106, 92), (0, 92)), edge_mm=8.0), "y"
    )
    neck = turned(((0, -40), (88, -40), (92, 60), (84, 146), (0, 146)), edge_mm=12.0)
    motors = turned(((0, -168), (58, -168), (70, -150), (78, -40), (0, -40)), edge_mm=10.0)
    ring = turned(((0, 146), (78, 146), (78, 156), (0, 156)))
    low = 156.0 - arm.forearm_mm
    tube = turned(
        ((0, low), (84, low), (84, low + 40), (60, -118), (54, -62), (30, -52), (0, -52)),
        edge_mm=18.0,
    )
    cheeks = [
        slab((-70.0, 44.0), (0.0, 46.0), side, edge_mm=5.0)
        for side in ((37.0, 53.0), (-53.0, -37.0))
    ]
    return (
        LinkShape(3, "elbow", YELLOW, merged(hub, neck)),
        LinkShape(3, "elbow motors", GREY, motors),
        LinkShape(3, "forearm ring", GREY, ring),
        LinkShape(4, "forearm", YELLOW, merged(tube, *cheeks)),
    )


def _wrist() -> tuple[LinkShape, ...]:
    barrel = along_axis(turned(((0, -36), (41, -36), (41, 36), (0, 36)), edge_mm=4.0), "y")
    neck = turned(((0, 0), (38, 0), (38, 44), (34, 56), (0, 56)), edge_mm=4.0)
    pins = along_axis(turned(((0, -56), (24, -56), (24, 56), (0, 56)), edge_mm=3.0), "y")
    return (
        LinkShape(5, "wrist", WHITE, merged(barrel, neck)),
        LinkShape(5, "wrist pins", GREY, pins),
    )


def _flange(arm: SphericalWristArm) -> tuple[LinkShape, ...]:
    low = 57.0 - arm.flange_mm
    flange = turned(((0, low), (40, low), (50, low + 10), (50, 0), (0, 0)), edge_mm=3.0)
    return (LinkShape(6, "flange", STEEL, flange),)


def tool_shapes(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the solids on the flange; all move with link 6."""
    return (
        LinkShape(6, "force sensor", BLACK, force_sensor()),
        *_tool(model),
        *_marker_plate(model),
    )


def _tool(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the holder and what it clamps, built about the tool axis (z of ``tip``)."""
    T_flange_tip = model.T_flange_tip
    height_mm = float(T_flange_tip.translation[2])
    plate = turned(((0, 22), (36, 22), (36, 30), (0, 30)), edge_mm=2.0)
    block = slab((30.0, 24.0), (height_mm, 17.0), (-17.0, 17.0), edge_mm=5.0)
    clamp = turned(((0, -128), (27, -128), (27, -92), (0, -92)), edge_mm=4.0)
    solids = _probe() if model.tool.spindle is None else _miller(model.tool.spindle)
    return (
        LinkShape(6, "tool holder", GREY, merged(plate, block, moved(clamp, T_flange_tip))),
        *(LinkShape(6, name, color, moved(mesh, T_flange_tip)) for name, color, mesh in solids),
    )


def _probe() -> tuple[tuple[str, Rgb, Mesh], ...]:
    """Return probe body, its ring and the delay line, in ``tip``."""
    body = turned(
        ((0, -136), (14, -136), (19, -128), (19, -66), (12, -46), (9, -34), (0, -34)), edge_mm=4.0
    )
    ring = turned(((0, -36), (10, -36), (10, -30), (0, -30)), around=24)
    cone = turned(((0, -30), (8.5, -30), (PROBE_RADIUS_MM, 0.0), (0, 0)), around=24)
    return (
        ("probe body", STEEL, body),
        ("probe ring", BLACK, ring),
        ("delay line", DELAY_LINE, cone),
    )


def _miller(spindle: Spindle) -> tuple[tuple[str, Rgb, Mesh], ...]:
    """Return the spindle and the burr with its shank, in ``tip``."""
    radius, shank, nose = spindle.burr_radius_mm, spindle.shank_radius_mm, spindle.body[0][1]
    back = spindle.body[-1][1]
    body = turned(((0, back), *spindle.body[::-1], (0, nose)), edge_mm=1.0)
    neck = turned(((0, nose), (shank, nose), (shank, -radius), (0, -radius)), around=16)
    head = along_axis(ball(radius, around=20), "z", (0.0, 0.0, -radius))
    return (("spindle", STEEL, body), ("burr", BURR_STEEL, merged(neck, head)))


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
