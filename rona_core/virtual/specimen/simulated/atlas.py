"""Atlas of the simulated head: a fine chart where it is scanned, six around it.

The six, one for each face of a cube, are baked only when something looks there.
"""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, Ints
from rona_core.virtual.specimen.simulated.chart import Chart
from rona_core.virtual.specimen.simulated.landmarks import tangents
from rona_core.virtual.specimen.simulated.layer_radii import SkullShape

SCAN_STEP_MM, FACE_STEP_MM = 0.5, 0.6
FACE_HALF = 1.1  # slightly beyond the edge of a cube's face
CANDIDATES_PER_CHART = 160  # slopes along each side from which the search for a point starts
NEWTON_STEPS = 30
TOLERANCE_MM = 1e-9
LEAST_BEND = 1e-3  # smallest curvature of the squared distance, over the size of the metric


class Atlas:
    """Evaluates the boundaries anywhere; points ``v`` (n, 3) are counted from the centre."""

    def __init__(self, shape: SkullShape, axis: Floats, half: float) -> None:
        self._shape = shape
        self._charts: dict[int, Chart] = {
            0: Chart.bake(shape.radii, tangents(axis), half, SCAN_STEP_MM)
        }
        self._trees: dict[tuple[int, int], tuple[KDTree, Floats]] = {}

    def _chart(self, number: int) -> Chart:
        """Return chart 0, the scanned one, or the chart of face 1 to 6, baked on demand."""
        if number not in self._charts:
            axis = np.zeros(3)
            axis[(number - 1) % 3] = 1.0 if number <= 3 else -1.0
            self._charts[number] = Chart.bake(
                self._shape.radii, tangents(axis), FACE_HALF, FACE_STEP_MM
            )
        return self._charts[number]

    def _numbers(self, v: Floats) -> Ints:
        """Return which chart (n,) holds each point."""
        _, held = self._charts[0].locate(v)
        largest = np.argmax(np.abs(v), axis=1)
        negative = v[np.arange(len(v)), largest] < 0.0
        return np.where(held, 0, largest + 1 + 3 * negative)

    def gap(self, v: Floats, k: Ints) -> Floats:
        """Return how far (n,) in mm points lie outside boundary ``k`` (n,), measured radially."""
        place, held = self._charts[0].locate(v)
        if held.all():
            return self._charts[0].gap(v, place, k)
        numbers = self._numbers(v)
        gaps = np.zeros(len(v))
        for number in np.unique(numbers):
            rows = numbers == number
            chart = self._chart(int(number))
            gaps[rows] = chart.gap(v[rows], chart.locate(v[rows])[0], k[rows])
        return gaps

    def normals(self, v: Floats, k: int) -> Floats:
        """Return the outward unit normals (n, 3) of a boundary radially below or above points."""
        normals = np.zeros_like(v)
        numbers = self._numbers(v)
        for number in np.unique(numbers):
            rows = numbers == number
            chart = self._chart(int(number))
            slopes = chart.locate(v[rows])[0][1:].T
            _, first, _ = chart.surface(slopes, k)
            n = np.cross(first[:, 0], first[:, 1])
            n *= np.sign(np.einsum("ij,ij->i", n, v[rows]))[:, None]
            normals[rows] = n / np.linalg.norm(n, axis=1, keepdims=True)
        return normals

    def closest(self, v: Floats, k: int) -> Floats:
        """Return the nearest point (n, 3) of a boundary to each point near it."""
        found = np.zeros_like(v)
        numbers = self._numbers(v)
        for number in np.unique(numbers):
            rows = numbers == number
            found[rows] = self._closest_in(int(number), v[rows], k)
        return found

    def _closest_in(self, number: int, v: Floats, k: int) -> Floats:
        chart = self._chart(number)
        if (number, k) not in self._trees:
            side = np.linspace(-chart.half, chart.half, CANDIDATES_PER_CHART)
            slopes = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
            self._trees[number, k] = KDTree(chart.surface(slopes, k)[0]), slopes
        tree, candidates = self._trees[number, k]
        return _descend(chart, k, v, candidates[tree.query(v)[1]])


def _descend(chart: Chart, k: int, v: Floats, slopes: Floats) -> Floats:
    """Return the surface points (n, 3) where the distance to ``v`` is least, near start slopes.

    Newton's method on half the squared distance with a damped Hessian (Levenberg): a step that
    does not come nearer is refused and damped more, so the result is never worse than the start.
    """
    slopes = slopes.copy()
    damping = np.zeros(len(v))
    points, first, second = chart.surface(slopes, k)
    off = points - v
    squares = np.einsum("ij,ij->i", off, off)
    busy = np.arange(len(v))
    for _ in range(NEWTON_STEPS):
        gradient = np.einsum("nai,ni->na", first[busy], off[busy])
        metric = np.einsum("nai,nbi->nab", first[busy], first[busy])
        hessian = metric + np.einsum("nabi,ni->nab", second[busy], off[busy])
        size = metric[:, 0, 0] + metric[:, 1, 1]
        lack = LEAST_BEND - np.linalg.eigvalsh(hessian)[:, 0] / size
        lift = size * np.maximum(damping[busy], lack)
        hessian += np.maximum(lift, 0.0)[:, None, None] * np.eye(2)
        step = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
        trial = np.clip(slopes[busy] + step, -chart.half, chart.half)
        p, f, s = chart.surface(trial, k)
        o = p - v[busy]
        square = np.einsum("ij,ij->i", o, o)
        better = square <= squares[busy]
        damping[busy] = np.where(better, 0.0, np.maximum(damping[busy], LEAST_BEND) * 10.0)
        moved = np.linalg.norm(step, axis=1) * np.sqrt(size)
        rows = busy[better]
        slopes[rows], points[rows], squares[rows] = trial[better], p[better], square[better]
        first[rows], second[rows], off[rows] = f[better], s[better], o[better]
        busy = busy[moved > TOLERANCE_MM]
        if not len(busy):
            break
    return points
