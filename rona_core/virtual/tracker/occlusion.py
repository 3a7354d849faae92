"""Occlusion of markers by head, robot and hand, for both cameras.

A marker counts only if both cameras see it, as a position takes two of them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.surface.raycast import MeshRaycaster
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.line_of_sight_capsules import Capsules, link_capsules

CAMERAS_TRACKER = readonly(np.array(((-240.0, 0.0, 0.0), (240.0, 0.0, 0.0))))
MARKER_MM = 8.0  # a line of sight ends this far before the middle of the marker
HAND_FROM_TIP_MM = (50.0, 110.0)  # where the hand holds a pointer, along its shaft
HAND_RADIUS_MM = 30.0
HEAD_EDGE_MM = 3.0  # of the triangles of the head


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Lines of sight from both cameras to the m markers of a tool, the second camera's last."""

    T_tracker_marker: Pose
    starts_base: Floats  # (2 m, 3)
    ends_base: Floats  # (2 m, 3)
    hidden: Bools  # (2 m,) by what does not move with the robot


class LinesOfSight:
    """Tells which markers of a tool both cameras see."""

    def __init__(
        self, scene: VirtualScene, model: RobotModel, q_at: Callable[[float], Floats]
    ) -> None:
        """Look at a scene; ``q_at(time_s)`` returns the joint angles (6,) of the robot."""
        self._scene, self._model, self._q_at = scene, model, q_at
        self._links = link_capsules(model)
        self._head: MeshRaycaster | None = None
        self._robot: tuple[Floats, Capsules] | None = None  # spares work while the robot rests
        self._last: dict[str, tuple[Pose, Floats, Bools]] = {}  # and while a tool does
        self._rays: dict[str, Rays] = {}  # and while a tool does before a robot that moves

    def clear(self, tool: str, T_tracker_marker: Pose, time_s: float) -> Bools:
        """Return which markers (m,) of a tool at its true pose both cameras see."""
        q_rad, last = self._q_at(time_s), self._last.get(tool)
        if last is not None and np.array_equal(last[1], q_rad) and _same(last[0], T_tracker_marker):
            return last[2]
        clear = ~self._hidden(tool, T_tracker_marker, self._robot_at(q_rad))
        self._last[tool] = T_tracker_marker, q_rad, clear
        return clear

    def _hidden(self, tool: str, T_tracker_marker: Pose, robot: Capsules) -> Bools:
        rays = self._rays.get(tool)
        if rays is None or not _same(rays.T_tracker_marker, T_tracker_marker):
            rays = self._rays[tool] = self._at_rest(tool, T_tracker_marker)
        hidden = rays.hidden | capsules_hit(rays.starts_base, rays.ends_base, robot)
        count = len(hidden) // 2
        return np.asarray(hidden[:count] | hidden[count:])

    def _at_rest(self, tool: str, T_tracker_marker: Pose) -> "Rays":
        """Return the lines of sight to a tool, and which end at the head or the hand."""
        geometry, scene = GEOMETRIES[tool], self._scene
        points_tracker = T_tracker_marker @ geometry.positions_marker
        count = len(points_tracker)
        ends = np.concatenate((points_tracker, points_tracker))
        starts = np.repeat(CAMERAS_TRACKER, count, axis=0)
        ways = ends - starts
        lengths = np.linalg.norm(ways, axis=1)
        directions = ways / lengths[:, None]
        reach = lengths - MARKER_MM
        ends = starts + reach[:, None] * directions
        T_base_tracker = scene.T_base_tracker
        starts_base, ends_base = T_base_tracker @ starts, T_base_tracker @ ends
        hidden = np.zeros(2 * count, dtype=np.bool_)
        if tool not in ("toolmarker", "basemarker"):  # these are in nobody's hand
            hidden |= capsules_hit(starts, ends, hand_capsule(tool, T_tracker_marker))
        T_skull_tracker = scene.T_base_skull.inv() @ T_base_tracker
        first = self._head_caster().first_hit(
            T_skull_tracker @ starts, T_skull_tracker.rotate(directions)
        )
        return Rays(T_tracker_marker, starts_base, ends_base, hidden | (first < reach))

    def _head_caster(self) -> MeshRaycaster:
        if self._head is None:
            self._head = MeshRaycaster(self._scene.specimen.mesh(HEAD_EDGE_MM))
        return self._head

    def _robot_at(self, q_rad: Floats) -> Capsules:
        known = self._robot
        if known is None or not np.array_equal(known[0], q_rad):
            known = q_rad, self._links.at(self._model, q_rad)
            self._robot = known
        return known[1]


