"""Distance field of an imported skull as a smooth field: rays to and feet on its zero level."""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.session.specimen import LoadedSkull
from rona_core.virtual.specimen.bsplines import SplineVolume
from rona_core.virtual.specimen.sphere_tracing import first_entries

STEEPNESS = 1.1  # how fast a smoothed distance may change for each millimetre
RIM_NODES = 2.0  # of the grid that are not trusted
FOOT_STEPS, FOOT_MM = 40, 1e-6
LEAST_BEND = 0.2  # smallest curvature of the squared distance that Newton's method believes
LONGEST_STEP_MM = 2.0
LEVEL_STEPS, LEVEL_MM = 12, 1e-6  # back to the zero level; the last step gains two digits more


class BoneField:
    """The signed distance (negative in bone) by tricubic splines; all points in ``skull``."""

    def __init__(self, skull: LoadedSkull) -> None:
        self._skull = skull
        self._field = SplineVolume(skull.distance_um.astype(np.float64) / 1000.0)
        self.high = np.array(skull.distance_um.shape) - 1.0 - RIM_NODES  # last trusted nodes

    def places(self, points: Floats) -> Floats:
        """Return points (n, 3) in nodes of the grid."""
        return (points - self._skull.origin_skull) @ self._skull.axes_skull / self._skull.spacing_mm

    def distance(self, points: Floats) -> Floats:
        """Return the signed distance (n,) to the bone."""
        return self._field.value(self.places(points))

    def unit_gradient(self, points: Floats) -> Floats:
        """Return the direction (n, 3) in which the distance grows."""
        g = self._field.gradient(self.places(points)) @ self._skull.axes_skull.T
        return g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)

    def span(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return where rays enter and leave the trusted part of the grid."""
        o = self.places(origins)
        d = directions @ self._skull.axes_skull / self._skull.spacing_mm
        d = np.where(np.abs(d) < 1e-12, 1e-12, d)
        a, b = (RIM_NODES - o) / d, (self.high - o) / d
        enter = np.maximum(np.minimum(a, b).max(axis=1), 0.0)
        return enter, np.maximum(a, b).min(axis=1)

    def entries(self, o: Floats, d: Floats, sign: float, starts: Floats, ends: Floats) -> Floats:
        """Return where rays first enter bone (``sign`` +1) or leave it (-1), inf where never."""

        def gap(t: Floats, rays: Ints) -> Floats:
            return sign * self.distance(o[rays] + t[:, None] * d[rays])

        return first_entries(gap, starts, ends, STEEPNESS)

    def foot(self, q: Floats, start: Floats) -> Floats:
        """Return the points (n, 3) of the zero level nearest to ``q``, searched from ``start``.

        Newton steps in the tangent plane and back to the zero level; a step that does not come
        nearer is refused and the next one damped.
        """
        x = self._onto_level(start)
        best = np.linalg.norm(q - x, axis=1)
        damping = np.zeros(len(q))
        busy = np.arange(len(q))
        for _ in range(FOOT_STEPS):
            step = self._newton_step(q[busy], x[busy], damping[busy])
            trial = self._onto_level(x[busy] + step)
            distance = np.linalg.norm(q[busy] - trial, axis=1)
            better = distance <= best[busy]
            rows = busy[better]
            x[rows], best[rows] = trial[better], distance[better]
            damping[busy] = np.where(better, 0.0, np.maximum(damping[busy], 0.3) * 5.0)
            busy = busy[np.linalg.norm(step, axis=1) > FOOT_MM]
            if not len(busy):
                break
        return x

    def _newton_step(self, q: Floats, x: Floats, damping: Floats) -> Floats:
        """Return the step (n, 3) in the tangent plane at ``x`` towards the foot of ``q``.

        Half the squared distance, seen along the surface, has the Hessian 1 + height * curvature;
        its smallest eigenvalue is kept above ``LEAST_BEND``, and ``damping`` shortens the step.
        """
        axes, spacing = self._skull.axes_skull, self._skull.spacing_mm
        places = self.places(x)
        g = self._field.gradient(places) @ axes.T / spacing
        size = np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)
        n = g / size
        off = q - x
        height = np.einsum("ij,ij->i", off, n)
        tangent = np.eye(3) - n[:, :, None] * n[:, None, :]
        bend = axes @ self._field.hessian(places) @ axes.T / spacing**2
        curvature = tangent @ (bend / size[:, :, None]) @ tangent
        values, ways = np.linalg.eigh(np.eye(3) + height[:, None, None] * curvature)
        values = np.maximum(values, LEAST_BEND) + damping[:, None]
        slide = off - height[:, None] * n
        step = np.einsum("nij,nj->ni", ways, np.einsum("nji,nj->ni", ways, slide) / values)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        return step * np.minimum(1.0, LONGEST_STEP_MM / np.maximum(length, 1e-12))

    def _onto_level(self, x: Floats) -> Floats:
        """Return points moved along the gradient to the zero level."""
        for _ in range(LEVEL_STEPS):
            level = self.distance(x)
            x = x - level[:, None] * self.unit_gradient(x)
            if np.abs(level).max(initial=0.0) < LEVEL_MM:
                break
        return x
