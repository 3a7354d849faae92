"""Atlas of the simulated head: a fine chart where it is scanned, six around it.

The six, one for each face of a cube, are baked only when something looks there. A point ``v`` from
the centre has in a chart the depth ``s = v.e0`` and the slopes ``a = v.e1 / s``, ``b = v.e2 / s``
(the gnomonic map). Boundary k is ``v = rho_k(a, b) * (e0 + a e1 + b e2)``, so it is a height field
whose derivatives are short to write, and straight lines stay straight.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.virtual.specimen.bsplines import cubic_weights
from rona_core.virtual.specimen.simulated.layer_radii import SkullShape
from rona_core.virtual.specimen.simulated.spherical_fields import HEAD_MM, tangents

RIM = 8  # nodes beyond the patch, so that the end conditions of the splines have died away
SCAN_STEP_MM, FACE_STEP_MM = 0.5, 0.6
FACE_HALF = 1.1  # slightly beyond the edge of a cube's face
CANDIDATES_PER_CHART = 160  # slopes along each side from which the search for a point starts
NEWTON_STEPS = 30
AT_ONCE = 2048  # points that are looked for together: derivatives of all take much memory
LAST_MM = 1e-5  # a step this short ends the search: what is left is its square over the head
LEAST_BEND = 1e-3  # smallest curvature of the squared distance, over the size of the metric


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Splines of the four boundaries over slopes within ``half`` of the axis of the patch."""

    axes: Floats  # (3, 3), rows e0, e1, e2
    half: float  # largest |a| and |b|
    step: float  # between nodes
    tiles: Floats  # (4 n, n) spline coefficients, one tile a boundary

    @classmethod
    def bake(cls, shape: SkullShape, axes: Floats, half: float, step_mm: float) -> "Chart":
        """Sample the radii of a head and fit the splines."""
        step = step_mm / HEAD_MM
        count = int(np.ceil(half / step)) + RIM
        slopes = np.arange(-count, count + 1, dtype=np.float64) * step
        lengths = np.sqrt(1.0 + slopes[:, None] ** 2 + slopes**2)
        n = len(slopes)
        rho = shape.chart_radii(axes, slopes).reshape(n, n, -1) / lengths[:, :, None]
        tiles = [spline_filter(rho[:, :, k], order=3) for k in range(rho.shape[2])]
        return cls(axes, half, step, np.concatenate(tiles))

    def locate(self, v: Floats) -> tuple[Floats, Bools]:
        """Return depth and slopes (3, n) of points ``v`` (n, 3), and whether the patch holds them.

        Only where it does are the slopes meaningful.
        """
        place = self.axes @ v.T
        held = place[0] > 1e-6
        place[1:] /= np.where(held, place[0], 1.0)
        held &= (np.abs(place[1]) <= self.half) & (np.abs(place[2]) <= self.half)
        return place, held

    def gap(self, v: Floats, place: Floats, k: Ints) -> Floats:
        """Return how far (n,) in mm the points ``v`` lie outside boundary ``k`` (n,), radially."""
        n = self.tiles.shape[1]
        rows = place[1] / self.step + (n - 1) / 2 + k * n
        columns = place[2] / self.step + (n - 1) / 2
        rho = map_coordinates(self.tiles, (rows, columns), order=3, prefilter=False)
        depth = np.maximum(place[0], 1e-9)  # the centre itself is inside everything
        return np.sqrt(np.einsum("ij,ij->i", v, v)) * (1.0 - rho / depth)

    def surface(self, slopes: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points of the outer boundary and their derivatives by the slopes.

        Args:
            slopes: (n, 2); clipped to the patch.

        Returns:
            Points (n, 3) from the centre, first (n, 2, 3) and second (n, 2, 2, 3) derivatives.
        """
        n = self.tiles.shape[1]
        tile = self.tiles[:n]  # the first is that of the outer boundary
        x = np.clip(slopes, -self.half, self.half) / self.step + (n - 1) / 2
        cell = np.floor(x).astype(np.int64)
        weights = cubic_weights(x - cell)  # (3 orders, n, 2, 4 nodes)
        reach = np.arange(-1, 3)
        nodes = tile[(cell[:, 0, None] + reach)[:, :, None], (cell[:, 1, None] + reach)[:, None, :]]
        wa, wb = weights[:, :, 0], weights[:, :, 1]

        along_b = [(nodes @ w[:, :, None])[:, :, 0] for w in wb]

        def derived(i: int, j: int) -> Floats:
            rho = np.einsum("ni,ni->n", wa[i], along_b[j])
            return rho[:, None] / self.step ** (i + j)

        e0, e1, e2 = self.axes
        at = np.clip(slopes, -self.half, self.half)
        w = e0 + at[:, :1] * e1 + at[:, 1:] * e2
        rho, ra, rb = derived(0, 0), derived(1, 0), derived(0, 1)
        mixed = derived(1, 1) * w + ra * e2 + rb * e1
        first = np.stack((ra * w + rho * e1, rb * w + rho * e2), axis=1)
        aa, bb = derived(2, 0) * w + 2.0 * ra * e1, derived(0, 2) * w + 2.0 * rb * e2
        second = np.stack((np.stack((aa, mixed), 1), np.stack((mixed, bb), 1)), axis=1)
        return rho * w, first, second


class Atlas:
    """Evaluates the boundaries anywhere; points ``v`` (n, 3) are counted from the centre."""

    def __init__(self, shape: SkullShape, axis: Floats, half: float) -> None:
        self._shape = shape
        self._charts: dict[int, Chart] = {0: Chart.bake(shape, tangents(axis), half, SCAN_STEP_MM)}
        self._trees: dict[int, tuple[KDTree, Floats]] = {}

    def _chart(self, number: int) -> Chart:
        """Return chart 0, the scanned one, or the chart of face 1 to 6, baked on demand."""
        if number not in self._charts:
            axis = np.zeros(3)
            axis[(number - 1) % 3] = 1.0 if number <= 3 else -1.0
            self._charts[number] = Chart.bake(self._shape, tangents(axis), FACE_HALF, FACE_STEP_MM)
        return self._charts[number]

    def _parts(self, v: Floats) -> Iterator[tuple[Bools, int]]:
        """Yield which points (n,) a chart holds, and the number of that chart."""
        _, held = self._charts[0].locate(v)
        largest = np.argmax(np.abs(v), axis=1)
        negative = v[np.arange(len(v)), largest] < 0.0
        numbers = np.where(held, 0, largest + 1 + 3 * negative)
        for number in np.unique(numbers).tolist():
            yield numbers == number, number

    def gap(self, v: Floats, k: Ints) -> Floats:
        """Return how far (n,) in mm points lie outside boundary ``k`` (n,), measured radially."""
        place, held = self._charts[0].locate(v)
        if held.all():
            return self._charts[0].gap(v, place, k)
        gaps = np.zeros(len(v))
        for rows, number in self._parts(v):
            chart = self._chart(number)
            gaps[rows] = chart.gap(v[rows], chart.locate(v[rows])[0], k[rows])
        return gaps

    def normals(self, v: Floats) -> Floats:
        """Return the outward unit normals (n, 3) of the outer boundary below or above points."""
        normals = np.zeros_like(v)
        for rows, number in self._parts(v):
            chart = self._chart(number)
            slopes = chart.locate(v[rows])[0][1:].T
            _, first, _ = chart.surface(slopes)
            n = np.cross(first[:, 0], first[:, 1])
            n *= np.sign(np.einsum("ij,ij->i", n, v[rows]))[:, None]
            normals[rows] = n / np.linalg.norm(n, axis=1, keepdims=True)
        return normals

    def closest(self, v: Floats) -> Floats:
        """Return the nearest point (n, 3) of the outer boundary to each point near it."""
        found = np.zeros_like(v)
        for rows, number in self._parts(v):
            for some in np.array_split(np.flatnonzero(rows), 1 + np.count_nonzero(rows) // AT_ONCE):
                found[some] = self._closest_in(number, v[some])
        return found

    def _closest_in(self, number: int, v: Floats) -> Floats:
        chart = self._chart(number)
        if number not in self._trees:
            side = np.linspace(-chart.half, chart.half, CANDIDATES_PER_CHART)
            slopes = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
            self._trees[number] = KDTree(chart.surface(slopes)[0]), slopes
        tree, candidates = self._trees[number]
        return _descend(chart, v, candidates[tree.query(v)[1]])


def _descend(chart: Chart, v: Floats, slopes: Floats) -> Floats:
    """Return the surface points (n, 3) where the distance to ``v`` is least, near start slopes.

    Newton's method on half the squared distance with a damped Hessian (Levenberg): a step that
    does not come nearer is refused and damped more, so the result is never worse than the start.
    """
    slopes = slopes.copy()
    damping = np.zeros(len(v))
    points, first, second = chart.surface(slopes)
    off = points - v
    squares = np.einsum("ij,ij->i", off, off)
    busy = np.arange(len(v))
    for _ in range(NEWTON_STEPS):
        gradient = np.einsum("nai,ni->na", first[busy], off[busy])
        metric = np.einsum("nai,nbi->nab", first[busy], first[busy])
        hessian = metric + np.einsum("nabi,ni->nab", second[busy], off[busy])
        size = metric[:, 0, 0] + metric[:, 1, 1]
        aa, ab, bb = hessian[:, 0, 0], hessian[:, 0, 1], hessian[:, 1, 1]
        least = 0.5 * (aa + bb) - np.hypot(0.5 * (aa - bb), ab)  # of its eigenvalues
        lift = np.maximum(size * np.maximum(damping[busy], LEAST_BEND - least / size), 0.0)
        aa, bb = aa + lift, bb + lift
        by_a, by_b = gradient.T
        step = np.stack((ab * by_b - bb * by_a, ab * by_a - aa * by_b), axis=1)
        step /= (aa * bb - ab * ab)[:, None]
        trial = np.clip(slopes[busy] + step, -chart.half, chart.half)
        p, f, s = chart.surface(trial)
        o = p - v[busy]
        square = np.einsum("ij,ij->i", o, o)
        better = square <= squares[busy]
        damping[busy] = np.where(better, 0.0, np.maximum(damping[busy], LEAST_BEND) * 10.0)
        moved = np.linalg.norm(step, axis=1) * np.sqrt(size)
        rows = busy[better]
        slopes[rows], points[rows], squares[rows] = trial[better], p[better], square[better]
        first[rows], second[rows], off[rows] = f[better], s[better], o[better]
        busy = busy[moved > LAST_MM]
        if not len(busy):
            break
    return points
