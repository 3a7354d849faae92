"""Occlusion of markers by head, robot and hand, for both cameras.

A marker counts only if both cameras see it, as a position takes two of them.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Bools, Floats, dots, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.surface.raycast import MeshRaycaster
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.tracker.line_of_sight_capsules import Capsules, link_capsules

CAMERAS_TRACKER = readonly(np.array(((-240.0, 0.0, 0.0), (240.0, 0.0, 0.0))))
MARKER_MM = 8.0  # a line of sight ends this far before the middle of the marker
HAND_FROM_TIP_MM = (50.0, 110.0)  # where the hand holds a pointer, along its shaft
HAND_RADIUS_MM = 30.0
HEAD_EDGE_MM = 3.0  # of the triangles of the head

# tool, its true poses (n,) -> which of its markers (n, m) both cameras see
Sight = Callable[[str, Poses], Bools]


class LinesOfSight:
    """Visibility of the markers of a tool by both cameras."""

    def __init__(
        self, scene: VirtualScene, model: RobotModel, qs_at: Callable[[Floats], Floats]
    ) -> None:
        """Look at a scene; ``qs_at(times_s)`` returns the joint angles (n, 6) of the robot."""
        self._scene, self._model, self._qs_at = scene, model, qs_at
        self._links = link_capsules(model)
        self._head: MeshRaycaster | None = None

    def clear(self, tool: str, Ts_tracker_marker: Poses, times_s: Floats) -> Bools:
        """Return which markers (n, m) of a tool at its true poses (n,) both cameras see."""
        return self.at(times_s)(tool, Ts_tracker_marker)

    def at(self, times_s: Floats) -> Sight:
        """Return the same for any tool, for the robot's places at times (n,)."""
        qs_rad = self._qs_at(times_s)
        if _at_rest(qs_rad):
            qs_rad = qs_rad[:1]
        arm = cache(lambda: self._links.at(self._model, qs_rad))  # for all tools, once
        return lambda tool, Ts_tracker_marker: self._clear(tool, Ts_tracker_marker, arm())

    def _clear(self, tool: str, Ts_tracker_marker: Poses, arm: Capsules) -> Bools:
        Ts = Ts_tracker_marker
        moves = tool != "headmarker"  # by less than a millimetre, which hides nothing
        if not moves or (_at_rest(Ts.rotations) and _at_rest(Ts.translations)):  # one look will do
            Ts = Ts.select(slice(0, 1))
        starts, ends = self._rays(tool, Ts)
        hidden = self._hidden_by_head(starts, ends)
        if tool not in ("toolmarker", "basemarker", "headmarker"):  # these are not held by hand
            hidden |= segments_hit(starts, ends, hand_capsule(tool, Ts))
        T_base_tracker = self._scene.T_base_tracker
        hidden = hidden | segments_hit(
            _moved(T_base_tracker, starts), _moved(T_base_tracker, ends), arm
        )
        count = len(GEOMETRIES[tool].positions_marker)
        return np.broadcast_to(~hidden.any(axis=1), (len(Ts_tracker_marker), count))

    def _rays(self, tool: str, Ts_tracker_marker: Poses) -> tuple[Floats, Floats]:
        """Return start and end (n, 2, m, 3) in ``tracker`` of the lines from camera to marker."""
        markers = Ts_tracker_marker.map_points(GEOMETRIES[tool].positions_marker)[:, None]
        shape = (len(Ts_tracker_marker), 2, *markers.shape[2:])
        starts = np.broadcast_to(CAMERAS_TRACKER[:, None], shape)
        lines = markers - starts
        lengths = np.sqrt(dots(lines, lines))[..., None]
        return starts, starts + (1.0 - MARKER_MM / lengths) * lines

    def _hidden_by_head(self, starts: Floats, ends: Floats) -> Bools:
        """Return which lines of sight (n, 2, m) in ``tracker`` the head cuts."""
        lines = ends - starts
        reach_mm = np.sqrt(dots(lines, lines))
        T_skull_tracker = self._scene.T_base_skull.inv() @ self._scene.T_base_tracker
        directions = (lines / reach_mm[..., None]).reshape(-1, 3)
        first_mm = self._head_caster().first_hit(
            T_skull_tracker @ starts.reshape(-1, 3), T_skull_tracker.rotate(directions)
        )
        return np.asarray(first_mm.reshape(reach_mm.shape) < reach_mm)

    def _head_caster(self) -> MeshRaycaster:
        if self._head is None:
            self._head = MeshRaycaster(self._scene.specimen.mesh(HEAD_EDGE_MM))
        return self._head