def _same(a: Pose, b: Pose) -> bool:
    return np.array_equal(a.translation, b.translation) and np.array_equal(a.rotation, b.rotation)


def hand_capsule(tool: str, T_tracker_marker: Pose) -> Capsules:
    """Return the hand about the shaft of a pointer as one capsule in ``tracker``."""
    geometry = GEOMETRIES[tool]
    tip = geometry.nominal_tip_marker
    up = np.array((0.0, 0.0, -1.0) if geometry.dof == 5 else (0.0, 1.0, 0.0))
    low, high = (T_tracker_marker @ (tip + length * up) for length in HAND_FROM_TIP_MM)
    return Capsules(low[None], high[None], np.array([HAND_RADIUS_MM]))


def capsules_hit(starts: Floats, ends: Floats, capsules: Capsules) -> Bools:
    """Return which segments (n, 3) to (n, 3) touch any of some capsules, (n,)."""
    near = _near(starts, ends, capsules)
    if not near.any():
        return np.zeros(len(starts), dtype=np.bool_)
    squared = segment_distances2(starts, ends, capsules.starts[near], capsules.ends[near])
    return np.asarray((squared < capsules.radii_mm[near] ** 2).any(axis=1))


def _near(starts: Floats, ends: Floats, capsules: Capsules) -> Bools:
    """Return which capsules (k,) have a ball around them that some segment touches."""
    halves = 0.5 * (capsules.ends - capsules.starts)
    middles = capsules.starts + halves
    reach = np.sqrt((halves * halves).sum(axis=1)) + capsules.radii_mm
    ways = ends - starts
    to = middles[None] - starts[:, None]
    share = np.einsum("nkj,nj->nk", to, ways) / (ways * ways).sum(axis=1)[:, None]
    off = to - np.minimum(np.maximum(share, 0.0), 1.0)[:, :, None] * ways[:, None]
    return ((off * off).sum(axis=2) <= reach**2).any(axis=0)


def segment_distances2(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the squared distances (n, k) between segments a-b (n, 3) and c-d (k, 3).

    The nearest places s on a-b and t on c-d minimise a quadratic over the unit square: the free
    minimum, where it lies inside, or the best of the four edges.
    """
    u, v = b - a, d - c
    w = a[:, None] - c[None]
    uu, vv = (u * u).sum(axis=1)[:, None], (v * v).sum(axis=1)[None]
    uv = u @ v.T
    uw = (u[:, None] * w).sum(axis=2)
    vw = (v[None] * w).sum(axis=2)
    ww = (w * w).sum(axis=2)
    tiny = 1e-12

    def value(s: Floats, t: Floats) -> Floats:
        return uu * s * s - 2.0 * uv * s * t + vv * t * t + 2.0 * uw * s - 2.0 * vw * t + ww

    def best_s(t: Floats) -> Floats:
        return np.clip((uv * t - uw) / np.maximum(uu, tiny), 0.0, 1.0)

    def best_t(s: Floats) -> Floats:
        return np.clip((uv * s + vw) / np.maximum(vv, tiny), 0.0, 1.0)

    zero, one = np.zeros_like(uw), np.ones_like(uw)
    candidates = [
        value(zero, best_t(zero)),
        value(one, best_t(one)),
        value(best_s(zero), zero),
        value(best_s(one), one),
    ]
    determinant = uu * vv - uv * uv
    safe = np.where(determinant > tiny, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = (determinant > tiny) & (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    candidates.append(np.where(inside, value(s, t), np.inf))
    return np.maximum(np.min(candidates, axis=0), 0.0)
