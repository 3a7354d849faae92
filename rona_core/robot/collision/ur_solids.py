"""Solids of the UR arms: tubes between round joint housings with covers.

Their hulls are the collision bodies of these arms, and they are what is drawn of them. Each solid
is nearly convex, so that its hull is a close bound.
"""

from rona_core.geometry.mesh import Mesh
from rona_core.robot.collision.solids import Solid, along_axis, merged, turned
from rona_core.robot.kinematics.offset_wrist import ParallelArm

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
