"""Second pass over the gaps of the inner map, the probe tilted towards the inner table.

The inner table is rarely parallel to the outer one; leaning by more than two degrees or so its echo
misses the probe. Where the map around a gap says how the thickness changes, the probe can be leant
so that its sound meets the inner table squarely. See docs/algorithms/maps/second_pass.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import (
    binary_closing,
    binary_dilation,
    gaussian_filter,
    gaussian_filter1d,
    label,
    map_coordinates,
)

from rona_core.devices.limits import number, require, require_limits
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.led_rows import lead_rows
from rona_core.path.scan_patterns import Inside
from rona_core.ultrasound.probe.materials import GEL

LEAST_CELLS = 6  # a smaller gap is left to the smooth map
JOINED_CELLS = 2  # gaps this close are scanned as one
WIDENED_MM = 2.0  # around a gap that is scanned, too: there the map continues what it saw beside it
SLOPE_BLUR_MM = 1.5  # of the thickness, before its slope is taken
LEAN_BLUR_MM = 3.0  # of the lean along the path, so that the wrist turns evenly
STEP_MM = 0.5
RAY_STEPS = 8
# Offsets of the lean from row to row: what the map says of a gap is a guess, so that neighbouring
# rows look around it.
FAN = ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


@dataclass(frozen=True, slots=True)
class SecondPassSettings:
    """How the gaps of the inner map are scanned again."""

    spacing_mm: float = number(
        2.0, "Row spacing", "mm", 0.5, 5.0, 0.5, hint="Distance between two rows of the second pass"
    )
    fan: float = number(
        0.10, "Slope spread", "", 0.0, 0.5, 0.05, hint="Of the inner table, between rows (mm/mm)"
    )
    largest_lean_deg: float = number(
        6.0, "Max. tilt", "deg", 0.5, 15.0, 0.5, hint="Above about 6° the probe face loses contact"
    )

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True, eq=False)
class SecondPassPath:
    """Where to scan again, and how far the probe leans there."""

    path: Path5D
    lean_deg: Floats  # (n,) of the probe axis from the normal of the outer map
    gap_cells: int  # cells of the outer map without an inner boundary that are scanned again
    gap_share: float  # of all cells of the outer map, small gaps included


def plan_second_pass(
    maps: Maps,
    sound_speed_mm_per_us: float,
    settings: SecondPassSettings | None = None,
    allowed: Inside | None = None,
) -> SecondPassPath | None:
    """Return a path over the gaps of the inner map with a leaning probe; None without a gap.

    Args:
        maps: Of the first pass.
        sound_speed_mm_per_us: Of bone, as the maps were made with: sound bends at the outer
            boundary, so that the probe leans by less than the inner table does.
        settings: Rows, fan and largest lean.
        allowed: Which places (k, 2) in the plane of the maps may be scanned; None: all.
    """
    settings = settings or SecondPassSettings()
    gaps = maps.outer.ok & ~maps.inner.ok
    cell_mm = float(maps.outer.u_mm[1] - maps.outer.u_mm[0])
    wide = _widened(gaps, round(WIDENED_MM / cell_mm)) & maps.outer.ok
    rows = _rows(wide, max(1, round(settings.spacing_mm / cell_mm)))
    if allowed is not None:
        corner = np.array((maps.outer.u_mm[0], maps.outer.v_mm[0]))
        rows = lead_rows(rows, lambda cells: allowed(corner + cell_mm * cells), wide.shape)
    return path_along(maps, rows, sound_speed_mm_per_us, settings) if rows else None


def plan_along(
    maps: Maps,
    rows_mm: ArrayLike,
    sound_speed_mm_per_us: float,
    settings: SecondPassSettings | None = None,
) -> SecondPassPath:
    """Return a path along given lines over the outer map, with a leaning probe.

    Args:
        maps: Of all passes so far.
        rows_mm: Start and end of each (n, 2, 2) in the plane of the map, in the order of scanning.
        sound_speed_mm_per_us: Of bone, see ``plan_second_pass``.
        settings: Fan and largest lean.

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
    return path_along(maps, rows, sound_speed_mm_per_us, settings or SecondPassSettings())