def _at_rest(values: Floats) -> bool:
    """Return whether all rows are the first."""
    return bool((values == values[:1]).all())


def _moved(T_b_a: Pose, points_a: Floats) -> Floats:
    """Return points (..., 3) of frame ``a`` in ``b``."""
    return (T_b_a @ points_a.reshape(-1, 3)).reshape(points_a.shape)


def hand_capsule(tool: str, Ts_tracker_marker: Poses) -> Capsules:
    """Return the hand about the shaft of a pointer, one capsule (n, 1) a pose, in ``tracker``."""
    geometry = GEOMETRIES[tool]
    tip = geometry.nominal_tip_marker
    up = np.array((0.0, 0.0, -1.0) if geometry.dof == 5 else (0.0, 1.0, 0.0))
    low, high = (Ts_tracker_marker @ (tip + length * up) for length in HAND_FROM_TIP_MM)
    return Capsules(low[:, None], high[:, None], np.array([HAND_RADIUS_MM]))


def segments_hit(starts: Floats, ends: Floats, capsules: Capsules) -> Bools:
    """Return which segments (n, ..., 3) to (n, ..., 3) touch any of some capsules.

    ``capsules`` are k for each of the n frames, or for all of them if there is one row of them.
    """
    n, k = len(starts), len(capsules.radii_mm)
    a, b = starts.reshape(n, -1, 1, 3), ends.reshape(n, -1, 1, 3)
    frames = max(n, len(capsules.starts))
    c, d = capsules.starts[:, None], capsules.ends[:, None]
    shape = (frames, a.shape[1], k)
    near = np.broadcast_to(_near(a, b, c, d, capsules.radii_mm), shape)
    rows = np.nonzero(near)
    hit = np.zeros(shape, dtype=np.bool_)
    a, b, c, d = (np.broadcast_to(points, (*shape, 3))[rows] for points in (a, b, c, d))
    hit[rows] = segment_distances2(a, b, c, d) < capsules.radii_mm[rows[2]] ** 2
    return hit.any(axis=2).reshape(frames, *starts.shape[1:-1])


def _near(a: Floats, b: Floats, c: Floats, d: Floats, radii_mm: Floats) -> Bools:
    """Return which segments a-b (n, r, 1, 3) touch the balls around capsules c-d (n, 1, k, 3).

    The frames n come last here, and the coordinates first: loops over three numbers are slow.
    """
    a, b, c, d = (np.ascontiguousarray(points.transpose(3, 1, 2, 0)) for points in (a, b, c, d))
    halves, lines = 0.5 * (d - c), b - a
    to_middle = c + halves - a
    reach_mm = np.sqrt(_dots_of_columns(halves, halves)) + radii_mm[:, None]
    share = _dots_of_columns(to_middle, lines) / _dots_of_columns(lines, lines)
    off = to_middle - np.clip(share, 0.0, 1.0) * lines
    return np.asarray(_dots_of_columns(off, off) <= reach_mm**2).transpose(2, 0, 1)


def _dots_of_columns(a: Floats, b: Floats) -> Floats:
    """Return the inner products (...) of vectors (3, ...), by broadcasting."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def segment_distances2(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the squared distances (n,) between segments a-b (n, 3) and c-d (n, 3), row by row.

    The nearest places s on a-b and t on c-d minimise a quadratic over the unit square: the free
    minimum, where it lies inside, or the best of the four edges.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv, uw, vw, ww = (
        dots(p, q) for p, q in ((u, u), (v, v), (u, v), (u, w), (v, w), (w, w))
    )
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
