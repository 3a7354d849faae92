"""Maps as they may be: draws from all that is unknown of both boundaries, for who plans in them.

What all cells share of a cause is drawn as one number, what each has for itself as a Gaussian
field, one for all causes of one reach. The inner boundary of a draw never crosses its outer one.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.special import ndtri

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.mapping.accuracy.error_terms import ErrorTerm, hidden_depths
from rona_core.mapping.accuracy.map_terms import POINTS, MapTerms
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.build_maps import LEAST_THICKNESS_MM

LEAST_SHARE = 1e-9  # of a range, so that none is infinite


def field_root(at_mm: Floats, reach_mm: float) -> Floats:
    """Return a root (n, n) of the covariance of places (n,) along one axis, of variance 1.

    White noise (nu, nv) between the roots of both axes is a field over their grid.

    Args:
        at_mm: Places along the axis.
        reach_mm: Standard deviation of the Gaussian by which two of them still vary alike.
    """
    if reach_mm <= 0.0:
        return np.eye(len(at_mm))
    apart = (at_mm[:, None] - at_mm) / reach_mm
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
    return vectors * np.sqrt(np.maximum(values, 0.0))  # far from regular: no Cholesky


def stratified_normals(count: int, generator: Generator) -> Floats:
    """Return standard normal numbers (count,), one of each of as many equally likely ranges.

    So a few of them have the spread of many (Latin hypercube, McKay 1979); they depend on each
    other.
    """
    within = generator.uniform(LEAST_SHARE, 1.0, count)
    return ndtri((generator.permutation(count) + within) / count)


AT_ONCE = 16  # draws that are worked on together: all of them take much memory
LEAST_CELLS = 12  # of a map that has a mean to speak of
LEAST_LEFT = 0.01  # of the variance of a field, where its mean over the map is taken off


@dataclass(frozen=True, slots=True, eq=False)
class MapDraws:
    """Heights of both boundaries over the grid of the maps, n times."""

    maps: Maps  # that they are draws of, with frame and grid
    outer_mm: Floats  # (n, nu, nv)
    inner_mm: Floats  # (n, nu, nv)
    reread_mm: Floats  # (n, nu, nv) thickness that a further scan would read, at the speed of now


def draw_maps(
    maps: Maps,
    terms: MapTerms,
    count: int,
    seed: int = 0,
    *,
    same_robot: bool = False,
    grooves: bool = False,
) -> MapDraws:
    """Return maps as they may be.

    Args:
        maps: As they were made.
        terms: Their causes of error.
        count: How many.
        seed: Of the draws; the same gives the same.
        same_robot: The robot that scanned uses the map: what its links err by drops out.
        grooves: What may hide where there was no echo always takes bone away, for plans to mill.
            Else it is grooves in half of the draws and crests in the others: which of them a bone
            has is not known.
    """
    generator = np.random.default_rng(seed)
    of_place = [term for term in terms.place if not (same_robot and term.of_robot)]
    place = _drawn(maps.outer, of_place, count, generator)
    place += maps.outer.height_mm
    outer = place + _drawn(maps.outer, (*terms.front, terms.rough), count, generator)
    # another scan errs alike by what reference points alone can mend: the speed of sound
    lasting = [term for term in terms.depth if term.remedy == POINTS]
    passing = [term for term in terms.depth if not (term.remedy == POINTS or term.hidden)]
    reread = _drawn(maps.inner, passing, count, generator)
    signs = np.where(grooves | (generator.random(count) < 0.5), -1.0, 1.0)
    for term in terms.depth:
        if term.hidden:
            reread += _hidden(maps.inner, term, signs, generator)
    reread += maps.thickness_mm()
    inner = _drawn(maps.inner, lasting, count, generator)  # of the speed, so far
    inner += reread
    np.subtract(place, inner, out=inner)
    # last: draws of all else are the same whether a front echo was missing or not
    outer += _drawn(maps.outer, (terms.no_front_echo,), count, generator)
    np.minimum(inner, outer - LEAST_THICKNESS_MM, out=inner)
    return MapDraws(maps, readonly(outer), readonly(inner), readonly(reread))


def _drawn(
    boundary: BoundaryMap,
    terms: Iterable[ErrorTerm],
    count: int,
    generator: Generator,
) -> Floats:
    """Return errors (count, nu, nv) by causes; nothing of one that is not known at all.

    Causes of one reach are drawn as one field, with the sum of their variances.
    """
    shape = boundary.ok.shape
    errors, squares = np.zeros((count, *shape)), dict[float, Floats]()
    for term in terms:
        if np.any(term.shared_mm):
            for some, shared in _blocks(errors, stratified_normals(count, generator)):
                some += term.shared_mm * shared[:, None, None]
        own = np.broadcast_to(term.own_mm, shape)
        known = np.where(np.isposinf(own), 0.0, own)
        squares[term.reach_mm] = squares.get(term.reach_mm, 0.0) + known**2
    for reach_mm, square in squares.items():
        roots = _roots(boundary, reach_mm)
        own, weights = _own_alone(np.sqrt(square), boundary.ok, roots)
        for (some,) in _blocks(errors):
            fields = own * _fields(roots, len(some), generator)
            some += fields - np.sum(weights * fields, axis=(1, 2), keepdims=True)
    return errors


def _own_alone(own_mm: Floats, ok: Bools, roots: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return what to draw a field with so that cells differ by ``own_mm``, their mean left out.

    What a map errs by as a whole is drawn by itself.

    Returns:
        Standard deviations (nu, nv) of the field, and weights of the mean that is then to be
        subtracted: its mean square over the mapped cells is that of ``own_mm``.
    """
    weights = ok / max(np.count_nonzero(ok), 1)
    whole = float(np.sum(weights * own_mm**2))
    of_mean = float(np.sum((roots[0].T @ (weights * own_mm) @ roots[1]) ** 2))
    if np.count_nonzero(ok) < LEAST_CELLS or whole <= 0.0:
        return own_mm, np.zeros(ok.shape)
    return own_mm / np.sqrt(max(1.0 - of_mean / whole, LEAST_LEFT)), weights


def _hidden(boundary: BoundaryMap, term: ErrorTerm, signs: Floats, generator: Generator) -> Floats:
    """Return what may hide where there was no echo (n, nu, nv), with the sign (n,) of each draw."""
    off_mm, roots = np.hypot(term.own_mm, term.shared_mm), _roots(boundary, term.reach_mm)
    errors = np.zeros((len(signs), *boundary.ok.shape))
    for some, sign in _blocks(errors, signs):
        depths = hidden_depths(_fields(roots, len(some), generator))
        some[...] = sign[:, None, None] * off_mm * depths
    return errors


def _roots(boundary: BoundaryMap, reach_mm: float) -> tuple[Floats, Floats]:
    """Return roots of how errors of a reach hang together along both axes."""
    return field_root(boundary.u_mm, reach_mm), field_root(boundary.v_mm, reach_mm)


def _fields(roots: tuple[Floats, Floats], count: int, generator: Generator) -> Floats:
    """Return Gaussian fields (count, nu, nv) of variance 1 with these roots of their covariance."""
    along_u, along_v = roots
    white = generator.standard_normal((count, len(along_u), len(along_v)))
    return along_u @ white @ along_v.T


def _blocks(*arrays: Floats) -> Iterator[tuple[Floats, ...]]:
    """Yield some rows of all arrays at a time."""
    for start in range(0, len(arrays[0]), AT_ONCE):
        yield tuple(array[start : start + AT_ONCE] for array in arrays)
