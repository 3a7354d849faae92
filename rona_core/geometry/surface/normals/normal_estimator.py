"""Estimation of normals with one radius: fit, predicted error and flags.

Fits to the neighbourhoods of many places at once: regression planes, least squares, quadrics. A
plane through points that lie on one side only leans with the curvature; a quadric z = a + b u + c v
+ d u^2 + e u v + f v^2 over the plane bends with it, and its slope at the place is the normal there
(an osculating jet: Cazals and Pouget 2005, docs/references.md).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.surface.normals.point_grid import Moments, PointGrid

BATCH = 400_000  # padded neighbours handed out together
COEFFICIENTS = 6
TURNS = 2  # the height is measured along the plane's normal first, then along the quadric's
GAP = 3  # rows of the cloud; a pause as short does not end a run
LAST = np.iinfo(np.int64).max
RANK = 1e-10  # eigenvalue of the normal equations over the largest; below it there is no quadric


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhoods:
    """The neighbours of b places, padded to the largest neighbourhood among them."""

    rows: Ints  # (b,) which of the places
    offsets: Floats  # (b, k, 3) neighbours minus place; zero where there is none
    there: Bools  # (b, k)
    cloud_rows: Ints  # (b, k) which points of the cloud they are

    def runs(self) -> tuple[Ints, Bools]:
        """Return the order (b, k) of the neighbours in the cloud, and who follows whom (b, k - 1).

        A pointer that slides comes by several times; each time is a run of points that follow each
        other in the cloud.
        """
        order = np.argsort(np.where(self.there, self.cloud_rows, LAST), axis=1)
        rows, there = (np.take_along_axis(a, order, axis=1) for a in (self.cloud_rows, self.there))
        follows = np.logical_and(np.diff(rows, axis=1) <= GAP, there[:, 1:])
        return np.asarray(order, dtype=np.int64), np.asarray(follows)


def neighbourhoods(grid: PointGrid, places: Floats, counts: Ints) -> Iterator[Neighbourhoods]:
    """Yield the neighbourhoods of all ``places`` (m, 3) that have any, a batch at a time.

    ``counts`` (m,) are the numbers of points within the radius of the grid.
    """
    rows = np.argsort(-counts, kind="stable")[: np.count_nonzero(counts)]
    while len(rows):  # the largest come first, so that little is padded
        width = int(counts[rows[0]])
        batch, rows = np.split(rows, [max(1, BATCH // width)])
        there = np.arange(width) < counts[batch][:, None]
        found = np.zeros(there.shape, dtype=np.int64)
        found[there] = grid.neighbours(places[batch])
        offsets = grid.points[found] - places[batch][:, None]
        yield Neighbourhoods(batch, np.where(there[:, :, None], offsets, 0.0), there, found)


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """One plane for each of b neighbourhoods."""

    normals: Floats  # (b, 3) unit, sign open; zero where there is none
    eigenvalues: Floats  # (b, 3) variances of the points, ascending, mm^2
    centroids: Floats  # (b, 3) from the place

    def select(self, rows: Ints) -> "Planes":
        """Return those of some neighbourhoods."""
        return Planes(self.normals[rows], self.eigenvalues[rows], self.centroids[rows])


def fit_planes(moments: Moments) -> Planes:
    """Return the planes of least squared distances: Equation 2 without the noise it tilts by.

    Equation 2 takes all noise for errors along one axis. The least eigenvalue of the scatter is the
    variance of the noise along the normal; with it off the diagonal the points scatter in a plane
    exactly, and Equation 2 returns the normal of that plane.
    """
    eigenvalues = np.linalg.eigvalsh(moments.scatter)
    flat = moments.scatter - eigenvalues[:, :1, None] * np.eye(3)
    sure = np.where(eigenvalues > moments.rounding_mm2, eigenvalues, 0.0)
    return Planes(_regression_normals(flat), sure, moments.centroids)


def _regression_normals(scatter: Floats) -> Floats:
    """Return the paper's normals (b, 3) by Equation 2, up to sign; zero where there is no plane.

    With a = 1 the normal is (Syz^2 - Szz Syy, Szz Sxy - Syz Sxz, Sxz Syy - Syz Sxy); b = 1 and
    c = 1 follow by exchanging the letters. The element set to 1 holds its denominator.
    """
    xx, yy, zz = scatter[:, 0, 0], scatter[:, 1, 1], scatter[:, 2, 2]
    xy, xz, yz = scatter[:, 0, 1], scatter[:, 0, 2], scatter[:, 1, 2]
    variants = np.stack(
        (
            np.stack((yz**2 - zz * yy, zz * xy - yz * xz, xz * yy - yz * xy), axis=1),
            np.stack((zz * xy - xz * yz, xz**2 - zz * xx, yz * xx - xz * xy), axis=1),
            np.stack((xz * yy - xy * yz, yz * xx - xy * xz, xy**2 - yy * xx), axis=1),
        ),
        axis=1,
    )
    denominators = np.abs(np.einsum("mii->mi", variants))
    chosen = variants[np.arange(len(scatter)), denominators.argmax(axis=1)]
    lengths = np.linalg.norm(chosen, axis=1)[:, None]
    return np.divide(chosen, lengths, out=np.zeros_like(chosen), where=lengths > 0)


@dataclass(frozen=True, slots=True, eq=False)
class Jets:
    """One quadric for each of b neighbourhoods."""

    normals: Floats  # (b, 3) unit, on the side of the planes' normals
    noise_mm2: Floats  # (b,) variance of one point about the quadric; 0 without spare points
    gain: Floats  # (b,) variance of the normal in rad^2 over that of one point, 1/mm^2
    curvatures: Floats  # (b, 2) principal curvatures, 1/mm, larger size first
    solved: Bools  # (b,) whether the points determine all coefficients
    alike: Floats  # (b,) points that err alike; 1: each for itself


def fit_jets(near: Neighbourhoods, normals: Floats, radius_mm: float) -> Jets:
    """Return the quadrics over planes with ``normals`` (b, 3), each taken at its place.

    Lengths along the plane are scaled by ``radius_mm`` so that the equations are well balanced.
    """
    weights = near.there[:, :, None].astype(np.float64)
    spare = np.maximum(near.there.sum(axis=1) - COEFFICIENTS, 0)
    gain = noise = np.zeros(len(normals))
    residuals = np.zeros(near.there.shape)
    solved: Bools = np.zeros(len(normals), dtype=bool)
    curvatures = np.zeros((len(normals), 2))
    for _ in range(TURNS):
        frames = _frames(normals)
        u, v, z = np.moveaxis(near.offsets @ frames.transpose(0, 2, 1), 2, 0)
        u, v = u / radius_mm, v / radius_mm
        design = np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=2) * weights
        squares = design.transpose(0, 2, 1) @ design
        sizes, axes = np.linalg.eigh(squares)
        solid = sizes > RANK * sizes[:, -1:]
        inverse = (axes * np.where(solid, 1.0 / np.where(solid, sizes, 1.0), 0.0)[:, None]) @ (
            axes.transpose(0, 2, 1)
        )
        c = (inverse @ (design.transpose(0, 2, 1) @ z[:, :, None]))[:, :, 0]
        residuals = z * weights[:, :, 0] - (design @ c[:, :, None])[:, :, 0]
        noise = np.where(spare > 0, (residuals**2).sum(axis=1) / np.maximum(spare, 1), 0.0)
        slopes = c[:, 1:3] / radius_mm
        flat = 1.0 + (slopes**2).sum(axis=1)
        gain = (inverse[:, 1, 1] + inverse[:, 2, 2]) / radius_mm**2 / flat
        solved = np.asarray(solid.all(axis=1))
        curvatures = _curvatures(c[:, 3:] / radius_mm**2)
        local = np.column_stack((-slopes, np.ones(len(c)))) / np.sqrt(flat)[:, None]
        normals = np.einsum("bi,bij->bj", local, frames)
    return Jets(normals, noise, gain, curvatures, solved, _alike(near, residuals))


def _alike(near: Neighbourhoods, residuals: Floats) -> Floats:
    """Return how many points (b,) err alike, by residuals (b, k) of those that follow each other.

    A head that breathes, or the field of a tracker, lifts a whole run of points. Their residuals
    are as alike as their correlation over all neighbourhoods says.
    """
    order, follows = near.runs()
    in_order = np.take_along_axis(residuals, order, axis=1)
    first, second = (
        np.where(follows, in_order[:, :-1], 0.0),
        np.where(follows, in_order[:, 1:], 0.0),
    )
    squares = float((first**2 + second**2).sum()) / 2.0
    correlation = max(float((first * second).sum()) / squares, 0.0) if squares > 0.0 else 0.0
    b, k = near.there.shape
    run = np.column_stack((np.zeros(b, dtype=np.int64), np.cumsum(~follows, axis=1)))
    rows, columns = np.nonzero(np.arange(k) < near.there.sum(axis=1)[:, None])
    sizes = np.bincount(rows * k + run[rows, columns], minlength=b * k).reshape(b, k)
    # of the run that a point is in, averaged over points: it is what their mean scatters by
    size = (sizes**2).sum(axis=1) / np.maximum(sizes.sum(axis=1), 1)
    return 1.0 + (np.maximum(size, 1.0) - 1.0) * correlation


def _frames(normals: Floats) -> Floats:
    """Return right-handed frames (b, 3, 3) as rows, the last one along each normal."""
    helper = np.eye(3)[np.abs(normals).argmin(axis=1)]
    x: Floats = np.cross(helper, normals)
    x /= np.linalg.norm(x, axis=1)[:, None]
    y: Floats = np.cross(normals, x)
    return np.stack((x, y, normals), axis=1)


def _curvatures(second: Floats) -> Floats:
    """Return the eigenvalues (b, 2) of the second derivatives (d, e, f), larger size first."""
    d, e, f = second.T
    mean, split = d + f, np.hypot(d - f, e)
    both = np.stack((mean + split, mean - split), axis=1)
    order = np.argsort(-np.abs(both), axis=1)
    return np.take_along_axis(both, order, axis=1)


NormalMethod = Literal["jet", "plane"]
METHODS: tuple[NormalMethod, ...] = ("jet", "plane")

MIN_COUNT = 10  # points; with fewer, chance makes them look flatter than they are
MAX_SIGMA_DEG = 5.0  # predicted; beyond it the probe hears nothing
MIN_SPARE = 4  # points more than a quadric has coefficients
MIN_FLATNESS = 9.0  # variance across the narrow direction of the patch over that along the normal
MIN_WIDTH = 0.05  # variance across the patch over that along it; a single strand is below
MAX_OFF_CENTRE = 0.3  # of the radius; the centroid of half a disc is at 0.42
DISC_GAIN = 8.0  # gain of a full disc times its points and its radius squared
MAX_GAIN = 225.0  # in full discs of as many points: 15 times their error
# indices into normals.FLAGS; 0: nothing is wrong
TOO_FEW, RANK_DEFICIENT, NOT_FLAT, ONE_SIDED, EDGE_ON, UNCERTAIN = 1, 2, 3, 4, 5, 6
SURE = 2.0  # sigma of a variance by which it must exceed the noise to count as relief,
SLACK = 0.15  # and this share of the noise, which is not known better


@dataclass(slots=True, eq=False)
class Estimates:
    """Results at m places, before they are turned outward."""

    normals: Floats  # (m, 3) sign open, zero where there is none
    count: Ints  # (m,)
    eigenvalues: Floats  # (m, 3) mm^2
    sigma_deg: Floats  # (m,)
    flag: Ints  # (m,) index into the names of normals.FLAGS
    noise_mm2: Floats  # (m,) variance of one point about the surface
    gain: Floats  # (m,) variance of the normal over that of one point, rad^2/mm^2
    curvature_per_mm: Floats  # (m,) the larger one by size; 0 for planes

    def select(self, rows: Ints | np.ndarray) -> "Estimates":
        """Return those of some places."""
        return Estimates(*(getattr(self, name)[rows] for name in self.__slots__))

    def replace(self, rows: Ints, other: "Estimates") -> None:
        """Put ``other`` in the place of ``rows``."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)


