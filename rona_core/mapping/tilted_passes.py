"""Further passes over a scanned region with the probe tilted.

The inner table is rarely parallel to the outer one; where it is inclined by more than two degrees
or so, its echo misses an upright probe. Passes over the whole region that are tilted in four
directions meet it from all sides, and where several agree an echo is no step within the bone. Along
lines that are given, the probe is tilted so that its sound meets the inner table squarely. See
docs/algorithms/maps/tilted_passes.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, gaussian_filter1d, map_coordinates

from rona_core.devices.limits import number, require, require_limits
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.ultrasound.probe.materials import GEL

SLOPE_BLUR_MM = 1.5  # of the thickness, before its slope is taken
LEAN_BLUR_MM = 3.0  # of the tilt along the path, so that the wrist turns evenly
STEP_MM = 0.5
RAY_STEPS = 8
# along the longer side of the path, against it, and to either side
DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


@dataclass(frozen=True, slots=True)
class TiltSettings:
    """How the probe is tilted in further passes."""

    tilt_deg: float = number(
        5.0,
        "Tilt",
        "deg",
        0.5,
        10.0,
        0.5,
        hint="From the normal; along given lines at most. Above about 6° the face loses contact",
    )
    passes: int = number(4, "Tilted passes", "", 1, 4, 1, hint="Each is tilted another way")

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True, eq=False)
class SecondPassPath:
    """The path of a further pass, and how far the probe is tilted along it."""

    path: Path5D
    lean_deg: Floats  # (n,) of the probe axis from the normal
    gap_cells: int = 0  # cells of the outer map without an inner boundary, of a pass along lines
    gap_share: float = 0.0  # of all cells of the outer map


def tilted_paths(path: Path5D, settings: TiltSettings) -> tuple[SecondPassPath, ...]:
    """Return a scan path with the probe tilted, once for each further pass.

    Args:
        path: Positions and axes (n) of the upright pass, in ``base``.
        settings: By how much, and how many passes: along the longer side of the path, against it,
            and to either side.
    """
    mean = path.axes_base.mean(axis=0)
    middle = path.points_base - path.points_base.mean(axis=0)
    along = np.linalg.svd(middle, full_matrices=False)[2][0]
    along = along - (along @ mean) / (mean @ mean) * mean
    sides = np.array((along, np.cross(mean, along)))
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    tilt = np.deg2rad(settings.tilt_deg)
    found = []
    for direction in np.array(DIRECTIONS[: settings.passes]) @ sides:
        tangent = direction - (path.axes_base @ direction)[:, None] * path.axes_base
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        axes = np.cos(tilt) * path.axes_base + np.sin(tilt) * tangent
        tilts_deg = readonly(np.full(len(path), settings.tilt_deg))
        found.append(SecondPassPath(Path5D(path.points_base, axes), tilts_deg))
    return tuple(found)


def plan_along(
    maps: Maps,
    rows_mm: ArrayLike,
    sound_speed_mm_per_us: float,
    largest_tilt_deg: float = 6.0,
) -> SecondPassPath:
    """Return a path along given lines over the outer map, the probe tilted to the inner table.

    Args:
        maps: Of all passes so far.
        rows_mm: Start and end of each (n, 2, 2) in the plane of the map, in the order of scanning.
        sound_speed_mm_per_us: Of bone, as the maps were made with: sound bends at the outer
            boundary, so that the probe is tilted by less than the inner table is.
        largest_tilt_deg: Of the probe.

    Raises:
        InvalidInputError: a line, or the way to the next one, leaves the outer map.
    """
    outer = maps.outer
    cell_mm = float(outer.u_mm[1] - outer.u_mm[0])
    given = np.asarray(rows_mm, dtype=np.float64)
    require(
        given.ndim == 3 and given.shape[1:] == (2, 2) and bool(np.isfinite(given).all()),
        f"lines need a start and an end, u and v of each, got values of shape {given.shape}",
    )
    rows = [(one[0], one[1]) for one in (given - (outer.u_mm[0], outer.v_mm[0])) / cell_mm]
    places, numbers = _walk(rows, STEP_MM / cell_mm)
    i, j = np.rint(places).astype(np.int64).T
    inside = (i >= 0) & (j >= 0) & (i < outer.ok.shape[0]) & (j < outer.ok.shape[1])
    inside[inside] = outer.ok[i[inside], j[inside]]
    first = int(numbers[np.argmin(inside)]) + 1
    require(
        bool(inside.all()),
        f"line {first} of {len(rows)}, or the way to it, leaves the mapped outer boundary: give "
        "lines within it",
    )
    gaps = maps.outer.ok & ~maps.inner.ok
    share = float(gaps.sum() / max(int(maps.outer.ok.sum()), 1))
    slopes = _at(_slopes(maps.thickness_mm(), cell_mm), places)
    leans = slopes * GEL.speed_mm_per_us / sound_speed_mm_per_us
    leans = gaussian_filter1d(leans, LEAN_BLUR_MM / STEP_MM, axis=0, mode="nearest")
    size = np.linalg.norm(leans, axis=1, keepdims=True)
    most = np.tan(np.deg2rad(largest_tilt_deg))
    leans *= np.minimum(1.0, most / np.maximum(size, 1e-12))
    points_map, normals_map = _surface(outer, places, cell_mm)
    tangent = np.column_stack((leans, np.zeros(len(leans))))
    tangent -= np.einsum("ij,ij->i", tangent, normals_map)[:, None] * normals_map
    axes_map = -normals_map - tangent
    axes_map /= np.linalg.norm(axes_map, axis=1, keepdims=True)
    cosines = np.clip(-np.einsum("ij,ij->i", axes_map, normals_map), -1.0, 1.0)
    T_base_map = maps.outer.T_base_map
    return SecondPassPath(
        path=Path5D(T_base_map @ points_map, T_base_map.rotate(axes_map)),
        lean_deg=readonly(np.rad2deg(np.arccos(cosines))),
        gap_cells=int(gaps.sum()),
        gap_share=share,
    )


def _walk(rows: list[tuple[Floats, Floats]], step: float) -> tuple[Floats, Ints]:
    """Return places (n, 2) in cells along all rows and between them, and the row of each (n,)."""
    corners = np.array([end for row in rows for end in row])
    numbers = np.repeat(np.arange(len(rows)), 2)
    places, row_of = [corners[:1]], [numbers[:1]]
    for i in range(1, len(corners)):
        step_cells = corners[i] - corners[i - 1]
        count = int(np.ceil(np.linalg.norm(step_cells) / step - 1e-9))
        if count:
            shares = (np.arange(count) + 1.0)[:, None] / count
            places.append(corners[i - 1] + shares * step_cells)
            row_of.append(np.full(count, numbers[i]))
    return np.concatenate(places), np.concatenate(row_of)


def _slopes(heights_mm: Floats, cell_mm: float) -> tuple[Floats, Floats]:
    """Return how heights (nu, nv) change along u and v, per millimetre."""
    smooth = gaussian_filter(heights_mm, SLOPE_BLUR_MM / cell_mm, mode="nearest")
    return np.gradient(smooth, cell_mm, axis=0), np.gradient(smooth, cell_mm, axis=1)


def _at(grids: tuple[Floats, ...], cells: Floats) -> Floats:
    """Return grids (nu, nv) interpolated at places (n, 2) in cells, one column for each."""
    columns = [map_coordinates(grid, cells.T, order=1, mode="nearest") for grid in grids]
    return np.stack(columns, axis=1)


def _surface(outer: BoundaryMap, cells: Floats, cell_mm: float) -> tuple[Floats, Floats]:
    """Return points (n, 3) of the outer map and its outward normals (n, 3), in ``map``."""
    height, slope_u, slope_v = _at((outer.height_mm, *_slopes(outer.height_mm, cell_mm)), cells).T
    points = np.column_stack(
        (outer.u_mm[0] + cell_mm * cells[:, 0], outer.v_mm[0] + cell_mm * cells[:, 1], height)
    )
    normals = np.column_stack((-slope_u, -slope_v, np.ones(len(cells))))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def standoffs_mm(outer: BoundaryMap, Ts_base_probe: Poses) -> Floats:
    """Return how far along its axis each probe (n) is from the outer map; negative: pressed in.

    A leaning probe hardly hears the outer boundary; the first pass has shown where it is.
    """
    starts = outer.T_base_map.inv() @ Ts_base_probe.translations
    axes = outer.T_base_map.inv().rotate(Ts_base_probe.rotations[:, :, 2])
    cell_mm = float(outer.u_mm[1] - outer.u_mm[0])
    distance = np.zeros(len(starts))
    for _ in range(RAY_STEPS):  # the map is flat within the reach of a step: secant steps converge
        places = starts + distance[:, None] * axes
        cells = (places[:, :2] - (outer.u_mm[0], outer.v_mm[0])) / cell_mm
        distance += (_at((outer.height_mm,), cells)[:, 0] - places[:, 2]) / axes[:, 2]
    return distance