def path_along(
    maps: Maps,
    rows: list[tuple[Floats, Floats]],
    sound_speed_mm_per_us: float,
    settings: SecondPassSettings,
) -> SecondPassPath:
    """Return the path along rows over the outer map, the probe leaning towards the inner table.

    Args:
        maps: Of the first pass.
        rows: Start and end (2,) of each in cells of the map, in the order of scanning.
        sound_speed_mm_per_us: Of bone, see ``plan_second_pass``.
        settings: Fan and largest lean.
    """
    gaps = maps.outer.ok & ~maps.inner.ok
    share = float(gaps.sum() / max(int(maps.outer.ok.sum()), 1))
    cell_mm = float(maps.outer.u_mm[1] - maps.outer.u_mm[0])
    cells, numbers = _walk(rows, STEP_MM / cell_mm)
    slopes = _at(_slopes(maps.thickness_mm(), cell_mm), cells)
    slopes = slopes + settings.fan * np.array(FAN)[numbers % len(FAN)]
    leans = slopes * GEL.speed_mm_per_us / sound_speed_mm_per_us
    leans = gaussian_filter1d(leans, LEAN_BLUR_MM / STEP_MM, axis=0, mode="nearest")
    size = np.linalg.norm(leans, axis=1, keepdims=True)
    most = np.tan(np.deg2rad(settings.largest_lean_deg))
    leans *= np.minimum(1.0, most / np.maximum(size, 1e-12))
    points_map, normals_map = _surface(maps.outer, cells, cell_mm)
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


def _widened(gaps: Bools, cells: int) -> Bools:
    """Return the gaps of enough cells, those that lie together as one, and what is around them."""
    labels = _groups(gaps)
    sizes = np.bincount(labels[gaps], minlength=int(labels.max()) + 1)
    kept: Bools = gaps & (sizes >= LEAST_CELLS)[labels]
    return np.asarray(binary_dilation(kept, iterations=cells), np.bool_) if cells else kept


def _groups(mask: Bools) -> Ints:
    """Return the number from 1 of the group of each cell, those between near ones included."""
    # a closing next to the border of the grid needs room around it
    room = JOINED_CELLS + 1
    closed = binary_closing(np.pad(mask, room), iterations=JOINED_CELLS)[room:-room, room:-room]
    labels = np.zeros(mask.shape, dtype=np.int64)
    label(closed, structure=np.ones((3, 3)), output=labels)
    return labels


def _rows(mask: Bools, every: int) -> list[tuple[Floats, Floats]]:
    """Return start and end (2,) in cells of each row over cells, in the order of scanning.

    Those that lie together are scanned to and fro, one group after the other.
    """
    labels = _groups(mask)
    groups: list[Ints] = [np.argwhere(labels == k + 1) for k in range(int(labels.max()))]
    rows: list[tuple[Floats, Floats]] = []
    end = np.zeros(2)
    while groups:
        nearest = min(range(len(groups)), key=lambda k: _distance(groups[k], end))
        rows += _to_and_fro(groups.pop(nearest), every, end)
        end = rows[-1][1]
    return rows


def _distance(group: Ints, place: Floats) -> float:
    return float(np.linalg.norm(group - place, axis=1).min())


def _to_and_fro(group: Ints, every: int, start: Floats) -> list[tuple[Floats, Floats]]:
    """Return rows along the longer side of a group of cells (n, 2), from the side at ``start``."""
    extent = np.ptp(group, axis=0)
    along = int(np.argmax(extent))
    across = 1 - along
    levels = np.arange(group[:, across].min(), group[:, across].max() + 1, every)
    if abs(levels[-1] - start[across]) < abs(levels[0] - start[across]):
        levels = levels[::-1]
    rows, forward = [], True
    for level in levels:
        places = group[group[:, across] == level, along]
        if not len(places):
            continue
        ends = np.zeros((2, 2))
        ends[:, across] = level
        ends[:, along] = places.min(), places.max()
        rows.append((ends[0], ends[1]) if forward else (ends[1], ends[0]))
        forward = not forward
    return rows


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
