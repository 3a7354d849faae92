"""What stands around the robot, as it is drawn, and which parts come too close to what."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import trimesh

from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.robot.collision.collision_geometry import collision_bodies
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import Box, Capsule, Hull, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.meshes.link_meshes import link_shapes
from rona_core.session.document import Session
from rona_core.session.memo import Memo, remember

LARGEST_MM = 5000.0  # what is larger (the floor) is not drawn
AROUND = (14, 24)  # corners of a drawn capsule, in latitude and longitude
DRAWN_AS = {"probe": ("probe body", "probe ring", "delay line")}  # bounds of several solids

_WORLDS: Memo[CollisionWorld] = Memo(4)


@dataclass(frozen=True, slots=True)
class PairClearance:
    """Two parts, how far they are apart and how far they must be."""

    first: str
    second: str
    distance_mm: float
    needed_mm: float  # below 0: one may be pressed into the other so far

    @property
    def too_close(self) -> bool:
        """Whether they come closer than they must."""
        return self.distance_mm < self.needed_mm

    @property
    def sentence(self) -> str:
        """Say so in words."""
        if self.needed_mm < 0.0 and self.distance_mm < 0.0:
            return (
                f"{self.first} is {-self.distance_mm:.1f} mm inside the outline of the "
                f"{self.second}, at most {-self.needed_mm:.1f} mm are allowed"
            )
        gap = f"are {self.distance_mm:.1f} mm apart"
        if self.distance_mm < 0.0:
            gap = f"overlap by {-self.distance_mm:.1f} mm"
        kept = f"{max(self.needed_mm, 0.0):.0f} mm must be kept"
        return f"{self.first} and {self.second} {gap}, {kept}"


def collision_world(session: Session) -> CollisionWorld:
    """Return robot and surroundings of a session as bodies; equal inputs give the same object."""
    name, around = session.setup.devices.robot.model, session_obstacles(session)
    return _WORLDS.get((around,), lambda: CollisionWorld(robot_model(name), around), name)


def stands_clear(session: Session, q_rad: Floats) -> bool:
    """Return whether nothing is touched, not even by the delay line, at joint angles (6,)."""
    name, around = session.setup.devices.robot.model, session_obstacles(session)
    return _stands_clear(name, around, q_rad.tobytes())


@remember(8)  # a picture asks whenever it is drawn
def _stands_clear(name: str, around: Obstacles, q_rad: bytes) -> bool:
    world = CollisionWorld(robot_model(name), around.without_touch())
    return bool(world.clear(np.frombuffer(q_rad)[None])[0])


def clearance_violations(session: Session, q_rad: Floats) -> tuple[PairClearance, ...]:
    """Return all pairs that come too close at joint angles (6,), worst first; else the nearest.

    Among pairs that keep their distance those that may touch do not count.
    """
    world = collision_world(session)
    distances = world.distances_mm(q_rad[None])[0]
    room = distances - world.least_mm
    order = np.argsort(room, kind="stable")
    worst = order[room[order] < 0.0]
    if not len(worst):
        worst = order[world.least_mm[order] >= 0.0][:1]
    return tuple(
        PairClearance(pair.first, pair.second, float(distances[i]), pair.least_mm)
        for i in worst.tolist()
        for pair in (world.pairs[i],)
    )


@lru_cache(maxsize=64)
def drawn_parts(model_name: str, part: str) -> frozenset[tuple[int, str]]:
    """Return link and name of the drawn solids that a part of the collision model stands for."""
    model = robot_model(model_name)
    links = {bound.link for bound in collision_bodies(model) if bound.name == part}
    shapes = [shape for shape in _shapes(model_name) if shape.frame in links]
    names = DRAWN_AS.get(part, (part,))
    alike = [shape for shape in shapes if any(_alike(shape.name, name) for name in names)] or shapes
    return frozenset((shape.frame, shape.name) for shape in alike)


def drawn_link(model_name: str, link: int) -> frozenset[tuple[int, str]]:
    """Return link and name of the drawn solids that a joint (1 to 6) carries next."""
    return frozenset((s.frame, s.name) for s in _shapes(model_name) if s.frame == link)


def _shapes(model_name: str) -> Any:
    try:
        return link_shapes(robot_model(model_name))
    except InvalidInputError:
        return ()  # a robot that is not drawn


def _alike(shape: str, part: str) -> bool:
    return shape == part or shape.startswith(f"{part} ") or part.startswith(f"{shape} ")


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleMesh:
    """An obstacle as a mesh in ``base``."""

    name: str
    mesh: Mesh


def drawn_obstacles(session: Session) -> tuple[ObstacleMesh, ...]:
    """Return what the robot keeps away from, without the floor, which is drawn anyway."""
    return tuple(
        ObstacleMesh(thing.name, _mesh(thing))
        for thing in session_obstacles(session).things
        if not (isinstance(thing.shape, Box) and max(thing.shape.size_mm) > LARGEST_MM)
    )


def _mesh(thing: Obstacle) -> Mesh:
    hull: Any = trimesh.convex.convex_hull(_corners(thing.shape))
    return Mesh(thing.pose @ np.asarray(hull.vertices), np.asarray(hull.faces))


def _corners(shape: Hull | Box | Capsule) -> Floats:
    if isinstance(shape, Hull):
        return shape.vertices
    if isinstance(shape, Box):
        return trimesh.creation.box(extents=shape.size_mm).vertices
    ball = np.asarray(trimesh.creation.uv_sphere(radius=shape.radius_mm, count=AROUND).vertices)
    up = np.array((0.0, 0.0, 0.5 * shape.length_mm))
    return np.concatenate((ball + up, ball - up))
