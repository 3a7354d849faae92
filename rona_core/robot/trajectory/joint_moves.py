"""Moves of the joints from rest to rest, away from the scan path, around what is in the way.

First the straight move, then a few detours that usually do (up and over, by way of home), then
RRT-Connect. See docs/algorithms/robot/collision_free_moves.md.

RRT-Connect (Kuffner 2000): collision-free joint paths by two growing trees, and shortcuts. Both
trees grow towards random places and then towards each other. The numbers come from a seed, so that
the same question has the same answer.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.edge_check import MOST_CHECKS, Checker, Clear
from rona_core.robot.kinematics.arm import as_posture
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import SAMPLE_S, Trajectory, sampled_motion

GROWTH_RAD = 0.5  # length of a branch, in weighted joint angles
WEIGHTS = np.array((1.0, 1.0, 1.0, 0.5, 0.5, 0.3))  # the first joints move the most
ROOM_RAD = float(np.deg2rad(80.0))  # random places lie this far beyond start and goal
SHORTCUTS = 60
COARSE = (4, 2, 1)  # how many times farther apart places are looked at while trees grow
ARRIVED = 1e-9


class _Tree:
    """Places reached from one end, each with the place it was reached from."""

    def __init__(self, root: Floats) -> None:
        self.places, self.parents = [root], [-1]
        self.weighted = [root * WEIGHTS]

    def nearest(self, q: Floats) -> int:
        gaps = np.array(self.weighted) - q * WEIGHTS
        return int(np.argmin(np.einsum("ij,ij->i", gaps, gaps)))

    def add(self, q: Floats, parent: int) -> int:
        self.places.append(q)
        self.parents.append(parent)
        self.weighted.append(q * WEIGHTS)
        return len(self.places) - 1

    def branch(self, index: int) -> list[Floats]:
        """Return the places from the root to one of them."""
        result: list[Floats] = []
        while index >= 0:
            result.append(self.places[index])
            index = self.parents[index]
        return result[::-1]


def search(q_from_rad: Floats, q_to_rad: Floats, checker: Checker, seed: int) -> Floats | None:
    """Return joint angles (k, 6) of a clear way from one place to another, None if none is found.

    Both ends are taken to be clear. Trees grow on a coarse look; a way that they find is looked at
    closely, and if it is not clear the search begins again with a closer look. It ends when the
    checker has looked at as many places as it may.
    """
    rng = np.random.default_rng(seed)
    for coarse in COARSE:
        stops = _search(q_from_rad, q_to_rad, checker, rng, coarse)
        if stops is None:
            return None
        if all(checker.move(a, b) for a, b in pairwise(stops)):
            return stops
    return None


def _search(
    q_from_rad: Floats,
    q_to_rad: Floats,
    checker: Checker,
    rng: np.random.Generator,
    coarse: int,
) -> Floats | None:
    limits = checker.model.limits
    low = np.maximum(np.minimum(q_from_rad, q_to_rad) - ROOM_RAD, limits.lower_rad)
    high = np.minimum(np.maximum(q_from_rad, q_to_rad) + ROOM_RAD, limits.upper_rad)
    growing, other = _Tree(q_from_rad), _Tree(q_to_rad)
    swapped = False
    while not checker.spent:
        reached = _grow(growing, rng.uniform(low, high), checker, coarse)
        if reached >= 0:
            met = _connect(other, growing.places[reached], checker, coarse)
            if met >= 0:
                start, end = growing.branch(reached), other.branch(met)[::-1]
                stops = np.array(start + end[1:])
                return stops[::-1].copy() if swapped else stops
        growing, other, swapped = other, growing, not swapped
    return None


def shortened(stops_rad: Floats, checker: Checker, seed: int) -> Floats:
    """Return a clear way (k, 6) without the detours that can be cut off."""
    rng = np.random.default_rng(seed)
    stops = [np.asarray(q) for q in stops_rad]
    for _ in range(SHORTCUTS):
        if len(stops) == 2:
            break
        first, last = np.sort(rng.uniform(0.0, len(stops) - 1.0, 2))
        i, j = int(first), min(int(last), len(stops) - 2)
        if i == j:
            continue
        a = stops[i] + (first - i) * (stops[i + 1] - stops[i])
        b = stops[j] + (last - j) * (stops[j + 1] - stops[j])
        if checker.move(a, b):
            stops = [*stops[: i + 1], a, b, *stops[j + 1 :]]
    return np.array(_straightened(stops, checker))


def _straightened(stops: list[Floats], checker: Checker) -> list[Floats]:
    """Return the way with every place left out that can be passed by."""
    result = [stops[0]]
    i = 0
    while i < len(stops) - 1:
        j = len(stops) - 1
        while j > i + 1 and not checker.move(stops[i], stops[j]):
            j -= 1
        result.append(stops[j])
        i = j
    return result


def _grow(tree: _Tree, towards: Floats, checker: Checker, coarse: int) -> int:
    """Grow one branch towards a place; return the new place, -1 where it is blocked at once."""
    nearest = tree.nearest(towards)
    start = tree.places[nearest]
    length = float(np.linalg.norm((towards - start) * WEIGHTS))
    end = start + min(1.0, GROWTH_RAD / max(length, ARRIVED)) * (towards - start)
    if not checker.move(start, end, coarse):
        return -1
    return tree.add(end, nearest)


def _connect(tree: _Tree, goal: Floats, checker: Checker, coarse: int) -> int:
    """Grow towards the goal until it is reached (its number in this tree) or blocked (-1)."""
    while not checker.spent:
        reached = _grow(tree, goal, checker, coarse)
        if reached < 0:
            return -1
        if np.abs(tree.places[reached] - goal).max() < ARRIVED:
            return reached
    return -1


SPEED_SHARE = 0.3  # of the joint speed limits, for moves that are not scans
ACCELERATION_SHARE = 0.9
TIP_SPEED_MM_PER_S = 250.0  # what robots near people are commonly held to
PEAK_SPEED, PEAK_ACCELERATION = 1.875, 10.0 / np.sqrt(3.0)  # of the quintic below, for T = 1
TIP_SAMPLES = 64
LIFTS_MM = (100.0, 200.0, 300.0)
LIFT_STEP_MM = 20.0
LARGEST_LIFT_STEP_RAD = float(np.deg2rad(30.0))  # more is another branch of the arm


def smooth_step(share: Floats) -> Floats:
    """Return 10 u^3 - 15 u^4 + 6 u^5: from 0 to 1 with rest, and no acceleration, at both ends."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def sample_times(duration_s: float) -> Floats:
    """Return sample times from 0 that cover ``duration_s``, rounded up to whole samples."""
    count = max(1, int(np.ceil(duration_s / SAMPLE_S - 1e-9)))
    return np.arange(count + 1, dtype=np.float64) * SAMPLE_S


