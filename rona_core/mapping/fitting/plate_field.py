"""Thin plate through scattered heights, with what is known of it everywhere: a Gaussian field.

A smoothing thin plate is the posterior mean of a field whose precision is its bending energy (Wahba
1990). On a grid that precision couples near nodes alone (a Gaussian Markov random field, Rue
2005), so that heights, standard deviations and draws cost little. How stiff the plate is, and
how far samples scatter, is what makes the samples most likely once planes are left out of account
(restricted maximum likelihood, Patterson 1971).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.random import Generator
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import minimize_scalar

from rona_core.geometry.arrays import Floats, readonly
from rona_core.mapping.fitting.banded_cholesky import BandedCholesky
from rona_core.mapping.fitting.field_grid import FieldGrid, bending, grid_around

STIFFNESS = (1e-4, 1e8)  # that are looked at, noise over increments, squared
AT_ONCE = 32  # draws that are worked on together: all of them take much memory
PLANES = 3  # free parameters that bending does not cost
LEAST_MM = 1e-4
ROUGHNESS_MM = 0.026  # of the outer table within a beam, which an A-scan averages over


@dataclass(frozen=True, slots=True, eq=False)
class Quadric:
    """The quadric that a field departs from: bone is a dome, and a plate wants to be flat."""

    coefficients: Floats  # (6,) of 1, u, v, u², uv, v²
    middle_mm: Floats  # (2,)
    reach_mm: float  # u and v are in such lengths from the middle

    def heights(self, places_mm: Floats, along: tuple[int, int] = (0, 0)) -> Floats:
        """Return heights (n,) at places (n, 2), or a first derivative along one axis."""
        u, v = (places_mm - self.middle_mm).T / self.reach_mm
        return _monomials(u, v, along) @ self.coefficients / self.reach_mm ** sum(along)


def _monomials(u: Floats, v: Floats, along: tuple[int, int] = (0, 0)) -> Floats:
    one, none = np.ones(len(u)), np.zeros(len(u))
    columns = {
        (0, 0): (one, u, v, u * u, u * v, v * v),
        (1, 0): (none, one, none, 2.0 * u, v, none),
        (0, 1): (none, none, one, none, u, 2.0 * v),
    }
    return np.column_stack(columns[along])


def fit_quadric(places_mm: Floats, heights_mm: Floats) -> Quadric:
    """Return the quadric of least squares through heights (n,) at places (n, 2)."""
    middle = places_mm.mean(axis=0)
    reach = max(float(np.sqrt(np.mean((places_mm - middle) ** 2))), 1e-9)
    u, v = (places_mm - middle).T / reach
    found = np.linalg.lstsq(_monomials(u, v), heights_mm, rcond=1e-6)[0]
    return Quadric(readonly(np.asarray(found, dtype=np.float64)), readonly(middle), reach)


@dataclass(frozen=True, eq=False)
class PlateField:
    """A plate through samples, and its posterior: heights, standard deviations, draws."""

    grid: FieldGrid
    trend: Quadric
    nodes_mm: Floats  # (nu, nv) heights over it
    factor: BandedCholesky  # of the precision of the nodes
    loadings_mm: Floats  # (nu nv, k) what k unknowns of one deviation each do to the nodes
    scatter_mm: float  # of a sample about the field
    stiffness: float  # scatter over the size of increments, squared
    places_mm: Floats  # (n, 2) of the samples
    samples_mm: Floats  # (n,) their heights
    relative_variance: Floats  # (n,) how much less a sample counts than a perfect one
    shares: Floats  # (nu nv,) weight of these samples at the nodes: 1 where no others were joined

    def heights(self, places_mm: Floats, along: tuple[int, int] = (0, 0)) -> Floats:
        """Return the heights (m,) at places (m, 2), or a first derivative along one axis."""
        return self.trend.heights(places_mm, along) + self.departures(places_mm, along)

    def departures(self, places_mm: Floats, along: tuple[int, int] = (0, 0)) -> Floats:
        """Return the heights (m,) over the trend at places (m, 2), or a first derivative."""
        orders = along[::-1] if self.grid.swapped else along
        u, v = self.grid.own(places_mm).T
        return np.asarray(self._chart.ev(u, v, dx=orders[0], dy=orders[1]), dtype=np.float64)

    def sigmas_mm(self, places_mm: Floats) -> Floats:
        """Return the standard deviations (m,) of the field at places (m, 2), scatter left aside."""
        return np.sqrt(self.grid.operator(places_mm) @ self._variances)

    def weights(self, places_mm: Floats) -> Floats:
        """Return by how much of it the field moves (m,) at places (m, 2) if all samples do.

        The rest follows what was joined to them.
        """
        return np.clip(self.grid.operator(places_mm) @ self.shares, 0.0, 1.0)

    def drawn_errors(self, places_mm: Floats, count: int, generator: Generator) -> Floats:
        """Return by how much fields (count, m) at places (m, 2) differ from the heights.

        They are drawn from what is known of the field.
        """
        white = generator.standard_normal((self.nodes_mm.size, count))
        unknown = generator.standard_normal((self.loadings_mm.shape[1], count))
        operator, drawn = self.grid.operator(places_mm), np.zeros((count, len(places_mm)))
        for start in range(0, count, AT_ONCE):
            some = slice(start, start + AT_ONCE)
            fields = self.factor.spread(white[:, some]) + self.loadings_mm @ unknown[:, some]
            drawn[some] = (operator @ fields).T
        return drawn

    @cached_property
    def _chart(self) -> RectBivariateSpline:
        return RectBivariateSpline(self.grid.u_mm, self.grid.v_mm, self.nodes_mm)

    @cached_property
    def _variances(self) -> Floats:
        return self.factor.variances() + np.sum(self.loadings_mm**2, axis=1)


def fit_field(
    places_mm: Floats,
    heights_mm: Floats,
    relative_variance: Floats | None = None,
    stiffness: float | None = None,
) -> PlateField:
    """Return the plate through samples, as stiff as the samples say.

    Args:
        places_mm: Where the samples lie (n, 2), n >= 4 and not on one line.
        heights_mm: Their heights (n,).
        relative_variance: How much less a sample counts than a perfect one (n,); 1 if not given.
        stiffness: To use; None lets the samples choose.
    """
    count = len(heights_mm)
    weights = np.ones(count) if relative_variance is None else 1.0 / relative_variance
    grid = grid_around(places_mm)
    bend, operator = bending(*grid.shape, grid.step_mm), grid.operator(places_mm)
    filled = bend.filled()
    weighted = operator.T.multiply(weights).tocsr()
    information = grid.banded((weighted @ operator).tocsr())
    information.regularize()
    trend = fit_quadric(places_mm, heights_mm)
    over = heights_mm - trend.heights(places_mm)
    right = np.asarray(weighted @ over)
    room = np.zeros_like(information.bands)  # of one factor: memory anew for each takes longer

    def solved(stiff: float) -> tuple[BandedCholesky, Floats, float]:
        factor = information.plus(stiff, bend, room).cholesky(overwrite=True)
        nodes = factor.solve(right)
        off = over - operator @ nodes
        square = float(np.sum(weights * off**2)) + stiff * filled.energy(nodes)
        return factor, nodes, max(square / max(count - PLANES, 1), LEAST_MM**2)

    def unlikely(log_stiffness: float) -> float:
        factor, _, variance = solved(float(np.exp(log_stiffness)))
        fit = (count - PLANES) * np.log(variance)
        return float(fit + factor.log_determinant() - (right.size - PLANES) * log_stiffness)

    if stiffness is None:
        best: Any = minimize_scalar(
            unlikely, bounds=np.log(STIFFNESS), method="bounded", options={"xatol": 0.2}
        )
        stiffness = float(np.exp(best.x))
    factor, nodes, variance = solved(stiffness)
    scale = float(np.sqrt(variance))
    np.divide(factor.bands, scale, out=factor.bands)  # in place: it is the largest array here
    return PlateField(
        grid=grid,
        trend=trend,
        nodes_mm=readonly(nodes.reshape(grid.shape)),
        factor=factor,
        loadings_mm=readonly(np.zeros((nodes.size, 0))),
        scatter_mm=scale,
        stiffness=stiffness,
        places_mm=readonly(places_mm),
        samples_mm=readonly(heights_mm),
        relative_variance=readonly(1.0 / weights),
        shares=readonly(np.ones(nodes.size)),
    )


_ALIVE: "WeakValueDictionary[bytes, PlateField]" = WeakValueDictionary()


def plate_through(points_map: Floats) -> PlateField:
    """Return the plate through points (n, 3): equal points give the same object."""
    key = sha256(points_map.tobytes()).digest()
    plate = _ALIVE.get(key)
    if plate is None:
        plate = _ALIVE[key] = fit_field(points_map[:, :2], points_map[:, 2])
    return plate


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """Points of a surface that may be moved as a whole: each measures its distance."""

    points_map: Floats  # (n, 3)
    upright: Floats  # (n,) cosine of the normal of the plate and the axis of heights
    weights: Floats  # (n,) inverse variances of the distances
    moved_by: Floats  # (n, 6) change of each distance with a motion of all
    motion: Floats  # (6, 6) covariance of that motion


def joined(plate: PlateField, more: SurfaceSamples) -> PlateField:
    """Return the plate through its samples and more, as stiff as it is.

    The motion of the added points is not solved for; what is unknown of it stays unknown of the
    plate (a consider parameter, Schmidt 1966).
    """
    grid = grid_around(np.vstack((plate.places_mm, more.points_map[:, :2])))
    operator = grid.operator(plate.places_mm)
    variance = plate.scatter_mm**2 * plate.relative_variance + ROUGHNESS_MM**2
    weighted = operator.T.multiply(1.0 / variance).tocsr()
    operator_more = grid.operator(more.points_map[:, :2])
    across = operator_more.T.multiply(more.weights * more.upright).tocsr()
    seen = across @ operator_more.multiply(more.upright[:, None])
    information = grid.banded((weighted @ operator + seen).tocsr())
    information.regularize()
    stiff = plate.stiffness / plate.scatter_mm**2
    bend = bending(*grid.shape, grid.step_mm)
    factor = information.plus(stiff, bend, information.bands).cholesky(overwrite=True)
    over = plate.samples_mm - plate.trend.heights(plate.places_mm)
    over_more = more.points_map[:, 2] - plate.trend.heights(more.points_map[:, :2])
    right = np.asarray(weighted @ over) + np.asarray(across @ (more.upright * over_more))
    moved = np.asarray(across @ more.moved_by, dtype=np.float64)
    moved = moved @ np.linalg.cholesky(more.motion)
    alike = np.asarray(weighted @ np.ones(len(over)))
    found = factor.solve(np.column_stack((right, alike, moved)))
    return replace(
        plate,
        grid=grid,
        nodes_mm=readonly(found[:, 0].reshape(grid.shape)),
        factor=factor,
        loadings_mm=readonly(found[:, 2:]),
        shares=readonly(found[:, 1]),
    )
