"""Solvers of others for the inverse kinematics: all answers by EAIK, one by iteration."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import pinocchio as pin

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.arm import IkSolutions
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm, pinocchio_model
from rona_core.robot.kinematics.robot_model import RobotModel

MM_PER_M = 1000.0
SAME_RAD = 1e-6
DAMPING, CLOSE, MOST_STEPS = 1e-9, 1e-9, 100


class AllAnswers:
    """EAIK on an arm whose axes Pinocchio has placed; None of RONA's own lengths go in."""

    def __init__(self, model: RobotModel) -> None:
        """Describe the arm by its axes at zero.

        Raises:
            ImportError: EAIK is not installed.
        """
        peer = PinocchioArm(model)
        axes, origins = peer.joint_axes(np.zeros((1, 6)))
        flange = peer.forward(np.zeros((1, 6)))
        points = np.vstack((np.zeros(3), origins[0], flange.translations)) / MM_PER_M
        self._end = flange.rotations[0]
        solver: Any = import_module("eaik.IK_HP")
        self._robot = solver.HPRobot(axes[0], np.diff(points, axis=0))

    def prepared(self, poses: Poses) -> Floats:
        """Return poses as the solver wants them: (n, 4, 4), metres, without the last rotation."""
        matrices = np.tile(np.eye(4), (len(poses), 1, 1))
        matrices[:, :3, :3] = poses.rotations @ self._end.T
        matrices[:, :3, 3] = poses.translations / MM_PER_M
        return matrices

    def solve(self, matrices: Floats) -> list[Floats]:
        """Return the joint vectors (k, 6) that reach each pose, on one thread."""
        answers = self._robot.IK_batched(matrices, 1)
        return [np.asarray(a.Q)[~np.asarray(a.is_LS, dtype=bool)] for a in answers]


def all_answers(model: RobotModel) -> AllAnswers | None:
    """Return the solver for an arm, or None where EAIK is not installed."""
    return None if find_spec("eaik") is None else AllAnswers(model)


def agreement(ours: IkSolutions, theirs: list[Floats]) -> tuple[float, float]:
    """Return the share of their answers that we have, and of ours that they have."""
    counts = np.zeros(4)
    for i, others in enumerate(theirs):
        mine = ours.qs_rad[i][ours.valid[i]]
        apart = others[:, None] - mine[None]
        apart = np.abs(apart - 2.0 * np.pi * np.round(apart / (2.0 * np.pi))).max(axis=2)
        same = apart < SAME_RAD
        counts += (same.any(axis=1).sum(), len(others), same.any(axis=0).sum(), len(mine))
    return float(counts[0] / counts[1]), float(counts[2] / counts[3])


class OneAnswer:
    """Damped Newton steps on Pinocchio's Jacobian, from a posture nearby."""

    def __init__(self, model: RobotModel) -> None:
        self._model, self._flange = pinocchio_model(model)
        self._data = self._model.createData()

    def solve(self, pose: Pose, q_start_rad: Floats) -> Floats | None:
        """Return one joint vector (6,), or None where the iteration does not end."""
        goal = pin.SE3(pose.rotation, pose.translation / MM_PER_M)
        q = q_start_rad.copy()
        for _ in range(MOST_STEPS):
            pin.framesForwardKinematics(self._model, self._data, q)
            gap = self._data.oMf[self._flange].actInv(goal)
            error = pin.log6(gap).vector
            if np.linalg.norm(error) < CLOSE:
                return q
            local = pin.ReferenceFrame.LOCAL
            jacobian = pin.computeFrameJacobian(self._model, self._data, q, self._flange, local)
            square = jacobian @ jacobian.T + DAMPING * np.eye(6)
            q = q + jacobian.T @ np.linalg.solve(square, error)
        return None
