"""Motions as others plan them, good ones and ones with a fault planted at a known sample.

None is made by RONA's own timing: splines through random postures, trapezoids of speed, and steps
of degree seven and of a sine, sampled evenly or not.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import Box, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.verification.joint_motion import JointMotion

ROBOTS = ("rx90", "ur5", "ur10")
SHAPES = ("spline", "trapezoid", "septic", "sine")
STATED = ("positions", "speeds", "accelerations")
FAULTS = (
    "position",
    "speed",
    "acceleration",
    "jump of 15 degrees",
    "jump of 2 degrees",
    "self-collision",
    "obstacle",
    "time",
)
ROOM_RAD = np.deg2rad((25.0, 15.0, 15.0, 25.0, 25.0, 40.0))
SHARE = 0.6  # of every limit, at most


@dataclass(frozen=True)
class Curve:
    """Joint angles (n, 6), speeds and accelerations at times (n,)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def step(shape, u):
    """Return a step from 0 to 1 over u in 0 to 1, and its first two derivatives."""
    u = np.clip(u, 0.0, 1.0)
    if shape == "sine":
        turn = 2.0 * np.pi * u
        return u - np.sin(turn) / (2.0 * np.pi), 1.0 - np.cos(turn), 2.0 * np.pi * np.sin(turn)
    if shape == "septic":
        value = u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
        first = 140.0 * u**3 * (1.0 - u) ** 3
        return value, first, 420.0 * u**2 * (1.0 - u) ** 2 * (1.0 - 2.0 * u)
    r = 0.3  # trapezoid: the share of time in which speed is gained
    top = 1.0 / (1.0 - r)
    gain, even = 0.5 * top * u**2 / r, top * (u - r / 2.0)
    lose = 1.0 - 0.5 * top * (1.0 - u) ** 2 / r
    value = np.where(u < r, gain, np.where(u > 1.0 - r, lose, even))
    first = top * np.clip(np.minimum(u, 1.0 - u) / r, 0.0, 1.0)
    second = np.where((u < r), top / r, np.where(u > 1.0 - r, -top / r, 0.0))
    return value, first, second


def curve(rng, model, shape, duration_s):
    """Return a function of times that goes through postures about home, from rest to rest."""
    stops = model.home_rad + rng.uniform(-1.0, 1.0, (4, 6)) * ROOM_RAD
    stops = np.clip(stops, model.lower_rad + 0.1, model.upper_rad - 0.1)
    stops[0] = model.home_rad
    if shape == "spline":
        spline = CubicSpline(np.linspace(0.0, duration_s, 4), stops, bc_type="clamped")
        return lambda t: Curve(spline(t), spline(t, 1), spline(t, 2))
    start, change = stops[0], stops[1] - stops[0]

    def at(t):
        value, first, second = step(shape, t / duration_s)
        return Curve(
            start + value[:, None] * change,
            first[:, None] * change / duration_s,
            second[:, None] * change / duration_s**2,
        )

    return at


@cache
def world(robot):
    return CollisionWorld(robot_model(robot))


@cache
def planned(robot, seed):
    """Return a good curve and its duration: slow enough, and clear by more than is demanded."""
    model, rng = robot_model(robot), np.random.default_rng((seed, ROBOTS.index(robot)))
    shape = SHAPES[seed % len(SHAPES)]
    for _ in range(100):
        first = curve(np.random.default_rng(draw := int(rng.integers(2**32))), model, shape, 1.0)
        dense = first(np.linspace(0.0, 1.0, 201))
        tips = (model.forward(dense.q) @ model.T_flange_probe).translations
        tip = np.linalg.norm(np.diff(tips, axis=0), axis=1).max() * 200.0 / 250.0
        faster = (np.abs(dense.v) / model.speed_rad_per_s).max()
        harder = np.sqrt((np.abs(dense.a) / model.acceleration_rad_per_s2).max())
        duration_s = max(tip, faster, harder / np.sqrt(SHARE)) / SHARE
        if world(robot).report(dense.q[::10]).room_mm.min() > 2.0:
            return curve(np.random.default_rng(draw), model, shape, duration_s), duration_s
    raise AssertionError("no clear motion was found")


