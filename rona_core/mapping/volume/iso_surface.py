"""Iso-surface of an echo volume by surface nets (Gibson 1998, see docs/references.md).

One vertex for each cube of eight voxels that the surface passes, at the mean of its crossings with
the edges; one quadrangle for each edge of the grid that it crosses.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.mapping.volume.echo_volume import SILENCE, EchoVolume

ABOVE_NOISE_DB = 6.0  # a surface in what is fainter is one of noise
LEVELS_DB = (-80.0, 0.0)
CORNERS = tuple(np.ndindex(2, 2, 2))


@dataclass(frozen=True, slots=True, eq=False)
class IsoSurface:
    """Triangles where the echoes have one level, facing what is quieter."""

    points_base: Floats  # (n, 3)
    faces: Ints  # (m, 3) rows of the points
    depths_mm: Floats  # (n,) below the outer boundary, along z of the map

    def __len__(self) -> int:
        return len(self.faces)


def iso_surface(volume: EchoVolume, level_db: float, gain_db_per_mm: float = 0.0) -> IsoSurface:
    """Return the surface of a level; it is open where voxels are not known.

    It ends at the depth from which the gain raises noise to the level.

    Args:
        volume: In which the surface is sought.
        level_db: Over the front echo of flat bone in perfect contact.
        gain_db_per_mm: With depth, see ``EchoVolume.level_db``.

    Raises:
        InvalidInputError: the level is out of range.
    """
    if not LEVELS_DB[0] <= level_db <= LEVELS_DB[1]:
        raise InvalidInputError(
            f"the level must be {LEVELS_DB[0]:g} to {LEVELS_DB[1]:g} dB: {level_db:g}"
        )
    over = volume.level_db(gain_db_per_mm).astype(np.float64) - level_db
    noise_db = 20.0 * np.log10(max(volume.noise(), SILENCE))
    audible = level_db - gain_db_per_mm * volume.depths_mm() >= noise_db + ABOVE_NOISE_DB
    places, faces = surface_nets(over, volume.known & audible)
    u, v = volume.outer.u_mm, volume.outer.v_mm
    points_map = places * volume.steps_mm + (u[0], v[0], volume.z_mm[0])
    i, j = (np.rint(places[:, k]).astype(np.int64) for k in (0, 1))
    depths = volume.outer.height_mm[i, j] - points_map[:, 2]
    return IsoSurface(readonly(volume.T_base_map @ points_map), faces, readonly(depths))


def surface_nets(values: Floats, known: Bools) -> tuple[Floats, Ints]:
    """Return the surface where values (a, b, c) change their sign: points (n, 3) and faces (m, 3).

    Points are in steps of the grid. Cubes with a corner that is not known have no point.
    """
    inside = values > 0.0
    shape = tuple(n - 1 for n in values.shape)
    corners = [tuple(slice(k, k + n) for k, n in zip(c, shape, strict=True)) for c in CORNERS]
    whole = np.logical_and.reduce([known[corner] for corner in corners])
    count = sum(inside[corner].astype(np.int64) for corner in corners)
    cubes = whole & (count > 0) & (count < len(CORNERS))
    number = np.full(shape, -1, dtype=np.int64)
    number[cubes] = np.arange(np.count_nonzero(cubes))
    points = np.argwhere(cubes) + _mean_crossings(values, cubes)
    return points, np.concatenate([_faces(inside, number, axis) for axis in range(3)])


def _mean_crossings(values: Floats, cubes: Bools) -> Floats:
    """Return the mean (n, 3), 0 to 1, of where in its cube the twelve edges are crossed."""
    at = np.argwhere(cubes)
    total, number = np.zeros((len(at), 3)), np.zeros((len(at), 1))
    for axis in range(3):
        step = np.eye(3, dtype=np.int64)[axis]
        for corner in (np.array(c) for c in CORNERS if c[axis] == 0):
            first, last = (values[tuple((at + corner + k * step).T)] for k in (0, 1))
            crossed = (first > 0.0) != (last > 0.0)
            fall = np.where(crossed, first - last, 1.0)
            place = corner + (first / fall)[:, None] * step
            total += np.where(crossed[:, None], place, 0.0)
            number += crossed[:, None]
    return total / number


def _faces(inside: Bools, number: Ints, axis: int) -> NDArray[np.int64]:
    """Return two triangles (m, 3) for each edge along an axis that is crossed amid four cubes."""
    turned = np.moveaxis(inside, axis, 0)  # the edge, then two axes that follow it cyclically
    cube = np.moveaxis(number, axis, 0)
    if axis == 1:  # (b, a, c): so that the three axes stay right-handed
        turned, cube = turned.transpose(0, 2, 1), cube.transpose(0, 2, 1)
    first, last = turned[:-1, 1:-1, 1:-1], turned[1:, 1:-1, 1:-1]
    a, b = cube[:, :-1, :-1], cube[:, 1:, :-1]
    c, d = cube[:, 1:, 1:], cube[:, :-1, 1:]
    whole = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    found: list[Ints] = []
    for leaves, order in ((True, (a, b, c, d)), (False, (d, c, b, a))):
        crossed = whole & (first != last) & (first == leaves)
        p, q, r, s = (corner[crossed] for corner in order)
        found += [np.column_stack((p, q, r)), np.column_stack((p, r, s))]
    return np.concatenate(found)
