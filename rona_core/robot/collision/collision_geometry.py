"""Outer bounds of robot and tool: convex bodies that contain them, for keeping clear of things.

The lengths are those of the drawing of the RX90 (docs/algorithms/robot/rx90.md) and of the tool as
drawn up; whatever is drawn lies inside. The UR arms are bounded by hulls of their solids.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.collision.solids import Solid, force_sensor, ur_solids
from rona_core.robot.kinematics.robot_model import RobotModel, Spindle
from rona_core.robot.kinematics.wrists import ParallelArm, SphericalWristArm

CORNERS = 12  # of the prisms that stand for drums, drawn about them
DELAY_LINE, PROBE_BODY, PROBE, TOOL_LINK = "delay line", "probe body", "probe", 6
SPINDLE, BURR = "spindle", "burr"
TOUCHING = (DELAY_LINE, BURR)  # may reach into what may be touched
BALL_MM = 7.0  # about a marker, its post included
LINE_PROFILE = ((11, -37), (11, -29), (3.2, 0))  # of the delay line: radius, height in ``probe``


@dataclass(frozen=True, slots=True, eq=False)
class ConvexBody:
    """A convex body: the hull of some points."""

    name: str
    link: int  # index of the frame of ``RobotModel.joint_poses`` that it moves with
    vertices: Floats  # (n, 3) mm, in that frame


@lru_cache(maxsize=4)
def collision_bodies(model: RobotModel) -> tuple[ConvexBody, ...]:
    """Return bodies that contain the robot and its tool, base first.

    Raises:
        InvalidInputError: there is no collision geometry for an arm of this build.
    """
    if isinstance(model.arm, SphericalWristArm):
        arm = _spherical_wrist_arm(model.arm)
    elif isinstance(model.arm, ParallelArm):
        sensor = Solid(TOOL_LINK, "force sensor", force_sensor())
        arm = solid_hulls((*ur_solids(model.arm), sensor))
    else:
        raise InvalidInputError(f"there are no collision bodies for the build of {model.name!r}")
    return (*arm, *_tool(model))


def solid_hulls(solids: Sequence[Solid]) -> tuple[ConvexBody, ...]:
    """Return the hulls of solids.

    A solid whose name begins with that of another one of its link ("wrist 1 cover") joins its hull.

    Raises:
        DegenerateGeometryError: a solid is flat.
    """
    groups: dict[tuple[str, int], list[Floats]] = {}
    for solid in solids:
        on_link = (other.name for other in solids if other.frame == solid.frame)
        head = min((name for name in on_link if _in_name(name, solid.name)), key=len)
        groups.setdefault((head, solid.frame), []).append(solid.mesh.vertices)
    return tuple(
        ConvexBody(name, link, readonly(_corners(np.concatenate(parts))))
        for (name, link), parts in groups.items()
    )


def _in_name(head: str, name: str) -> bool:
    """Return whether a name is another one, or begins with it and a blank."""
    return name == head or name.startswith(f"{head} ")


def _corners(points: Floats) -> Floats:
    try:
        return points[ConvexHull(points).vertices]
    except QhullError as error:
        raise DegenerateGeometryError("a solid encloses nothing") from error


def drum(radii_and_heights: ArrayLike, axis: str = "z", origin: ArrayLike = (0, 0, 0)) -> Floats:
    """Return vertices of the hull about discs of (radius, height) along one axis."""
    turn = (np.arange(CORNERS) + 0.5) * 2.0 * np.pi / CORNERS
    wider = 1.0 / np.cos(np.pi / CORNERS)
    circle = np.stack((np.cos(turn), np.sin(turn)), axis=1) * wider
    rings = [
        np.column_stack((radius * circle, np.full(CORNERS, height)))
        for radius, height in np.asarray(radii_and_heights, dtype=np.float64)
    ]
    points = np.concatenate(rings)
    if axis == "y":
        points = points[:, (0, 2, 1)]
    return points + np.asarray(origin, dtype=np.float64)


def _body(name: str, link: int, *parts: Floats) -> ConvexBody:
    return ConvexBody(name, link, readonly(np.concatenate(parts)))


def _spherical_wrist_arm(arm: SphericalWristArm) -> tuple[ConvexBody, ...]:
    """Return the bodies of the RX90, or of an arm that is as thick."""
    up, upper, fore = arm.shoulder_mm, arm.upper_arm_mm, arm.forearm_mm
    return (
        _body("base", 0, drum(((160, 0), (160, 40), (132, 60), (124, up - 216)))),
        _body("shoulder column", 1, drum(((125, 204 - up), (120, -70), (97, 41)))),
        _body("shoulder", 1, drum(((85, -129), (119, -119), (131, -97), (131, 93)), "y")),
        _body(
            "upper arm",
            2,
            drum(((129, 95), (129, 189), (87, 198)), "y"),
            drum(((105, 95), (105, 189), (69, 198)), "y", (0, 0, upper)),
        ),
        _body("elbow", 3, drum(((95, -93), (107, -77), (107, 93)), "y")),
        _body("elbow motors", 3, drum(((59, -169), (79, -150), (93, 60), (85, 157)))),
        _body(
            "forearm",
            4,
            drum(((85, 155 - fore), (85, 197 - fore), (61, -117))),
            drum(((47, -54), (47, 54)), "y"),
        ),
        _body(
            "wrist",
            5,
            drum(((25, -57), (42, -37), (42, 37), (25, 57)), "y"),
            drum(((39, 44), (35, 57))),
        ),
        _body("flange", TOOL_LINK, drum(((51, 56 - arm.flange_mm), (51, 23)))),
    )


def _tool(model: RobotModel) -> tuple[ConvexBody, ...]:
    """Return holder, marker plate and what the holder clamps, one body each."""
    T_flange_tip = model.T_flange_tip
    height = float(T_flange_tip.translation[2])
    clamp = T_flange_tip @ drum(((28, -129), (28, -91)))
    near = drum(((25, -18), (25, 18)), "y", (0, 0, 30.0))
    far = drum(((18, -18), (18, 18)), "y", (0, 0, height))
    markers = GEOMETRIES["toolmarker"].positions_marker
    cube = BALL_MM * np.array(list(product((-1.0, 1.0), repeat=3)))
    behind = cube - np.array((0.0, 0.0, 12.0))
    around = (markers[:, None] + np.vstack((cube, behind))).reshape(-1, 3)
    plate = model.T_flange_toolmarker @ around
    stem = T_flange_tip @ (np.array((0.0, 0.0, -112.0)) + cube)
    return (
        _body("tool holder", TOOL_LINK, drum(((37, 21), (37, 31))), near, far, clamp),
        *(_probe(model) if model.tool.spindle is None else _miller(model, model.tool.spindle)),
        _body("marker plate", TOOL_LINK, plate, stem),
    )


def _probe(model: RobotModel) -> tuple[ConvexBody, ...]:
    """Return probe body, delay line, and both together."""
    T_flange_probe = model.T_flange_probe
    body = T_flange_probe @ drum(((15, -137), (20, -128), (20, -65), (13, -45), (11, -33)))
    line = T_flange_probe @ drum(LINE_PROFILE)
    return (
        _body(PROBE_BODY, TOOL_LINK, body),  # beside the head, where the next may touch
        _body(DELAY_LINE, TOOL_LINK, line),
        _body(PROBE, TOOL_LINK, body, line),  # beside everything else
    )


def _miller(model: RobotModel, spindle: Spindle) -> tuple[ConvexBody, ...]:
    """Return the spindle, and the burr with its shank."""
    return (
        _body(SPINDLE, TOOL_LINK, model.T_flange_tip @ drum(spindle.body)),
        _body(BURR, TOOL_LINK, model.T_flange_tip @ drum(spindle.burr)),
    )
