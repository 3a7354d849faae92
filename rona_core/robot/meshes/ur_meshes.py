"""What the UR arms look like: tubes between round joint housings with blue covers.

Each solid is nearly convex, so that its hull is a close bound.
"""

from rona_core.devices.protocols import Mesh
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.offset_wrist import ParallelArm
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.meshes.primitives import along_axis, merged, turned
from rona_core.robot.meshes.tool_mesh import STEEL, LinkShape, Rgb, tool_shapes

TUBE: Rgb = (206, 210, 214)
HOUSING: Rgb = (222, 225, 228)
COVER: Rgb = (108, 160, 204)
JOINT_RADIUS = 0.44  # of the lateral offset of the shoulder
ELBOW_RADIUS = 0.84  # of the joint
WRIST_RADIUS = 0.40  # of the distance between axes 4 and 6
SPREAD = 0.48  # half the width of the upper arm's housings, of that lateral offset
ELBOW_SPLIT = 0.35  # where upper arm and forearm meet, of the way between them
PLATE_MM = 26.0  # the turning flange is so thick


def ur_shapes(model: RobotModel) -> tuple[LinkShape, ...]:
    """Return the solids of a UR arm and its tool.

    Raises:
        InvalidInputError: the arm is of another build.
    """
    arm = model.arm
    if not isinstance(arm, ParallelArm):
        raise InvalidInputError(f"{model.name} is drawn as an arm with three parallel axes")
    return (
        *_column(arm),
        *_upper_arm(arm),
        *_forearm(arm),
        *_wrist(arm),
        *tool_shapes(model),
    )


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


def _column(arm: ParallelArm) -> tuple[LinkShape, ...]:
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
        LinkShape(0, "base", STEEL, foot),
        LinkShape(1, "shoulder", HOUSING, body),
        LinkShape(1, "shoulder neck", HOUSING, _across(0.97 * joint, 0.0, neck - 6)),
        LinkShape(1, "shoulder ring", STEEL, ring),
        LinkShape(1, "shoulder cover", COVER, cover),
    )


def _upper_arm(arm: ParallelArm) -> tuple[LinkShape, ...]:
    joint, elbow, _ = radii_mm(arm)
    half = SPREAD * arm.shoulder_side_mm
    meeting = ELBOW_SPLIT * arm.elbow_side_mm
    length = arm.upper_arm_mm
    root = _across(joint, -half, half - 12)
    head = _across(elbow, meeting, half - 12, length)
    return (
        LinkShape(2, "upper arm root", TUBE, root),
        LinkShape(2, "upper arm", TUBE, _round(0.72 * joint, 0.0, length, edge=0.0)),
        LinkShape(2, "upper arm head", TUBE, head),
        LinkShape(2, "root cover", COVER, _across(0.94 * joint, half - 14, half, edge=6.0)),
        LinkShape(2, "head cover", COVER, _across(0.94 * elbow, half - 14, half, length, edge=6.0)),
    )


def _forearm(arm: ParallelArm) -> tuple[LinkShape, ...]:
    _, elbow, wrist = radii_mm(arm)
    inner = (ELBOW_SPLIT - 1.0) * arm.elbow_side_mm  # where it meets the upper arm
    low, length = -0.9 * elbow, arm.forearm_mm
    head = _across(1.05 * wrist, -wrist, arm.wrist_side_mm - wrist, length, edge=5.0)
    root_cover = _across(0.85 * elbow, low, low + 14, edge=6.0)
    head_cover = _across(wrist, -wrist - 10, -wrist + 2, length, edge=4.0)
    return (
        LinkShape(3, "forearm root", TUBE, _across(0.9 * elbow, low + 12, inner)),
        LinkShape(3, "forearm", TUBE, _round(0.62 * elbow, 0.0, length, edge=0.0)),
        LinkShape(3, "forearm head", TUBE, head),
        LinkShape(3, "forearm root cover", COVER, root_cover),
        LinkShape(3, "forearm head cover", COVER, head_cover),
    )


def _wrist(arm: ParallelArm) -> tuple[LinkShape, ...]:
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
        LinkShape(4, "wrist 1", HOUSING, first),
        LinkShape(4, "wrist 1 cover", COVER, first_cover),
        LinkShape(5, "wrist 2", HOUSING, second),
        LinkShape(5, "wrist 2 cover", COVER, second_cover),
        LinkShape(6, "flange", STEEL, flange),
    )
