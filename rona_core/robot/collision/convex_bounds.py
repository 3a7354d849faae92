"""Outer bounds of robot and tool: convex bodies that contain them, for keeping clear of things.

The lengths are those of the drawing of the RX90 (docs/algorithms/robot/rx90.md) and of the tool as
drawn up; whatever is drawn lies inside. An arm without a table of its own is bounded by hulls of
its drawn solids, or where it is not drawn by capsules from joint to joint, as thick as such arms
are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.spherical_wrist import SphericalWristArm
from rona_core.robot.meshes.link_meshes import link_shapes

CORNERS = 12  # of the prisms that stand for drums, drawn about them
DELAY_LINE, PROBE_BODY, PROBE, TOOL_LINK = "delay line", "probe body", "probe", 6
BALL_MM = 7.0  # about a marker, its post included
DRAWN_TOOL = (
    "tool holder",
    "probe body",
    "probe ring",
    "delay line",
    "marker plate",
    "marker balls",
)
THICKNESS = (0.17, 0.15, 0.14, 0.11, 0.075, 0.065, 0.065)  # radius over mean link length, fallback


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """A convex body: all places within a radius of the hull of some points."""

    name: str
    link: int  # index of the frame of ``RobotModel.joint_poses`` that it moves with
    vertices: Floats  # (n, 3) mm, in that frame; two with a radius make a capsule
    radius_mm: float = 0.0  # above 0 only with two points


# Parts two joints or more apart that the maker's build or joint limits keep from each other.
HELD_APART = {
    "rx90": (("forearm", "flange"),),
    "ur5": (("forearm", "wrist 2"),),  # whose wrist passes beside the forearm
    "ur10": (("forearm", "wrist 2"),),
}


def outer_bounds(model: RobotModel) -> tuple[Bound, ...]:
    """Return bodies that contain the robot and its tool, base first."""
    arm = TABLES[model.name](model) if model.name in TABLES else drawn_bounds(model)
    return (*arm, *_tool(model))


def drawn_bounds(model: RobotModel) -> tuple[Bound, ...]:
    """Return hulls of the drawn solids of an arm without its tool, or capsules where none is drawn.

    A solid whose name begins with that of another one of its link ("wrist 1 cover") joins its hull.

    Raises:
        DegenerateGeometryError: a drawn solid is flat.
    """
    try:
        shapes = link_shapes(model)
    except InvalidInputError:
        return joint_bounds(model)
    groups: dict[tuple[str, int], list[Floats]] = {}
    for shape in (shape for shape in shapes if shape.name not in DRAWN_TOOL):
        beside = (other.name for other in shapes if other.frame == shape.frame)
        head = min((name for name in beside if _in_name(name, shape.name)), key=len)
        groups.setdefault((head, shape.frame), []).append(shape.mesh.vertices)
    return tuple(
        Bound(name, link, readonly(_corners(np.concatenate(parts))))
        for (name, link), parts in groups.items()
    )


def _in_name(head: str, name: str) -> bool:
    """Return whether a name is another one, or begins with it and a blank."""
    return name == head or name.startswith(f"{head} ")


def _corners(points: Floats) -> Floats:
    try:
        return points[ConvexHull(points).vertices]
    except QhullError as error:
        raise DegenerateGeometryError("a drawn solid encloses nothing") from error


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


def _bound(name: str, link: int, *parts: Floats) -> Bound:
    return Bound(name, link, readonly(np.concatenate(parts)))


def _rx90(model: RobotModel) -> tuple[Bound, ...]:
    arm = model.arm
    if not isinstance(arm, SphericalWristArm):
        raise InvalidInputError(f"the bounds of the RX90 do not fit the arm of {model.name}")
    up, upper, fore = arm.shoulder_mm, arm.upper_arm_mm, arm.forearm_mm
    return (
        _bound("base", 0, drum(((160, 0), (160, 40), (132, 60), (124, up - 216)))),
        _bound("shoulder column", 1, drum(((125, 204 - up), (120, -70), (97, 41)))),
        _bound("shoulder", 1, drum(((85, -129), (119, -119), (131, -97), (131, 93)), "y")),
        _bound(
            "upper arm",
            2,
            drum(((129, 95), (129, 189), (87, 198)), "y"),
            drum(((105, 95), (105, 189), (69, 198)), "y", (0, 0, upper)),
        ),
        _bound("elbow", 3, drum(((95, -93), (107, -77), (107, 93)), "y")),
        _bound("elbow motors", 3, drum(((59, -169), (79, -150), (93, 60), (85, 157)))),
        _bound(
            "forearm",
            4,
            drum(((85, 155 - fore), (85, 197 - fore), (61, -117))),
            drum(((47, -54), (47, 54)), "y"),
        ),
        _bound(
            "wrist",
            5,
            drum(((25, -57), (42, -37), (42, 37), (25, 57)), "y"),
            drum(((39, 44), (35, 57))),
        ),
        _bound("flange", TOOL_LINK, drum(((51, 56 - arm.flange_mm), (51, 23)))),
    )


def _tool(model: RobotModel) -> tuple[Bound, ...]:
    """Return holder, probe body, delay line and marker plate, as ``shape.py`` draws them."""
    T_flange_probe, T_flange_tip = model.T_flange_probe, model.T_flange_tip
    height = float(T_flange_tip.translation[2])
    clamp = T_flange_tip @ drum(((28, -129), (28, -91)))
    near = drum(((25, -18), (25, 18)), "y", (0, 0, 30.0))
    far = drum(((18, -18), (18, 18)), "y", (0, 0, height))
    body = T_flange_probe @ drum(((15, -137), (20, -128), (20, -65), (13, -45), (11, -33)))
    line = T_flange_probe @ drum(((11, -37), (11, -29), (3.2, 0)))
    markers = GEOMETRIES["toolmarker"].positions_marker
    cube = BALL_MM * np.array(list(product((-1.0, 1.0), repeat=3)))
    behind = cube - np.array((0.0, 0.0, 12.0))
    around = (markers[:, None] + np.vstack((cube, behind))).reshape(-1, 3)
    plate = model.T_flange_toolmarker @ around
    stem = T_flange_tip @ (np.array((0.0, 0.0, -112.0)) + cube)
    return (
        _bound("tool holder", TOOL_LINK, drum(((37, 21), (37, 31))), near, far, clamp),
        _bound(PROBE_BODY, TOOL_LINK, body),  # beside the head, where the next may touch
        _bound(DELAY_LINE, TOOL_LINK, line),
        _bound(PROBE, TOOL_LINK, body, line),  # beside everything else
        _bound("marker plate", TOOL_LINK, plate, stem),
    )


def joint_bounds(model: RobotModel) -> tuple[Bound, ...]:
    """Return a capsule for each link, from its joint to the next one."""
    poses = model.joint_poses(np.zeros(6))
    places = poses.translations
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    size = float(lengths.sum()) / 2.0
    bounds: list[Bound] = []
    for link in range(7):
        T_link_base = poses[link].inv()
        end = T_link_base @ places[min(link + 1, 6)]
        radius = THICKNESS[link] * size
        bounds.append(Bound(f"link {link}", link, readonly(np.stack((np.zeros(3), end))), radius))
    return tuple(bounds)


TABLES: dict[str, Callable[[RobotModel], tuple[Bound, ...]]] = {"rx90": _rx90}
