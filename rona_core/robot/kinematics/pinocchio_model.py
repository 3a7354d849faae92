"""The robot a second time, as a Pinocchio model: the verifier uses it in place of the planner's.

Where the maker's description is at hand, it is that of the file as it stands, so that lengths and
directions of turning are checked too. Pinocchio works in metres.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.wrists import SphericalWristArm

MM_PER_M = 1000.0
BASE_LINK, FLANGE_LINK = "base_link", "tool0"  # as ROS-Industrial names base and flange face
N_JOINTS = 6
BLOCK = 2048  # joint vectors at once: a long motion has fifty thousand


class PinocchioArm:
    """Forward kinematics and joint axes by Pinocchio; results in millimetres."""

    def __init__(self, model: RobotModel) -> None:
        """Build the model from the robot's description, or from its lengths where it has none.

        Raises:
            InvalidInputError: neither a description nor the lengths of a known build.
        """
        self._model, flange = pinocchio_model(model)
        self._axes = np.eye(3)[_axes(self._model)]
        self._on_last = self._model.frames[flange].placement  # where the flange is on joint 6

    def forward(self, qs_rad: Floats) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        n, on_last = len(qs_rad), self._on_last
        rotations, translations = np.zeros((n, 3, 3)), np.zeros((n, 3))
        for start in range(0, n, BLOCK):
            joints, places = joint_placements(self._model, qs_rad[start : start + BLOCK])
            last = joints[:, -1]
            flange_mm = MM_PER_M * (places[:, -1] + last @ on_last.translation)
            # checked part by part: all of a long motion at once takes much memory
            part = Poses(last @ on_last.rotation, flange_mm)
            rotations[start : start + BLOCK] = part.rotations
            translations[start : start + BLOCK] = part.translations
        return Poses.unchecked(rotations, translations)

    def joint_axes(self, qs_rad: Floats) -> tuple[Floats, Floats]:
        """Return directions and origins (n, 6, 3) of all joint axes in ``base``, origins in mm."""
        rotations, places = joint_placements(self._model, qs_rad)
        directions = np.einsum("njik,jk->nji", rotations[:, 1:], self._axes)
        return directions, MM_PER_M * places[:, 1:]

    def singular_margins(self, qs_rad: Floats) -> tuple[Floats, Floats, Floats]:
        """Return how far from a lost freedom the arm is, from the placement of its joints.

        The same three for every arm whose axes 2 and 3 are parallel and whose axis 6 starts at
        the wrist centre.

        Returns:
            Sine of the angle between axes 4 and 6 (n,), sine of the angle between upper arm and
            forearm seen along axis 3 (n,), and distance of the wrist centre from the plane of
            axes 1 and 2 in mm (n,): from axis 1 where nothing is offset sideways.
        """
        starts = range(0, max(len(qs_rad), 1), BLOCK)
        parts = [self._singular_margins(qs_rad[start : start + BLOCK]) for start in starts]
        wrist, elbow, out_mm = (np.concatenate(part) for part in zip(*parts, strict=True))
        return wrist, elbow, out_mm

    def _singular_margins(self, qs_rad: Floats) -> tuple[Floats, Floats, Floats]:
        axes, origins = self.joint_axes(qs_rad)
        wrist = np.linalg.norm(np.cross(axes[:, 3], axes[:, 5]), axis=1)
        upper = np.cross(axes[:, 2], origins[:, 2] - origins[:, 1])
        fore = np.cross(axes[:, 2], origins[:, 3] - origins[:, 2])
        lengths = np.linalg.norm(upper, axis=1) * np.linalg.norm(fore, axis=1)
        elbow = np.linalg.norm(np.cross(upper, fore), axis=1) / lengths
        normal = np.cross(axes[:, 0], axes[:, 1])
        out_mm = np.abs(np.einsum("ij,ij->i", normal, origins[:, 5] - origins[:, 1]))
        return wrist, elbow, out_mm

    def tool(self, qs_rad: Floats, T_flange_tip: Pose) -> Poses:
        """Return ``Ts_base_tip`` for joint angles (n, 6) in radians."""
        return self.forward(qs_rad) @ T_flange_tip


def joint_placements(built: Any, qs_rad: Floats) -> tuple[Floats, Floats]:
    """Return rotations (n, 7, 3, 3) and places (n, 7, 3) in metres of base and joints.

    What ``pin.forwardKinematics`` puts into ``oMi`` for one of joint angles (n, 6), for all of
    them: each joint is placed on the one before as Pinocchio's model says, and turns about its
    axis.
    """
    n = len(qs_rad)
    # the n come last: loops over three numbers are slow
    columns, places = np.zeros((N_JOINTS + 1, 3, 3, n)), np.zeros((N_JOINTS + 1, 3, n))
    columns[0] = np.eye(3)[:, :, None]
    for i, (axis, angles_rad) in enumerate(zip(_axes(built), qs_rad.T, strict=True)):
        placed, before = built.jointPlacements[i + 1], columns[i].reshape(3, -1)
        places[i + 1] = places[i] + (placed.translation @ before).reshape(3, n)
        columns[i + 1] = (placed.rotation.T @ before).reshape(3, 3, n)
        first, second = columns[i + 1, (axis + 1) % 3], columns[i + 1, (axis + 2) % 3]
        cosines, sines = np.cos(angles_rad), np.sin(angles_rad)
        turned = cosines * first + sines * second, cosines * second - sines * first
        first[:], second[:] = turned
    return columns.transpose(3, 0, 2, 1), places.transpose(2, 0, 1)


def _axes(built: Any) -> list[int]:
    """Return about which axis of its own frame each joint turns: 0, 1 or 2."""
    return ["XYZ".index(built.joints[i].shortname()[-1]) for i in range(1, N_JOINTS + 1)]


def pinocchio_model(model: RobotModel) -> tuple[Any, int]:
    """Return Pinocchio's model and the number of its flange frame.

    Raises:
        InvalidInputError: neither a description nor the lengths of a known build.
    """
    if model.urdf is not None:
        return read_urdf(model.urdf)
    if isinstance(model.arm, SphericalWristArm):
        return _from_lengths(model.name, model.arm)
    raise InvalidInputError(f"{model.name} has no description for Pinocchio to read")


def read_urdf(path: str | Path) -> tuple[Any, int]:
    """Return Pinocchio's model of a description, and the number of its flange frame.

    Raises:
        InvalidInputError: the file cannot be read, or is not one of six turning joints from
            ``BASE_LINK`` to ``FLANGE_LINK``.
    """
    try:
        built = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as error:
        raise InvalidInputError(f"{path} cannot be read as URDF: {error}") from error
    if not (built.existFrame(BASE_LINK) and built.existFrame(FLANGE_LINK)):
        raise InvalidInputError(f"{path}: {FLANGE_LINK} does not hang on {BASE_LINK}")
    base, flange = (built.getFrameId(link) for link in (BASE_LINK, FLANGE_LINK))
    at_the_ends = built.frames[base].parentJoint == 0 and (
        built.frames[flange].parentJoint == N_JOINTS
    )
    if built.nq != N_JOINTS or built.njoints != N_JOINTS + 1 or not at_the_ends:
        raise InvalidInputError(f"{path}: expected six turning joints and a flange")
    return built, flange


def _from_lengths(name: str, arm: SphericalWristArm) -> tuple[Any, int]:
    chain = (
        (pin.JointModelRZ(), arm.shoulder_mm),
        (pin.JointModelRY(), 0.0),
        (pin.JointModelRY(), arm.upper_arm_mm),
        (pin.JointModelRZ(), arm.forearm_mm),
        (pin.JointModelRY(), 0.0),
        (pin.JointModelRZ(), 0.0),
    )
    built = pin.Model()
    built.name = name
    parent = 0
    for i, (joint, up_mm) in enumerate(chain):
        placement = pin.SE3(np.eye(3), np.array((0.0, 0.0, up_mm / MM_PER_M)))
        parent = built.addJoint(parent, joint, placement, f"joint{i + 1}")
    placement = pin.SE3(np.eye(3), np.array((0.0, 0.0, arm.flange_mm / MM_PER_M)))
    frame = pin.Frame("flange", parent, 0, placement, pin.FrameType.OP_FRAME)
    return built, built.addFrame(frame)
