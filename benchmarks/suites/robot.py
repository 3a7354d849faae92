"""Kinematics of the RX90: residual of the closed form, and speed beside Pinocchio."""

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from rona_core.arrays import Floats
from rona_core.robot.model import RobotModel, robot_model
from rona_core.robot.pinocchio_model import PinocchioArm

POSES = 5000


def run(progress: Progress) -> list[Metric]:
    """Return residuals of forward and inverse kinematics and times per pose."""
    progress(f"{POSES} random joint vectors")
    model = robot_model("rx90")
    rng = np.random.default_rng(4)
    qs_rad = rng.uniform(model.lower_rad, model.upper_rad, (POSES, 6))
    peer = PinocchioArm(model)
    gap = np.abs(model.forward(qs_rad).translations - peer.forward(qs_rad).translations).max()
    residual_mm, found = inverse_residual(model, qs_rad)
    Ts_base_flange = model.forward(qs_rad)
    forward_us = 1e3 * cpu_ms(lambda: model.forward(qs_rad)) / POSES
    peer_us = 1e3 * cpu_ms(lambda: peer.forward(qs_rad)) / POSES
    inverse_us = 1e3 * cpu_ms(lambda: model.inverse(Ts_base_flange)) / POSES
    return [
        Metric("forward kinematics, gap to Pinocchio", float(gap), "mm", "lower", goal=1e-9),
        Metric("inverse kinematics, largest residual", residual_mm, "mm", "lower", goal=1e-6),
        Metric("joint vector among the solutions", found, "share", "higher", goal=1.0),
        Metric("forward, CPU a pose", forward_us, "us", "lower", None, "Pinocchio", peer_us),
        Metric("inverse, all eight branches, CPU a pose", inverse_us, "us", "lower"),
    ]


def inverse_residual(model: RobotModel, qs_rad: Floats) -> tuple[float, float]:
    """Return the largest position error (mm) of any branch, and how often ``qs_rad`` is found."""
    Ts_base_flange = model.forward(qs_rad)
    solutions = model.inverse(Ts_base_flange)
    worst, nearest = 0.0, np.full(len(qs_rad), np.inf)
    for branch in range(solutions.valid.shape[1]):
        ok = solutions.valid[:, branch]
        q = solutions.qs_rad[ok, branch]
        off = model.forward(q).translations - Ts_base_flange.translations[ok]
        worst = max(worst, float(np.linalg.norm(off, axis=1).max(initial=0.0)))
        turn = np.abs((q - qs_rad[ok] + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
        nearest[ok] = np.minimum(nearest[ok], turn)
    return worst, float((nearest < 1e-6).mean())
