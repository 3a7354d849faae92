"""Kinematics of every arm: residuals, all branches beside an independent solver, and speed."""

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.peers.inverse_kinematics import OneAnswer, agreement, all_answers
from benchmarks.reference.yardstick import Yardstick, pair
from rona_core.devices.robots import ROBOTS
from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm
from rona_core.robot.kinematics.robot_model import RobotModel

RESIDUAL_POSES = 100_000
POSES = 110_000  # 1526 path points times 72 rolls
FORWARD_POSES = 5000
PEER_POSES = 2000
INVERSE_S = 0.12  # on the machine that yardsticks are told by
NEAR_RAD = np.deg2rad(2.0)
SAME_RAD = 1e-5  # next to a singularity angles are known less well than the pose


def run(progress: Progress) -> list[Metric]:
    """Return residuals of forward and inverse kinematics, completeness and CPU times."""
    yardstick = Yardstick()
    metrics: list[Metric] = []
    for name, data in ROBOTS.items():
        title = data.title
        progress(f"{title}: {RESIDUAL_POSES} random joint vectors")
        metrics += _arm(title, robot_model(name), yardstick)
    return metrics


def _arm(title: str, model: RobotModel, yardstick: Yardstick) -> list[Metric]:
    rng = np.random.default_rng(4)
    qs_rad = rng.uniform(model.lower_rad, model.upper_rad, (RESIDUAL_POSES, 6))
    some = qs_rad[:FORWARD_POSES]
    peer = PinocchioArm(model)
    gap = np.abs(model.forward(some).translations - peer.forward(some).translations).max()
    residual_mm, found = inverse_residual(model, qs_rad)
    forward_us = 1e3 * cpu_ms(lambda: model.forward(some)) / FORWARD_POSES
    peer_us = 1e3 * cpu_ms(lambda: peer.forward(some)) / FORWARD_POSES
    return [
        Metric(f"{title}: forward, gap to Pinocchio", float(gap), "mm", "lower", goal=1e-6),
        Metric(f"{title}: inverse, largest residual", residual_mm, "mm", "lower", goal=1e-6),
        Metric(f"{title}: joint vector among the answers", found, "share", "higher", goal=1.0),
        *_completeness(title, model, qs_rad[:PEER_POSES]),
        Metric(
            f"{title}: forward, CPU a pose", forward_us, "us", "lower", None, "Pinocchio", peer_us
        ),
        *_speed(title, model, rng, yardstick),
    ]


def _completeness(title: str, model: RobotModel, qs_rad: Floats) -> list[Metric]:
    """Return how far our set of answers and that of EAIK are the same."""
    solver, Ts_base_flange = all_answers(model), model.forward(qs_rad)
    theirs, ours, goal = None, None, None if solver is None else 1.0
    if solver is not None:
        found = solver.solve(solver.prepared(Ts_base_flange))
        theirs, ours = agreement(model.inverse(Ts_base_flange), found)
    return [
        Metric(f"{title}: answers of EAIK that are among ours", theirs, "share", "higher", goal),
        Metric(f"{title}: our answers that are among EAIK's", ours, "share", "higher"),
    ]


def _speed(
    title: str, model: RobotModel, rng: np.random.Generator, yardstick: Yardstick
) -> list[Metric]:
    """Return the time for all branches of 110 000 poses beside those of two peers."""
    qs_rad = rng.uniform(model.lower_rad, model.upper_rad, (POSES, 6))
    Ts_base_flange = model.forward(qs_rad)
    ours_ms = cpu_ms(lambda: model.inverse(Ts_base_flange))
    yardstick.lay()
    few = Ts_base_flange.select(slice(0, PEER_POSES))
    solver, eaik_ms = all_answers(model), None
    if solver is not None:
        matrices = solver.prepared(few)
        eaik_ms = cpu_ms(lambda: solver.solve(matrices)) * POSES / PEER_POSES
    newton, starts = OneAnswer(model), qs_rad[:200] + rng.uniform(-NEAR_RAD, NEAR_RAD, (200, 6))
    goals = [few[i] for i in range(200)]

    def iterate() -> None:
        for goal, start in zip(goals, starts, strict=True):
            newton.solve(goal, start)

    newton_ms = cpu_ms(iterate) * POSES / 200
    name = f"{title}: {POSES} inverse solutions, all branches, CPU"
    one = f"{title}: the same beside one answer from a posture 2° away"
    return [
        *pair(name, ours_ms / 1e3, yardstick.median_s, INVERSE_S),
        Metric(f"{title}: the same beside EAIK", ours_ms, "ms", "lower", None, "EAIK", eaik_ms),
        Metric(one, ours_ms, "ms", "lower", None, "Newton on Pinocchio", newton_ms),
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
    return worst, float((nearest < SAME_RAD).mean())
