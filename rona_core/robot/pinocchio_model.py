"""The robot a second time, as a Pinocchio model: what the verifier trusts instead of the planner.

Pinocchio works in metres; no other module of this package does.
"""

# pyright: reportAttributeAccessIssue=false
# (the members of pinocchio come from a compiled module without stubs)

import numpy as np
import pinocchio as pin

from rona_core.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.model import RobotModel

MM_PER_M = 1000.0
ELBOW, WRIST = 3, 5  # joints whose origins lie at elbow and wrist centre


class PinocchioArm:
    """Forward kinematics and joint axes by Pinocchio; results in millimetres."""

    def __init__(self, model: RobotModel) -> None:
        arm, limits = model.arm, model.limits
        chain = (
            (pin.JointModelRZ(), arm.shoulder_mm),
            (pin.JointModelRY(), 0.0),
            (pin.JointModelRY(), arm.upper_arm_mm),
            (pin.JointModelRZ(), arm.forearm_mm),
            (pin.JointModelRY(), 0.0),
            (pin.JointModelRZ(), 0.0),
        )
        self._model = pin.Model()
        self._model.name = model.name
        parent = 0
        for i, (joint, up_mm) in enumerate(chain):
            parent = self._model.addJoint(
                parent,
                joint,
                pin.SE3(np.eye(3), np.array((0.0, 0.0, up_mm / MM_PER_M))),
                f"joint{i + 1}",
                np.full(1, np.inf),
                limits.speed_rad_per_s[i : i + 1],
                limits.lower_rad[i : i + 1],
                limits.upper_rad[i : i + 1],
            )
        placement = pin.SE3(np.eye(3), np.array((0.0, 0.0, arm.flange_mm / MM_PER_M)))
        frame = pin.Frame("flange", parent, 0, placement, pin.FrameType.OP_FRAME)
        self._flange = self._model.addFrame(frame)
        self._data = self._model.createData()

    def forward(self, qs_rad: Floats) -> Poses:
        """Return ``Ts_base_flange`` for joint angles (n, 6) in radians."""
        rotations, positions = np.zeros((len(qs_rad), 3, 3)), np.zeros((len(qs_rad), 3))
        for i, q in enumerate(qs_rad):
            pin.framesForwardKinematics(self._model, self._data, q)
            placement = self._data.oMf[self._flange]
            rotations[i], positions[i] = placement.rotation, placement.translation
        return Poses(rotations, positions * MM_PER_M)

    def singular_margins(self, qs_rad: Floats) -> tuple[Floats, Floats, Floats]:
        """Return how far from a lost freedom the arm is, from the placement of its joints.

        Returns:
            Sine of the angle between axes 4 and 6 (n,), sine of the angle between upper arm and
            forearm (n,), and distance of the wrist centre from axis 1 in mm (n,).
        """
        n = len(qs_rad)
        wrist, elbow, shoulder_mm = np.zeros(n), np.zeros(n), np.zeros(n)
        for i, q in enumerate(qs_rad):
            pin.forwardKinematics(self._model, self._data, q)
            placements = self._data.oMi
            axes = placements[4].rotation[:, 2], placements[6].rotation[:, 2]
            wrist[i] = np.linalg.norm(np.cross(*axes))
            upper = placements[ELBOW].translation - placements[ELBOW - 1].translation
            fore = placements[WRIST].translation - placements[ELBOW].translation
            lengths = np.linalg.norm(upper) * np.linalg.norm(fore)
            elbow[i] = np.linalg.norm(np.cross(upper, fore)) / lengths
            shoulder_mm[i] = MM_PER_M * np.linalg.norm(placements[WRIST].translation[:2])
        return wrist, elbow, shoulder_mm

    def tool(self, qs_rad: Floats, T_flange_tip: Pose) -> Poses:
        """Return ``Ts_base_tip`` for joint angles (n, 6) in radians."""
        return self.forward(qs_rad) @ T_flange_tip