def good(robot, seed):
    """Return a motion that ought to be certified, as a file of one kind would state it."""
    at, duration_s = planned(robot, seed)
    stated = STATED[seed // len(SHAPES) % len(STATED)]
    if stated == "accelerations" and seed % len(SHAPES) == SHAPES.index("trapezoid"):
        stated = "positions"  # its acceleration jumps, which a quintic does not follow
    rng = np.random.default_rng(seed)
    gap_s = 0.008 if stated == "positions" else rng.uniform(0.02, 0.06)
    n = int(np.ceil(duration_s / gap_s)) + 1
    times = np.linspace(0.0, duration_s, n)
    if stated != "positions":
        times[1:-1] += rng.uniform(-0.2, 0.2, n - 2) * gap_s
    found = at(times)
    speeds = None if stated == "positions" else found.v
    return JointMotion(times, found.q, speeds, found.a if stated == "accelerations" else None)


def swing(robot, change):
    """Return a motion that goes from home to a change (6,) of it and back, and where it turns."""
    model = robot_model(robot)
    line = model.home_rad + np.linspace(0.0, 1.0, 101)[:, None] * change
    tips = (model.forward(line) @ model.T_flange_probe).translations
    tip_s = 2.2 * 101.0 * np.linalg.norm(np.diff(tips, axis=0), axis=1).max() / 250.0
    joint_s = 2.2 * (np.abs(change) / model.speed_rad_per_s).max()
    hard_s = np.sqrt(7.6 * (np.abs(change) / model.acceleration_rad_per_s2).max())
    half = int(np.ceil(max(tip_s, joint_s, hard_s) / SHARE / 0.008)) + 1
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, half))  # it turns back at once
    q = model.home_rad + np.concatenate((share, share[-2::-1]))[:, None] * change
    return np.arange(len(q)) * 0.008, q, half - 1


def touching_itself(robot, rng):
    """Return a change (6,) of home at which the arm has just come too close to itself."""
    model = robot_model(robot)
    for _ in range(500):
        goal = rng.uniform(model.lower_rad, model.upper_rad)
        goal[0] = model.home_rad[0]
        line = model.home_rad + np.linspace(0.0, 1.0, 61)[:, None] * (goal - model.home_rad)
        room = world(robot).report(line).room_mm
        first = int(np.argmax(room < 0.0))
        if room[first] < 0.0 and first + 1 < len(line) and room[first + 1] < room[first] - 1.0:
            return line[first + 1] - model.home_rad
    raise AssertionError("it never touches itself")


def faulty(robot, fault, seed):
    """Return a motion with a fault, the obstacles it was planned among, and the sample of it."""
    model, rng = robot_model(robot), np.random.default_rng((seed, 7))
    around, joint = Obstacles(()), int(rng.integers(6))
    if fault == "self-collision":
        times, q, k = swing(robot, touching_itself(robot, rng))
        return JointMotion(times, q), around, k
    if fault == "obstacle":
        change = np.deg2rad(rng.uniform(15.0, 40.0)) * rng.choice((-1.0, 1.0)) * np.eye(6)[0]
        times, q, k = swing(robot, change)
        return JointMotion(times, q), Obstacles((wall(model, q, k),)), k
    if fault == "position":
        joint = int(rng.choice((0, 3, 4, 5)))
        beyond = model.upper_rad[joint] + np.deg2rad(3.0) - model.home_rad[joint]
        times, q, k = swing(robot, beyond * np.eye(6)[joint])
        return JointMotion(times, q), around, k
    at, duration_s = planned(robot, seed)
    n = int(np.ceil(duration_s / 0.008)) + 1
    times = np.linspace(0.0, duration_s, n)
    q, k = at(times).q.copy(), int(rng.integers(n // 3, 2 * n // 3))
    if fault == "speed":
        moves = (np.abs(np.diff(q, axis=0)) / model.speed_rad_per_s).max(axis=1)
        k = int(np.argmax(moves)) + 1
        times[k:] -= (times[k] - times[k - 1]) - moves[k - 1] / 1.5
    elif fault == "acceleration":
        gained = 2.0 * model.acceleration_rad_per_s2[joint] * 0.008
        q[k:, joint] += gained * 0.1 * (1.0 - np.exp(-(times[k:] - times[k]) / 0.1))
    elif fault.startswith("jump"):
        q[k:, joint] += np.deg2rad(15.0 if "15" in fault else 2.0) * rng.choice((-1.0, 1.0))
    elif fault == "time":
        times[k] = times[k - 1] - rng.choice((0.0, 0.004))
    return JointMotion(times, q), around, k


def wall(model, q, k):
    """Return a wall that the face of the probe enters by 3 mm where it turns back, at sample k."""
    face = (model.forward(q) @ model.T_flange_probe).translations
    way = face[k] - face[k - 5]
    z = way / np.linalg.norm(way)
    x = np.linalg.svd(z[None])[2][1]
    middle = face[k] + (5.0 - 3.0) * z
    pose = Pose(np.column_stack((x, np.cross(z, x), z)), middle)
    return Obstacle("wall", Box((30.0, 30.0, 10.0)), pose, 0.0)
