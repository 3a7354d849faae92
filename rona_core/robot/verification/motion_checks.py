"""What the verifier looks at in any motion: joints, the way of the tool, and what is around.

Everything between two samples is looked at as the robot drives it, linear in the joints.

Clearance checks of the verifier: every obstacle, over the whole motion, samples and between. Where
bounds of the distances leave open which sample is nearest to an obstacle, the distance is found. On
the way from a sample to the next no pair of parts comes nearer than the joint steps times its
longest levers. Where that is less than the room at both ends together, nothing can touch in
between; elsewhere the step is halved, and halved again.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats
from rona_core.robot.collision.collision_world import ITSELF, CollisionWorld
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.arm import as_joints
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import TimedMotion
from rona_core.robot.verification.certificate import Check
from rona_core.robot.verification.tolerances import (
    DENSITY,
    EXACT,
    EXCESS,
    HALVINGS,
    SHORTEST_S,
    Tolerances,
)


@dataclass(frozen=True, slots=True, eq=False)
class DenseMotion:
    """A motion at four times its density, as Pinocchio places it."""

    arm: PinocchioArm
    numbers: Floats  # (m,) sample number, in quarters
    times_s: Floats  # (m,)
    qs_rad: Floats  # (m, 6)
    places_base: Floats  # (m, 3) of the probe face
    rotations: Floats  # (m, 3, 3) of the probe


def check(
    name: str,
    values: Floats,
    limit: float,
    unit: str,
    *,
    least: bool = False,
    first: int = 0,
    remark: str = "",
) -> Check:
    """Return a check that no value exceeds the limit (or, with ``least``, none falls below it)."""
    worst = int(np.argmin(values) if least else np.argmax(values))
    value = float(values[worst])
    holds = bool(value >= limit - EXACT if least else value <= limit + EXACT)
    relation = ("at least" if least else "at most") + f" {limit:.4g} {unit}".rstrip()
    verdict = "holds" if holds else "fails"
    index = first + worst
    sentence = f"{name} {verdict}: {value:.4g} {unit} at sample {index}{remark}, "
    sentence += f"{relation} is allowed"
    return Check(name, value, float(limit), unit, index, holds, sentence)


def joint_checks(model: RobotModel, motion: TimedMotion, allowed: Tolerances) -> list[Check]:
    """Check limits, steps, speeds and accelerations of the joints, from rest to rest.

    The first check is that time runs forwards; where it fails, speeds mean nothing and are left
    out.

    Raises:
        InvalidInputError: arrays of the wrong shape, or values that are not finite.
    """
    qs, times = as_joints(motion.qs_rad), as_floats(motion.times_s, name="times_s")
    if times.shape != (len(qs),) or len(qs) < 2:
        raise InvalidInputError(f"a motion needs 2 samples with a time each, not {times.shape}")
    gaps = np.diff(times)
    order = check("time between samples", gaps, SHORTEST_S, "s", least=True)
    room = np.rad2deg(np.minimum(qs - model.lower_rad, model.upper_rad - qs).min(axis=1))
    steps = np.rad2deg(np.abs(np.diff(qs, axis=0)).max(axis=1))
    checks = [
        order,
        check("margin to the joint limits", room, 0.0, "°", least=True),
        check("joint step", steps, float(np.rad2deg(allowed.step_rad)), "°", first=1),
    ]
    if not order.holds:
        return checks
    speeds = np.diff(qs, axis=0) / gaps[:, None]
    resting = np.vstack((np.zeros(6), speeds, np.zeros(6)))  # at rest before and afterwards
    spans = np.concatenate((gaps[:1], (gaps[1:] + gaps[:-1]) / 2.0, gaps[-1:]))
    accelerations = np.diff(resting, axis=0) / spans[:, None]
    speed_share = 100.0 * (np.abs(speeds) / model.speed_rad_per_s).max(axis=1)
    share = 100.0 * (np.abs(accelerations) / model.acceleration_rad_per_s2).max(axis=1)
    checks.append(check("joint speed", speed_share, 100.0 * (1.0 + EXCESS), "%", first=1))
    checks.append(check("joint acceleration", share, 100.0 * (1.0 + EXCESS), "%"))
    return checks


def dense_motion(model: RobotModel, motion: TimedMotion) -> DenseMotion:
    """Return the whole motion at four times its density."""
    samples = np.arange(len(motion.times_s))
    numbers = np.arange((len(samples) - 1) * DENSITY + 1) / DENSITY
    columns = [np.interp(numbers, samples, q) for q in np.asarray(motion.qs_rad).T]
    qs = np.stack(columns, axis=1)
    arm = PinocchioArm(model)
    poses = arm.tool(qs, model.T_flange_probe)
    times = np.interp(numbers, samples, motion.times_s)
    return DenseMotion(arm, numbers, times, qs, poses.translations, poses.rotations)


def tool_checks(dense: DenseMotion, allowed: Tolerances) -> list[Check]:
    """Check that the tool goes nearly straight between samples, and never too fast."""
    places = dense.places_base
    ends = places[::DENSITY]
    share = np.arange(1, DENSITY)[None, :, None] / DENSITY
    chords = ends[:-1, None] * (1.0 - share) + ends[1:, None] * share
    inside = places[:-1].reshape(-1, DENSITY, 3)[:, 1:]
    off_mm = np.linalg.norm(inside - chords, axis=2).max(axis=1)
    steps_mm = np.linalg.norm(np.diff(places, axis=0), axis=1)
    speed = per_sample(steps_mm / np.diff(dense.times_s))
    fastest = allowed.tool_speed_mm_per_s * (1.0 + EXCESS)
    return [
        check("bend between samples", off_mm, allowed.chord_mm, "mm"),
        check("speed of the tool", speed, fastest, "mm/s"),
    ]


def singular_checks(
    arm: PinocchioArm, qs_rad: Floats, first: int, allowed: Tolerances
) -> list[Check]:
    """Check how far the arm stays from losing a freedom at joint angles (m, 6) from one sample."""
    wrist, elbow, shoulder_mm = arm.singular_margins(qs_rad)
    least = float(np.rad2deg(allowed.singular_rad))
    angles = (np.rad2deg(np.arcsin(np.clip(sine, 0.0, 1.0))) for sine in (wrist, elbow))
    checks = [
        check(f"{name} from straight", -per_sample(-angle), least, "°", least=True, first=first)
        for name, angle in zip(("wrist", "elbow"), angles, strict=True)
    ]
    distance = ("wrist from axis 1", -per_sample(-shoulder_mm), allowed.shoulder_mm, "mm")
    checks.append(check(*distance, least=True, first=first))
    return checks


def per_sample(dense: Floats) -> Floats:
    """Return the worst of the dense values that follow each sample."""
    return np.maximum.reduceat(dense, np.arange(0, len(dense), DENSITY))


@dataclass(frozen=True, slots=True, eq=False)
class _Nearest:
    """Where each pair of parts is nearest: of a whole motion, all distances take much memory."""

    distances_mm: Floats  # (p,)
    numbers: Floats  # (p,) of the samples there, the first of equals in the order they came

    @classmethod
    def of(cls, distances: Floats, numbers: Floats, pairs: Bools) -> "_Nearest":
        """Return it of distances (k, c) of some pairs (p,) at samples (k,); others are far."""
        rows = distances.argmin(axis=0)
        nearest = cls(np.full(len(pairs), np.inf), np.zeros(len(pairs)))
        nearest.distances_mm[pairs] = distances[rows, np.arange(len(rows))]
        nearest.numbers[pairs] = numbers[rows]
        return nearest

    def or_nearer(self, later: "_Nearest") -> "_Nearest":
        """Return what is nearer, pair by pair, here or at later places."""
        nearer = later.distances_mm < self.distances_mm
        return _Nearest(
            np.where(nearer, later.distances_mm, self.distances_mm),
            np.where(nearer, later.numbers, self.numbers),
        )


def clearance(
    model: RobotModel, dense: DenseMotion, obstacles: Obstacles
) -> tuple[list[Check], float | None]:
    """Check the whole motion against every obstacle, and the robot against itself.

    It is looked at afresh: nothing of what a planner found is used. Also return the least distance
    of parts that must not touch; None where there is no such pair.
    """
    world = CollisionWorld(model, obstacles)
    return judged(world, _nearest(world, dense))


def _nearest(world: CollisionWorld, dense: DenseMotion) -> _Nearest:
    """Return where each pair is nearest, of all places that are looked at.

    Bounds of the distances leave out most samples: those where no pair can be the nearest of the
    motion, and where every pair keeps room enough for the steps beside.
    """
    qs, numbers = dense.qs_rad[::DENSITY], dense.numbers[::DENSITY]
    bounds = world.bounds_mm(qs)
    least_mm, at = world.least_of_all(qs, bounds)
    room = bounds - world.least_mm
    unsure: Bools = room[:-1] + room[1:] <= np.abs(np.diff(qs, axis=0)) @ world.pair_levers_mm
    pairs: Bools = np.any(unsure, axis=0)
    steps = np.flatnonzero(unsure.any(axis=1))
    nearest = _about(world, dense, _Nearest(least_mm, numbers[at]))
    return _between(world, qs, numbers, pairs, steps, nearest) if len(steps) else nearest


def _about(world: CollisionWorld, dense: DenseMotion, nearest: _Nearest) -> _Nearest:
    """Return where each pair is nearest with the places about the samples where it is."""
    known: Bools = np.isfinite(nearest.distances_mm)
    beside = np.arange(1 - DENSITY, DENSITY)
    rows = (DENSITY * nearest.numbers[known]).astype(np.int64)[:, None] + beside
    rows = np.unique(np.clip(rows, 0, len(dense.numbers) - 1))
    found = world.distances_mm(dense.qs_rad[rows], known)
    return nearest.or_nearer(_Nearest.of(found, dense.numbers[rows], known))


def _between(
    world: CollisionWorld,
    qs: Floats,
    numbers: Floats,
    pairs: Bools,
    steps: Ints,
    nearest: _Nearest,
) -> _Nearest:
    """Return where each pair is nearest with what is found between samples, in some of the steps.

    Args:
        world: The robot and what stands around.
        qs: Joint angles (n, 6) of the samples.
        numbers: Their numbers (n,).
        pairs: Which pairs (p,) may come too near there.
        steps: Those steps, each from a sample to the next.
        nearest: At the samples.
    """
    levers_mm, least_mm = world.pair_levers_mm[:, pairs], world.least_mm[pairs]
    rows = np.union1d(steps, steps + 1)
    room = world.distances_mm(qs[rows], pairs) - least_mm
    low, high = np.searchsorted(rows, steps), np.searchsorted(rows, steps + 1)
    ends = [(of_row[low], of_row[high]) for of_row in (qs[rows], room, numbers[rows])]
    for _ in range(HALVINGS):
        (q_from, q_to), (room_from, room_to), (first, last) = ends
        close = room_from + room_to <= np.abs(q_to - q_from) @ levers_mm
        near = close.any(axis=1) & (np.minimum(room_from, room_to).min(axis=1) >= 0.0)
        if not near.any():
            break
        q_mid, middle = 0.5 * (q_from + q_to)[near], 0.5 * (first + last)[near]
        found = world.distances_mm(q_mid, pairs)
        nearest = nearest.or_nearer(_Nearest.of(found, middle, pairs))
        ends = [
            (np.concatenate((before[near], mid)), np.concatenate((mid, after[near])))
            for (before, after), mid in zip(ends, (q_mid, found - least_mm, middle), strict=True)
        ]
    return nearest


def judged(world: CollisionWorld, nearest: _Nearest) -> tuple[list[Check], float | None]:
    """Return checks for the robot itself, for obstacles in reach, and for what may be touched."""
    checks: list[Check] = []
    for group in (ITSELF, *(thing.name for thing in world.obstacles.things)):
        clear = "clearance of" if group == ITSELF else "clearance from the"
        of_group = np.array([pair.group == group for pair in world.pairs], dtype=np.bool_)
        for words, columns in (
            (clear, np.flatnonzero(of_group & (world.least_mm >= 0.0))),
            ("touch of the", np.flatnonzero(of_group & (world.least_mm < 0.0))),
        ):
            if len(columns):  # else out of reach, or not to be touched
                checks.append(_worst(f"{words} {group}", world, columns, nearest))
    counted = np.flatnonzero(world.least_mm >= 0.0).tolist()
    return checks, min((float(nearest.distances_mm[pair]) for pair in counted), default=None)


def _worst(name: str, world: CollisionWorld, columns: Ints, nearest: _Nearest) -> Check:
    """Return the check of the pair, of those in some columns, that is closest."""
    rooms = nearest.distances_mm[columns] - world.least_mm[columns]
    column = columns[rooms.argmin()]
    pair = world.pairs[int(column)]
    return check(
        name,
        nearest.distances_mm[column][None],
        pair.least_mm,
        "mm",
        least=True,
        first=int(nearest.numbers[column]),
        remark=f" between {pair.first} and {pair.second}",
    )