def joint_move(model: RobotModel, q_from_rad: Floats, q_to_rad: Floats) -> Floats:
    """Return samples (n, 6) of a straight move in joint space, ``SAMPLE_S`` apart.

    All joints start and stop together. The slowest of joint speed, joint acceleration and the
    speed of the tip decides how long it takes.
    """
    change = q_to_rad - q_from_rad
    by_speed = PEAK_SPEED * np.abs(change) / (SPEED_SHARE * model.speed_rad_per_s)
    most = ACCELERATION_SHARE * model.acceleration_rad_per_s2
    by_acceleration = np.sqrt(PEAK_ACCELERATION * np.abs(change) / most)
    u = np.linspace(0.0, 1.0, TIP_SAMPLES + 1)[:, None]
    tips = (model.forward(q_from_rad + u * change) @ model.T_flange_tip).translations
    tip_mm = np.linalg.norm(np.diff(tips, axis=0), axis=1).max() * TIP_SAMPLES
    by_tip = PEAK_SPEED * tip_mm / (ACCELERATION_SHARE * TIP_SPEED_MM_PER_S)
    times = sample_times(max(by_speed.max(), by_acceleration.max(), by_tip))
    qs = q_from_rad + smooth_step(times / times[-1])[:, None] * change
    qs[-1] = q_to_rad
    return qs


def chain(parts: Sequence[Floats]) -> Floats:
    """Return motions that follow each other as one; each starts where the last one ended."""
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def clear_move(
    model: RobotModel,
    q_from_rad: Floats,
    q_to_rad: Floats,
    clear: Clear | None,
) -> Floats:
    """Return samples (n, 6) of a move on which nothing is touched, ``SAMPLE_S`` apart.

    It is the straight move where that is clear or nothing is known of the surroundings
    (``clear`` is None); otherwise it rests at each place that it goes by.

    Raises:
        NotReachableError: no clear way was found.
    """
    if clear is None:
        return joint_move(model, q_from_rad, q_to_rad)
    stops = plan_joint_path(q_from_rad, q_to_rad, model, clear)
    return chain([joint_move(model, a, b) for a, b in pairwise(stops)])


