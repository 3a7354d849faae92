"""Maps as they may be: draws from all that is unknown of both boundaries, for who plans in them.

Each cause of error is drawn by itself: what all cells share as one number, what a cell has for
itself as a Gaussian field over the reach of its cause, and what is unknown between the samples from
the plate through them. The inner boundary of a draw never crosses its outer one.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.maps.accuracy.echo_terms import INTERPOLATION
from rona_core.app.steps.maps.accuracy.error_terms import ErrorTerm, hidden_depths
from rona_core.app.steps.maps.accuracy.map_terms import POINTS, map_terms
from rona_core.errors import InvalidInputError, StaleResultError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.build_maps import LEAST_THICKNESS_MM
from rona_core.mapping.fitting.gaussian_field import field_root
from rona_core.mapping.fitting.plate_field import PlateField
from rona_core.session.document import Session

MOST_DRAWS = 1000
AT_ONCE = 16  # draws that are worked on together: all of them take much memory


@dataclass(frozen=True, slots=True, eq=False)
class MapDraws:
    """Heights of both boundaries over the grid of the maps, n times."""

    maps: Maps  # that they are draws of, with frame and grid
    outer_mm: Floats  # (n, nu, nv)
    inner_mm: Floats  # (n, nu, nv)
    reread_mm: Floats  # (n, nu, nv) thickness that a further scan would read, at the speed of now


def draw_maps(
    session: Session,
    count: int,
    seed: int = 0,
    *,
    same_robot: bool = False,
    grooves: bool = False,
) -> MapDraws:
    """Return the robot's maps as they may be.

    Args:
        session: With its maps.
        count: How many.
        seed: Of the draws; the same gives the same.
        same_robot: The robot that scanned uses the map: what its links err by drops out.
        grooves: What hides where nothing was heard always takes bone away, for who plans to mill.
            Else it is grooves in half of the draws and crests in the others: which of them a bone
            has is not known.

    Raises:
        InvalidInputError: no draws, or too many.
        StepBlockedError: nothing was mapped.
        StaleResultError: the maps are out of date.
    """
    if not 1 <= count <= MOST_DRAWS:
        raise InvalidInputError(f"{count} draws were asked for: 1 to {MOST_DRAWS} can be made")
    maps: Maps = require_result(session.results.maps, "map the boundaries (step 9)").value
    terms, reason = map_terms(session), stale_reason("maps", session)
    if terms is None or reason is not None:
        raise StaleResultError(f"the maps are stale: {reason or 'they are of other A-scans'}")
    generator = np.random.default_rng(seed)
    kept = [term for term in terms.outer if not (same_robot and term.of_robot)]
    outer = _drawn(maps.outer, kept, count, generator)
    _add_plate(outer, maps.outer, terms.outer_plate, generator)
    outer += maps.outer.height_mm
    # another scan errs alike by what reference points alone can mend: the speed of sound
    lasting = [term for term in terms.thickness if term.remedy == POINTS]
    passing = [term for term in terms.thickness if not (term.remedy == POINTS or term.hidden)]
    reread = _drawn(maps.outer, passing, count, generator)
    signs = np.where(grooves | (generator.random(count) < 0.5), -1.0, 1.0)
    for term in terms.thickness:
        if term.hidden:
            reread += _hidden(maps.outer, term, signs, generator)
    reread += maps.thickness_mm()
    inner = _drawn(maps.outer, lasting, count, generator)  # of the speed, so far
    if terms.thickness_plate is not None:
        _add_plate(reread, maps.outer, terms.thickness_plate, generator)
    inner += reread
    np.maximum(inner, LEAST_THICKNESS_MM, out=inner)
    np.subtract(outer, inner, out=inner)
    return MapDraws(maps, readonly(outer), readonly(inner), readonly(reread))


def _drawn(
    grid: BoundaryMap,
    terms: Iterable[ErrorTerm],
    count: int,
    generator: Generator,
) -> Floats:
    """Return errors (count, nu, nv) by causes."""
    shape = grid.height_mm.shape
    errors = np.zeros((count, *shape))
    for term in terms:
        shared = generator.standard_normal((count, 1, 1))
        along_u, along_v = _roots(grid, term)
        for start in range(0, count, AT_ONCE):
            some = errors[start : start + AT_ONCE]
            some += np.broadcast_to(term.shared_mm, shape) * shared[start : start + AT_ONCE]
            if term.cause != INTERPOLATION:
                field = along_u @ generator.standard_normal(some.shape) @ along_v.T
                some += np.broadcast_to(term.own_mm, shape) * field
    return errors


def _add_plate(errors: Floats, grid: BoundaryMap, plate: PlateField, generator: Generator) -> None:
    """Add to errors (n, nu, nv) what is unknown of a plate between its samples."""
    u, v = np.meshgrid(grid.u_mm, grid.v_mm, indexing="ij")
    places = np.column_stack((u.ravel(), v.ravel()))
    drawn = plate.draws(places, len(errors), generator)
    drawn -= plate.heights(places)
    errors += drawn.reshape(errors.shape)


def _hidden(grid: BoundaryMap, term: ErrorTerm, signs: Floats, generator: Generator) -> Floats:
    """Return what hides where nothing was heard (n, nu, nv), with the sign (n,) of each draw."""
    along_u, along_v = _roots(grid, term)
    off_mm = np.hypot(term.own_mm, term.shared_mm)
    errors = np.zeros((len(signs), *grid.height_mm.shape))
    for start in range(0, len(signs), AT_ONCE):
        some = errors[start : start + AT_ONCE]
        field = along_u @ generator.standard_normal(some.shape) @ along_v.T
        some[...] = signs[start : start + AT_ONCE, None, None] * off_mm * hidden_depths(field)
    return errors


def _roots(grid: BoundaryMap, term: ErrorTerm) -> tuple[Floats, Floats]:
    """Return roots of how the errors of a cause hang together along both axes."""
    return field_root(grid.u_mm, term.reach_mm), field_root(grid.v_mm, term.reach_mm)
