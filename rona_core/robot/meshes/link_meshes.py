"""What the robot looks like: solids built from the published dimensions, for the eye only.

The outlines of the RX90 follow its drawing (docs/algorithms/robot/rx90.md), those of the other arms
their lengths; they are not the makers' geometry and no input of any algorithm.
"""

from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.spherical_wrist import SphericalWristArm
from rona_core.robot.meshes.primitives import along_axis, merged, slab, turned
from rona_core.robot.meshes.tool_mesh import (
    GREY,
    SPHERE_RADIUS_MM,
    STEEL,
    WHITE,
    LinkShape,
    Rgb,
    tool_shapes,
)
from rona_core.robot.meshes.ur_meshes import ur_shapes

__all__ = ["SPHERE_RADIUS_MM", "LinkShape", "link_shapes"]

YELLOW: Rgb = (242, 190, 58)
ARM_SIDE_MM = (96.0, 188.0)  # the upper arm runs beside the plane of the wrist


def link_shapes(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the solids of a robot and its tool.

    Raises:
        InvalidInputError: no shape is known for this robot.
    """
    makers = {"rx90": _rx90, "ur5": ur_shapes, "ur10": ur_shapes}
    if model.name not in makers:
        known = ", ".join(makers)
        raise InvalidInputError(f"there is no shape for {model.name!r}; known shapes: {known}")
    return makers[model.name](model)


def _rx90(model: RobotModel) -> tuple[LinkShape, ...]:
    arm = model.arm
    if not isinstance(arm, SphericalWristArm):
        raise InvalidInputError(f"{model.name} is drawn as an arm with a spherical wrist")
    return (
        *_base(arm),
        *_upper_arm(arm),
        *_forearm(arm),
        *_wrist(),
        *_flange(arm),
        *tool_shapes(model),
    )


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
