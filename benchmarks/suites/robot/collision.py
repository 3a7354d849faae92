"""Collisions: cost of a check and of a certificate, and planted faults that must be caught."""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from rona_core.devices.workcell import Surroundings
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import (
    LARGE_HEAD_MM,
    Capsule,
    Hull,
    Obstacle,
    Obstacles,
    head_from_cloud,
    table_and_floor,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.joint_moves import joint_move
from rona_core.robot.verification.tolerances import Tolerances
from rona_core.robot.verification.verifier import verify_motion

CONFIGURATIONS = 1526  # the dense points of the longer scan over a sphere patch
HEADS = 40
JUMP_DEG = 158.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Joint angles (n, 6) at times (n,)."""

    times_s: Floats
    qs_rad: Floats


def run(progress: Progress) -> list[Metric]:
    """Return times per 1526 configurations, what is caught, and how cautious the head is."""
    model = robot_model("rx90")
    obstacles = scene()
    world = CollisionWorld(model, obstacles)
    rng = np.random.default_rng(11)
    home = model.home_rad
    near = home + rng.normal(0.0, 0.12, (CONFIGURATIONS, 6))
    anywhere = rng.uniform(model.lower_rad, model.upper_rad, (CONFIGURATIONS, 6))
    progress(f"{len(world.pairs)} pairs in {CONFIGURATIONS} configurations")
    agree = (world.clear(anywhere) == (world.report(anywhere).room_mm >= 0.0)).mean()
    near_ms = cpu_ms(lambda: world.clear(near))
    anywhere_ms = cpu_ms(lambda: world.clear(anywhere))
    report_ms = cpu_ms(lambda: world.report(near))
    build_ms = cpu_ms(lambda: CollisionWorld(model, obstacles))
    progress("planted faults")
    caught = planted(model, obstacles)
    progress(f"{HEADS} heads from patches")
    outside_mm, proud_mm = heads()
    goal = 50.0
    return [
        Metric("1526 checks about the work, CPU", near_ms, "ms", "lower", goal),
        Metric("1526 checks anywhere, CPU", anywhere_ms, "ms", "lower", goal),
        Metric("1526 reports with the nearest pairs, CPU", report_ms, "ms", "lower"),
        Metric("building the collision world, CPU", build_ms, "ms", "lower"),
        Metric("check and distances agree", float(agree), "share", "higher", 1.0),
        Metric("planted faults caught, each by its check alone", caught, "share", "higher", 1.0),
        Metric("large head outside its bound", outside_mm, "mm", "lower", 10.0),
        Metric("bound above the patch (median)", proud_mm, "mm", "lower"),
    ]


def scene() -> Obstacles:
    """Return a head under the place of work, made of a patch, with table and floor."""
    rng = np.random.default_rng(5)
    flat = rng.uniform(-32.0, 32.0, (2000, 2))
    flat = flat[np.hypot(*flat.T) < 32.0]
    height = np.sqrt(90.0**2 - (flat**2).sum(axis=1)) - 90.0
    place = robot_model().work_area.region_base
    points = np.column_stack((flat, height)) + place
    head = head_from_cloud(points, (0.0, 0.0, 1.0), 10.0)
    return Obstacles(
        (
            head,
            *table_and_floor(Surroundings(), Pose.identity(), place),
        )
    )


def planted(model: RobotModel, obstacles: Obstacles) -> float:
    """Return the share of planted faults that one check, the right one, catches."""
    home = model.home_rad
    goal = home + np.array((0.5, -0.1, -0.1, 0.1, 0.3, 0.2))
    qs = joint_move(model, home, goal)
    move = at_rate(qs)
    jump = home + np.outer(np.arange(40) >= 20, np.deg2rad(JUMP_DEG) * np.eye(6)[5])
    slow = np.arange(40.0) + 60.0 * (np.arange(40) >= 20)
    beyond = joint_move(model, home, np.where(np.arange(6) == 0, model.upper_rad + 0.01, home))
    tip = (model.forward(qs[len(qs) // 2][None]) @ model.T_flange_probe).translations[0]
    ball = Obstacle("ball", Capsule(15.0, 0.0), Pose.from_translation(tip), 5.0)
    crowded = replace(obstacles, things=(*obstacles.things, ball))
    speed = np.abs(np.diff(qs, axis=0)).max(axis=0) / 0.02
    rates = np.diff(np.vstack((qs[:1], qs, qs[-1:])), 2, axis=0)
    acceleration = np.abs(rates).max(axis=0) / 0.02**2
    limits = model.limits
    hasty = replace(limits, speed_rad_per_s=readonly(0.99 * np.asarray(speed, dtype=np.float64)))
    rough = replace(
        limits, acceleration_rad_per_s2=readonly(0.99 * np.asarray(acceleration, dtype=np.float64))
    )
    loose = Tolerances(chord_mm=1e3)
    cases = (
        (model, move, obstacles, None),
        (model, Motion(slow, jump), obstacles, "joint step"),
        (model, at_rate(beyond), obstacles, "margin to the joint limits"),
        (model, move, crowded, "clearance from the ball"),
        (replace(model, limits=hasty), move, obstacles, "joint speed"),
        (replace(model, limits=rough), move, obstacles, "joint acceleration"),
    )
    right = 0
    for arm, motion, around, expected in cases:
        failures = verify_motion(arm, motion, loose, around).failures()
        right += [check.name for check in failures] == ([] if expected is None else [expected])
    return right / len(cases)


def at_rate(qs_rad: Floats) -> Motion:
    """Return samples 20 ms apart as a motion."""
    return Motion(0.02 * np.arange(len(qs_rad), dtype=np.float64), qs_rad)


def heads() -> tuple[float, float]:
    """Return by how much large heads stick out of what their patches tell, and how proud it is."""
    rng = np.random.default_rng(9)
    worst, proud = 0.0, []
    for _ in range(HEADS):
        axes = np.array(LARGE_HEAD_MM) / 2.0 * rng.uniform(0.85, 1.0)
        ways = rng.normal(size=(3000, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        middle = ways[0]
        near = middle + rng.uniform(-0.4, 0.4, (3000, 3))
        patch = near / np.linalg.norm(near, axis=1, keepdims=True) * axes
        patch = patch[np.linalg.norm(patch - middle * axes, axis=1) < 36.0]
        patch = patch + rng.normal(0.0, 0.3, patch.shape)
        outward = middle / axes
        found = head_from_cloud(patch, outward / np.linalg.norm(outward), 10.0)
        corners = found.shape.vertices if isinstance(found.shape, Hull) else patch
        directions = rng.normal(size=(500, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        gap = (ways * axes @ directions.T).max(axis=0) - (corners @ directions.T).max(axis=0)
        worst = max(worst, float(gap.max()))
        proud.append(found.touch_mm)
    return worst, float(np.median(proud))