def estimate(
    points: Floats, places: Floats, radius_mm: float, method: NormalMethod, noise_mm: float | None
) -> Estimates:
    """Return the normals at ``places`` (m, 3) from the points within ``radius_mm``.

    Args:
        points: The cloud (n, 3).
        places: Where, in the frame of the cloud.
        radius_mm: Size of the neighbourhoods.
        method: How to fit.
        noise_mm: Noise of one point, for telling relief from noise where a quadric is fitted;
            None where it is unknown: then all scatter is noise.
    """
    grid = PointGrid(points, radius_mm)
    moments = grid.moments(places)
    planes = fit_planes(moments)
    found = _from_planes(planes, moments.count, radius_mm)
    if method == "jet":
        has_plane = planes.normals.any(axis=1)
        for near in neighbourhoods(grid, places, np.where(has_plane, moments.count, 0)):
            part = planes.select(near.rows), moments.count[near.rows]
            found.replace(near.rows, _from_jets(near, *part, radius_mm, noise_mm))
    return found


def _from_planes(planes: Planes, count: Ints, radius_mm: float) -> Estimates:
    thin, narrow, wide = planes.eigenvalues.T
    solid = (count >= 3) & (narrow > 0)
    across, along = np.where(solid, narrow, 1.0), np.where(solid, wide, 1.0)
    gain = (1.0 / across + 1.0 / along) / np.maximum(count, 1)
    sigma = np.rad2deg(np.sqrt(thin * gain))
    middle = planes.centroids
    off = np.linalg.norm(
        middle - np.einsum("bi,bi->b", middle, planes.normals)[:, None] * planes.normals, axis=1
    )
    flag = _shape_flags(planes, count, MIN_COUNT)
    flag = np.where((flag == 0) & (off > MAX_OFF_CENTRE * radius_mm), ONE_SIDED, flag)
    flag = np.where((flag == 0) & (sigma > MAX_SIGMA_DEG), UNCERTAIN, flag)
    return Estimates(
        normals=planes.normals,
        count=count,
        eigenvalues=planes.eigenvalues,
        sigma_deg=np.where(solid, np.minimum(sigma, 180.0), 180.0),
        flag=flag,
        noise_mm2=thin.copy(),  # no view: quadrics put their own noise in its place
        gain=np.where(solid, gain, 0.0),
        curvature_per_mm=np.zeros(len(count)),
    )


