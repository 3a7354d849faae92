"""Does the robot come too close to anything, itself included?

See docs/algorithms/robot/collision.md.

Least distances of convex bodies: from balls, and from planes that part them near by. Two convex
bodies are as far apart as the widest gap that a plane with any normal leaves between them (Gilbert
1988). So every normal gives a lower bound of their distance, and the one that is best at one place
of the robot is nearly as good at the places about it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.robot.collision.coal_geometry import Bodies, Pair
from rona_core.robot.collision.collision_geometry import (
    DELAY_LINE,
    PROBE,
    PROBE_BODY,
    TOUCHING,
    ConvexBody,
    collision_bodies,
)
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Box, Capsule, Obstacle, Obstacles
from rona_core.robot.kinematics.arm import as_joints
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.wrists import SphericalWristArm

STANDING = 0  # the link that never moves: obstacles are in its frame, which is ``base``


class SeparatingPlanes:
    """Bounds of the distances of p pairs of bodies."""

    def __init__(
        self,
        pairs: Sequence[Pair],
        bodies: Sequence[ConvexBody],
        things: Sequence[Obstacle],
    ) -> None:
        """Keep the corners of all bodies, in mm in the frames of their links."""
        links = {thing.name: STANDING for thing in things}
        links |= {body.name: body.link for body in bodies}
        corners = {thing.name: _corners(thing) for thing in things}
        corners |= {body.name: (body.vertices, 0.0) for body in bodies}
        ends = [[pair.first for pair in pairs], [pair.second for pair in pairs]]
        self._links: Ints = np.array([[links[name] for name in end] for end in ends], np.int64)
        self._corners = [[corners[name][0] for name in end] for end in ends]
        self._rounding_mm = np.array([[corners[name][1] for name in end] for end in ends])
        names = list(corners)
        balls = [_ball(points) for points, _ in corners.values()]
        self._ball_links = np.array([links[name] for name in names], np.int64)
        self._centers = np.array([center for center, _ in balls])
        self._balls = np.array([[names.index(name) for name in end] for end in ends], np.int64)
        radii_mm = np.array([radius_mm for _, radius_mm in balls])
        self._reach_mm = (radii_mm[self._balls] + self._rounding_mm).sum(axis=0)

    def between_balls_mm(self, rotations: Floats, places: Floats, chosen: Ints) -> Floats:
        """Return what some pairs keep apart at least by balls about them, (k, n).

        Quicker than ``bounds_mm``, and enough for most.

        Args:
            rotations: Of the link frames, (n, 7, 3, 3).
            places: Of the link frames, (n, 7, 3) in ``base``.
            chosen: Which pairs, (k,).
        """
        # the n come last: loops over three numbers are slow
        axes = np.ascontiguousarray(rotations.transpose(3, 2, 1, 0))
        centers = np.ascontiguousarray(places.transpose(2, 1, 0))[:, self._ball_links]
        for axis, along_mm in zip(axes, self._centers.T, strict=True):
            centers += axis[:, self._ball_links] * along_mm[:, None]
        first, second = self._balls[:, chosen]
        off = centers[:, second] - centers[:, first]
        return np.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2) - self._reach_mm[chosen, None]

    def bounds_mm(
        self, rotations: Floats, places: Floats, chosen: Ints, normals_base: Floats
    ) -> Floats:
        """Return what some pairs keep apart at least, (n, k); NaN where a normal is.

        Args:
            rotations: Of the link frames, (n, 7, 3, 3).
            places: Of the link frames, (n, 7, 3) in ``base``.
            chosen: Which pairs, (k,).
            normals_base: Unit vectors (k, 3) from the first body of each to the second, of planes
                that separate them at the middle one of the n.
        """
        first, second = self._links[:, chosen]
        # the planes go with the second body: in its frame the normals stay as they are
        own = np.einsum("kji,kj->ki", rotations[len(rotations) // 2, second], normals_base)
        normals = np.einsum("nkij,kj->nki", rotations[:, second], own)
        turned = np.einsum("nkji,nkj->kin", rotations[:, first], normals)
        before, behind = np.zeros((len(chosen), len(rotations))), np.zeros(len(chosen))
        for row, pair in enumerate(chosen.tolist()):
            (self._corners[0][pair] @ turned[row]).max(axis=0, out=before[row])
            behind[row] = (self._corners[1][pair] @ own[row]).min()
        apart = np.einsum("nki,nki->nk", normals, places[:, second] - places[:, first])
        return apart + behind - before.T - self._rounding_mm[:, chosen].sum(axis=0)


def _ball(points: Floats) -> tuple[Floats, float]:
    """Return the centre (3,) and the radius of a ball about points (n, 3)."""
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return center, float(np.linalg.norm(points - center, axis=1).max())


def _corners(thing: Obstacle) -> tuple[Floats, float]:
    """Return points (n, 3) in ``base``, and how far the obstacle reaches beyond their hull."""
    shape = thing.shape
    if isinstance(shape, Capsule):
        half = np.array((0.0, 0.0, 0.5 * shape.length_mm))
        return thing.pose @ np.stack((-half, half)), shape.radius_mm
    if isinstance(shape, Box):
        signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
        return thing.pose @ (signs * np.array(shape.size_mm)), 0.0
    return thing.pose @ shape.vertices, 0.0


POSITIONS = 100  # in which parts that may be far from each other are tried
FAR_MM = 60.0  # parts that stay farther apart are never near
BLOCK = 32  # places whose distances are bounded by those at the middle one
STRETCH = 256  # places whose distances are bounded by planes at the middle one
SPAN = 64  # likewise, where the bounds are to be close
AT_ONCE = 16  # places looked at before others are left out
TOGETHER = 512  # places whose link frames are computed at once
FEW = 8  # places for which that does not pay
SLACK_MM = 0.01  # more than distances vary with where the search for them starts
ROUNDED = 6  # decimals of a distance
MOVING = 2  # obstacles matter from this link on: base and shoulder stay where they are
ITSELF = "the robot itself"


@dataclass(frozen=True, slots=True)
class ClosestPair:
    """Two parts of the robot, or a part and an obstacle, and how far apart they are."""

    first: str
    second: str
    apart_mm: float  # negative inside
    least_mm: float  # that must be kept


@dataclass(frozen=True, slots=True, eq=False)
class CollisionReport:
    """How close the robot comes to anything at each of n places, and which parts do."""

    pairs: tuple[Pair, ...]  # that are looked at
    clearance_mm: Floats  # (n,) least distance of any pair, those that may touch left out
    room_mm: Floats  # (n,) least distance beyond what is demanded; negative: too close
    closest: Ints  # (n,) the closest pair
    first_hit: int  # the first place that is too close, -1 for none

    def closest_pair(self, place: int) -> ClosestPair:
        """Return the closest pair at one place."""
        pair = self.pairs[self.closest[place]]
        apart_mm = pair.least_mm + float(self.room_mm[place])
        return ClosestPair(pair.first, pair.second, apart_mm, pair.least_mm)


class CollisionWorld:
    """Robot, tool and what stands around them, as convex bodies.

    Attributes:
        obstacles: What stands around.
        pairs: The parts that can meet, and how far each two must keep apart.
        least_mm: That distance of every pair, (p,).
        pair_levers_mm: How far a joint moves two parts past each other at most, in mm a radian,
            (6, p).
    """

    def __init__(self, model: RobotModel, obstacles: Obstacles = NOTHING_AROUND) -> None:
        """Build the bodies and find the pairs that can meet."""
        self.obstacles, self._arm = obstacles, model.arm
        bodies = collision_bodies(model)
        self._bodies = Bodies(model, bodies, obstacles.things)
        self.pairs = (
            *self._own_pairs(model),
            *(
                pair
                for thing in obstacles.things
                if self._bodies.within_reach(thing)
                for pair in _pairs_with(thing, bodies)
            ),
        )
        self._bodies.look_at(self.pairs)
        self.least_mm = readonly(np.array([pair.least_mm for pair in self.pairs]))
        self.pair_levers_mm = readonly(self._bodies.pair_levers_mm(self.pairs))
        self._planes = SeparatingPlanes(self.pairs, bodies, obstacles.things)
        self._counted = self.least_mm >= 0.0
        kinds = [(pair.group, pair.least_mm) for pair in self.pairs]
        self._kinds = [
            np.array([kind == other for other in kinds]) for kind in dict.fromkeys(kinds)
        ]

    def _own_pairs(self, model: RobotModel) -> list[Pair]:
        """Return which parts of the robot can meet.

        Of an arm bounded by hulls of its solids, parts that are too close at rest already are
        taken as built that way.
        """
        least_mm = self.obstacles.self_margin_mm
        pairs = [Pair(first, second, ITSELF, least_mm) for first, second in _own_pairs(model)]
        if isinstance(model.arm, SphericalWristArm):
            return pairs
        self._bodies.look_at(tuple(pairs))
        apart_mm = self._bodies.distances_mm(model.home_rad)
        return [
            pair
            for pair, distance in zip(pairs, apart_mm, strict=True)
            if distance >= pair.least_mm
        ]

    def clear(self, qs_rad: ArrayLike) -> Bools:
        """Return at which joint angles (n, 6) everything keeps its distance, (n,)."""
        qs = as_joints(qs_rad)
        clear = np.ones(len(qs), dtype=np.bool_)
        clear[list(self._too_close(qs))] = False
        return clear

    def first_hit(self, qs_rad: ArrayLike) -> int:
        """Return the first of joint angles (n, 6) at which anything is too close, -1 for none."""
        return next(self._too_close(as_joints(qs_rad)), -1)

    def distances_mm(self, qs_rad: ArrayLike, pairs: Bools | None = None) -> Floats:
        """Return the distances (n, k) at joint angles (n, 6): of every pair, or of k chosen."""
        qs = as_joints(qs_rad)
        chosen: Bools = np.ones(len(self.pairs), dtype=np.bool_) if pairs is None else pairs
        found = np.zeros((len(qs), np.count_nonzero(chosen)))
        self._bodies.choose(chosen)
        for i, q in enumerate(qs):
            found[i] = self._bodies.distances_mm(q)
        return np.round(found, ROUNDED, out=found)

    def bounds_mm(self, qs_rad: ArrayLike) -> Floats:
        """Return what every pair keeps apart at least (n, p) at joint angles (n, 6).

        Close to the distance for pairs that may be the nearest of an obstacle, where the places
        follow each other closely. Where the links are is Pinocchio's word, not the planner's.
        """
        qs = as_joints(qs_rad)
        kept_mm = np.zeros((len(qs), len(self.pairs)))
        for start in range(0, len(qs), SPAN):
            block, rows = qs[start : start + SPAN], slice(start, start + SPAN)
            kept_mm[rows], most = self._bounds_mm(block)
            pairs = np.flatnonzero(self._decisive(kept_mm[rows], most))
            frames, normals = self._bodies.link_frames(block), self._bodies.normals_base(pairs)
            by_planes = self._planes.bounds_mm(*frames, pairs, normals) - SLACK_MM
            kept_mm[rows, pairs] = np.fmax(kept_mm[rows, pairs], by_planes)
        return kept_mm

    def least_of_all(self, qs_rad: ArrayLike, bounds_mm: Floats) -> tuple[Floats, Ints]:
        """Return where pairs are nearest over joint angles (n, 6), n at least 1.

        Of every obstacle, and of every distance that is demanded, the nearest pair is known.

        Args:
            qs_rad: Joint angles (n, 6).
            bounds_mm: What every pair keeps apart at least there, (n, p).

        Returns:
            Least distance of each pair (p,), infinite where it cannot be the nearest, and the place
            of it (p,), the first of equals.
        """
        qs = as_joints(qs_rad)
        least_mm, at = np.full(len(self.pairs), np.inf), np.zeros(len(self.pairs), dtype=np.int64)
        for of_kind in self._kinds:
            bounds = np.where(of_kind, bounds_mm, np.inf)
            lowest = bounds.min(axis=1)
            left = np.argsort(lowest, kind="stable")
            while len(left) and lowest[left[0]] <= least_mm[of_kind].min():
                rows, left = np.sort(left[:AT_ONCE]), left[AT_ONCE:]
                pairs: Bools = bounds[rows].min(axis=0) <= least_mm[of_kind].min()
                found = self.distances_mm(qs[rows], pairs)
                first = found.argmin(axis=0)
                there, place = found[first, np.arange(len(first))], rows[first]
                known, before = least_mm[pairs], at[pairs]
                nearer = (there < known) | ((there == known) & (place < before))
                least_mm[pairs] = np.where(nearer, there, known)
                at[pairs] = np.where(nearer, place, before)
        return least_mm, at

    def nearest_mm(self, qs_rad: ArrayLike) -> Floats:
        """Return the distances (n, p) that decide at joint angles (n, 6), infinite for the others.

        At each place the nearest pair of every obstacle, and of every distance that is demanded,
        is among those that are known.
        """
        qs = as_joints(qs_rad)
        found = np.full((len(qs), len(self.pairs)), np.inf, dtype=np.float64)
        for start in range(0, len(qs), BLOCK):
            block = qs[start : start + BLOCK]
            decisive = self._decisive(*self._bounds_mm(block))
            self._bodies.choose(decisive)
            self._bodies.distances_mm(qs[max(0, start - 1)])  # where the next search starts
            for i, q in enumerate(block, start):
                found[i, decisive] = self._bodies.distances_mm(q)
        return np.round(found, ROUNDED, out=found)

    def _decisive(self, least_mm: Floats, most_mm: Floats) -> Bools:
        """Return which pairs (p,) may be the nearest of their kind anywhere, by bounds (n, p)."""
        nearest = np.zeros_like(most_mm)
        for of_kind in self._kinds:
            nearest[:, of_kind] = most_mm[:, of_kind].min(axis=1, keepdims=True)
        decisive: Bools = (nearest - least_mm).max(axis=0) >= 0.0
        return decisive

    def _too_close(self, qs: Floats) -> Iterator[int]:
        """Yield at which of joint angles (n, 6) anything comes too close, in their order."""
        for start in range(0, len(qs), TOGETHER):
            some = qs[start : start + TOGETHER]
            frames = self._arm.link_frames(some) if len(some) >= FEW else None
            for first in range(0, len(some), STRETCH):
                block = slice(first, first + STRETCH)
                near = self._near(some[block], frames and (frames[0][block], frames[1][block]))
                for place in near.tolist():
                    if self._bodies.meets(some[first + place]):
                        yield start + first + place

    def _near(self, qs: Floats, frames: tuple[Floats, Floats] | None) -> Ints:
        """Choose the pairs that may come too close, and return at which places (k,) one may.

        Args:
            qs: Joint angles (n, 6) near each other.
            frames: Of the links there; None: not known.
        """
        near: Bools = np.ones((len(qs), len(self.pairs)), dtype=np.bool_)
        if frames is not None and len(qs) >= FEW:
            near = self._bounds_mm(qs)[0] <= self.least_mm
            pairs = np.flatnonzero(near.any(axis=0))
            kept_mm = self._planes.between_balls_mm(*frames, pairs) - SLACK_MM
            near[:, pairs] &= (kept_mm <= self.least_mm[pairs, None]).T
            pairs = np.flatnonzero(near.any(axis=0))
            normals = self._bodies.normals_base(pairs)
            kept_mm = self._planes.bounds_mm(*frames, pairs, normals) - SLACK_MM
            near[:, pairs] &= ~(kept_mm > self.least_mm[pairs])
        of_pair: Bools = np.any(near, axis=0)
        if of_pair.any():
            self._bodies.choose(of_pair)
        return np.flatnonzero(near.any(axis=1))

    def _bounds_mm(self, qs: Floats) -> tuple[Floats, Floats]:
        """Return bounds (n, p) of the distance of every pair, from that at the middle one of n."""
        middle = qs[len(qs) // 2]
        apart_mm = self.distances_mm(middle[None])
        moved_mm = np.abs(qs - middle) @ self.pair_levers_mm + SLACK_MM
        return apart_mm - moved_mm, apart_mm + moved_mm

    def report(self, qs_rad: ArrayLike) -> CollisionReport:
        """Return who comes how close to what at joint angles (n, 6), n at least 1."""
        distances = self.nearest_mm(qs_rad)
        rooms = distances - self.least_mm
        room = rooms.min(axis=1)
        hits = np.flatnonzero(room < 0.0)
        return CollisionReport(
            pairs=self.pairs,
            clearance_mm=readonly(distances[:, self._counted].min(axis=1)),
            room_mm=readonly(room),
            closest=readonly(rooms.argmin(axis=1).astype(np.int64)),
            first_hit=int(hits[0]) if len(hits) else -1,
        )


@lru_cache(maxsize=4)
def _own_pairs(model: RobotModel) -> tuple[tuple[str, str], ...]:
    """Return which parts of the robot can meet: two joints apart at least, and not held apart."""
    parts = [body for body in collision_bodies(model) if body.name not in (DELAY_LINE, PROBE_BODY)]
    candidates = [
        (a, b)
        for i, a in enumerate(parts)
        for b in parts[i + 1 :]
        if b.link - a.link >= 2 and (a.name, b.name) not in model.held_apart
    ]
    near = _ever_near(model, candidates)
    return tuple(
        (a.name, b.name)
        for (a, b), meets in zip(candidates, near, strict=True)
        if meets or b.link - a.link > 2
    )


def _pairs_with(thing: Obstacle, bodies: tuple[ConvexBody, ...]) -> list[Pair]:
    """Return the parts that an obstacle has to be looked at with."""
    apart = (PROBE,) if thing.touch_mm else (PROBE_BODY, DELAY_LINE)
    parts = [body for body in bodies if body.link >= MOVING and body.name not in apart]
    return [
        Pair(
            part.name,
            thing.name,
            thing.name,
            -thing.touch_mm if thing.touch_mm and part.name in TOUCHING else thing.margin_mm,
        )
        for part in parts
    ]


def _ever_near(model: RobotModel, candidates: list[tuple[ConvexBody, ConvexBody]]) -> list[bool]:
    """Return which parts can come near each other; for parts with one joint between them.

    Their distance depends on few joints, so that some hundred positions tell how it varies.
    """
    rng = np.random.default_rng(0)
    qs = rng.uniform(model.lower_rad, model.upper_rad, (POSITIONS, len(model.lower_rad)))
    rotations, places = model.arm.link_frames(qs)
    balls: dict[str, tuple[Floats, float]] = {}  # about each part: centres (k, 3) and radius
    for body in {body.name: body for pair in candidates for body in pair}.values():
        center = 0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))
        radius_mm = float(np.linalg.norm(body.vertices - center, axis=1).max())
        balls[body.name] = rotations[:, body.link] @ center + places[:, body.link], radius_mm
    found: list[bool] = []
    for first, second in candidates:
        (a, a_mm), (b, b_mm) = balls[first.name], balls[second.name]
        gap_mm = np.linalg.norm(a - b, axis=1).min() - (a_mm + b_mm)
        found.append(bool(gap_mm < FAR_MM))
    return found


def require_clear(
    model: RobotModel, obstacles: Obstacles, q_rad: Floats, where: str = "is to go"
) -> None:
    """Raise NotReachableError where the robot touches something, or comes close, at (6,) angles."""
    report = CollisionWorld(model, obstacles).report(q_rad[None])
    if report.first_hit >= 0:
        pair = report.closest_pair(0)
        raise NotReachableError(
            f"where the robot {where}, {pair.first} and {pair.second} are "
            f"{pair.apart_mm:.0f} mm apart, {pair.least_mm:.0f} mm must be kept"
        )