def plan_joint_move(
    q_from_rad: ArrayLike,
    q_to_rad: ArrayLike,
    model: RobotModel,
    *,
    clear: Clear | None = None,
) -> Trajectory:
    """Plan a move in joint space from rest to rest: straight, or around what is in the way.

    Args:
        q_from_rad: Joint angles (6,) where the robot stands.
        q_to_rad: Joint angles (6,) to go to.
        model: The robot.
        clear: Maps joint angles (n, 6) to where nothing is touched; None: nothing is around.

    Raises:
        InvalidInputError: wrong shapes.
        NotReachableError: the goal lies outside the joint limits, or no clear way was found.
    """
    q_from = as_posture(q_from_rad, name="q_from_rad")
    q_to = as_posture(q_to_rad, name="q_to_rad")
    room = model.limits.clearance_rad(q_to)
    if room.min() < 0.0:
        joint = int(np.argmin(room))
        low, high, goal = np.rad2deg((model.lower_rad[joint], model.upper_rad[joint], q_to[joint]))
        raise NotReachableError(
            f"joint {joint + 1} cannot go to {goal:.1f}°: it moves from {low:.1f}° to {high:.1f}°",
            joint=joint + 1,
        )
    return sampled_motion(clear_move(model, q_from, q_to, clear))


def plan_joint_path(
    q_from_rad: Floats,
    q_to_rad: Floats,
    model: RobotModel,
    clear: Clear,
    *,
    seed: int = 0,
    most_checks: int = MOST_CHECKS,
) -> Floats:
    """Return joint angles (k, 6) to move through, straight in between, all of it clear.

    Args:
        q_from_rad: Joint angles (6,) where the robot stands.
        q_to_rad: Joint angles (6,) to go to.
        model: The robot.
        clear: Maps joint angles (n, 6) to where nothing is touched.
        seed: Of the search, where one is needed; the same seed finds the same way.
        most_checks: Places looked at before the search gives up.

    Raises:
        NotReachableError: start or goal touch something, or no way was found in time.
    """
    checker = Checker(model, clear, most_checks)
    for name, q in (("stands", q_from_rad), ("is to go", q_to_rad)):
        if not checker.place(q):
            raise NotReachableError(f"where the robot {name} it touches something or comes close")
    share = checker.clear_share(q_from_rad, q_to_rad)
    if share == 1.0:
        return np.stack((q_from_rad, q_to_rad))
    for vias in _usual_ways(model, q_from_rad, q_to_rad):
        if checker.spent:
            break
        stops = np.stack((q_from_rad, *vias, q_to_rad))
        if all(checker.move(a, b) for a, b in pairwise(stops)):
            return stops
    found = search(q_from_rad, q_to_rad, checker, seed)
    if found is None:
        raise NotReachableError(
            f"no way to the goal without touching something was found among {checker.checks} "
            f"places; the straight move is clear for its first {100.0 * share:.0f} %",
            clear_share=share,
        )
    return shortened(found, checker, seed)


def _usual_ways(model: RobotModel, q_from: Floats, q_to: Floats) -> Sequence[tuple[Floats, ...]]:
    """Return places to go by, the shortest detours first."""
    lifted_from, lifted_to = raised(model, q_from), raised(model, q_to)
    ways: list[tuple[Floats, ...]] = []
    for i in range(len(LIFTS_MM)):
        over = [lifts[i] for lifts in (lifted_from, lifted_to) if i < len(lifts)]
        ways += [(via,) for via in over]
        if len(over) == 2:
            ways.append((over[0], over[1]))
    ways.append((model.home_rad,))
    ways += [(via, model.home_rad) for via in lifted_from]
    ways += [(model.home_rad, via) for via in lifted_to]
    return ways


def raised(model: RobotModel, q_rad: Floats) -> list[Floats]:
    """Return joint angles (6,) with the tool lifted straight up by ``LIFTS_MM``, while it can be.

    The tool keeps its orientation and the arm its branch.
    """
    T_base_flange = model.forward(q_rad[None])[0]
    heights_mm = np.arange(LIFT_STEP_MM, LIFTS_MM[-1] + LIFT_STEP_MM / 2.0, LIFT_STEP_MM)
    places = T_base_flange.translation + heights_mm[:, None] * np.array((0.0, 0.0, 1.0))
    rotations = np.repeat(T_base_flange.rotation[None], len(places), axis=0)
    qs = model.follow(Poses(rotations, places), q_rad, LARGEST_LIFT_STEP_RAD)
    reached_mm = heights_mm[: len(qs)]
    return [q for q, height_mm in zip(qs, reached_mm, strict=True) if height_mm in LIFTS_MM]