def _from_jets(
    near: Neighbourhoods, planes: Planes, count: Ints, radius_mm: float, noise_mm: float | None
) -> Estimates:
    """Return normals of quadrics; scatter that exceeds the noise counts as one bump of relief."""
    jets = fit_jets(near, planes.normals, radius_mm)
    flag = _shape_flags(planes, count, COEFFICIENTS + MIN_SPARE)
    vague = ~jets.solved | (jets.gain * count * radius_mm**2 > MAX_GAIN * DISC_GAIN)
    flag = np.where((flag == 0) & vague, RANK_DEFICIENT, flag)
    spare = np.maximum(count - COEFFICIENTS, 1)
    if noise_mm is None:
        variance = jets.noise_mm2 * jets.alike
    else:
        limit = noise_mm**2 * (1.0 + SLACK + SURE * np.sqrt(2.0 / spare))
        relief = np.maximum(jets.noise_mm2 - limit, 0.0)
        # relief does not average out
        variance = np.maximum(jets.noise_mm2, noise_mm**2) * jets.alike + relief * count
    sigma = np.rad2deg(np.sqrt(jets.gain * variance))
    flag = np.where((flag == 0) & (sigma > MAX_SIGMA_DEG), UNCERTAIN, flag)
    return Estimates(
        normals=jets.normals,
        count=count,
        eigenvalues=planes.eigenvalues,
        sigma_deg=np.where((flag == 0) | (flag == UNCERTAIN), np.minimum(sigma, 180.0), 180.0),
        flag=flag,
        noise_mm2=jets.noise_mm2,
        gain=jets.gain,
        curvature_per_mm=np.abs(jets.curvatures[:, 0]),
    )


def _shape_flags(planes: Planes, count: Ints, least: int) -> Ints:
    thin, narrow, wide = planes.eigenvalues.T
    flag = np.zeros(len(count), dtype=np.int64)
    flag[narrow <= MIN_FLATNESS * thin] = NOT_FLAT
    flag[narrow <= MIN_WIDTH * wide] = RANK_DEFICIENT
    flag[count < least] = TOO_FEW
    return flag
