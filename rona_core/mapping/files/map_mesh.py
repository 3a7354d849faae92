"""Triangle meshes of the maps: each boundary, and the closed plate of bone between two of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.files.map_sheet import BoundaryName, MapSheet

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class MapMesh:
    """Triangles with values at their corners; wound so that normals point out of the bone."""

    points_base: Floats  # (n, 3)
    triangles: Indices  # (m, 3) rows of points
    values: dict[str, Floats]  # (n,) by name, NaN where not known


def boundary_mesh(sheet: MapSheet, name: BoundaryName) -> MapMesh:
    """Return the mesh of one boundary: all its triangles whose three cells are ok.

    The inner boundary is seen from outside too: its normals point to the outer one.

    Raises:
        DegenerateGeometryError: no three neighbouring cells are ok.
    """
    triangles = cell_triangles(sheet.boundary(name).ok)
    used, rows = _renumbered(triangles)
    return MapMesh(sheet.points_base(name).reshape(-1, 3)[used], rows, _values(sheet, name, used))


def plate_mesh(sheet: MapSheet) -> MapMesh:
    """Return the closed mesh of the bone between the outer and the inner boundary.

    Its values at a corner are those of the boundary that the corner belongs to.

    Raises:
        DegenerateGeometryError: no three neighbouring cells have both boundaries.
    """
    triangles = plate_triangles(sheet)
    used, top = _renumbered(triangles)
    n = len(used)
    rim = rim_edges(top)
    a, b = rim[:, 0], rim[:, 1]
    walls = np.vstack((np.column_stack((b, a, a + n)), np.column_stack((b, a + n, b + n))))
    of_outer, of_inner = (_values(sheet, name, used) for name in ("outer", "inner"))
    return MapMesh(
        np.vstack([sheet.points_base(name).reshape(-1, 3)[used] for name in ("outer", "inner")]),
        np.vstack((top, top[:, ::-1] + n, walls)),
        {key: np.concatenate((of_outer[key], of_inner[key])) for key in of_outer},
    )


def cell_triangles(ok: Bools) -> Indices:
    """Return the triangles (m, 3) between ok cells (nu, nv), counter-clockwise from outside.

    Cells are numbered row by row. Each square of four has the diagonal from low to high u and v.

    Raises:
        DegenerateGeometryError: no three neighbouring cells are ok.
    """
    number = np.arange(ok.size).reshape(ok.shape)
    low, right = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    high, left = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    both = np.vstack((np.column_stack((low, right, high)), np.column_stack((low, high, left))))
    triangles = both[ok.ravel()[both].all(axis=1)]
    if not len(triangles):
        raise DegenerateGeometryError(
            f"{np.count_nonzero(ok)} cells are mapped, and no three of them lie side by side: "
            "scan an area (step 8) or map with smaller cells (step 9)"
        )
    return triangles


def plate_triangles(sheet: MapSheet) -> Indices:
    """Return the triangles (m, 3) between cells that have both boundaries, fit to be closed.

    Raises:
        DegenerateGeometryError: no three neighbouring cells have both boundaries.
    """
    return closable_triangles(sheet.thickness_ok())


def closable_triangles(ok: Bools) -> Indices:
    """Return the triangles (m, 3) between ok cells (nu, nv) that a wall can be set round.

    Where parts touch in one cell alone, the smaller ones lose their triangles there: a wall round
    them would have an edge with four faces, and no program would take the plate for a body.

    Raises:
        DegenerateGeometryError: no three neighbouring cells are ok.
    """
    triangles = cell_triangles(ok)
    while True:
        fans = _fans(triangles)
        cells, n_of_fan = triangles.ravel(), np.bincount(fans)
        order = np.lexsort((fans, -n_of_fan[fans], cells))  # the largest fan of a cell first
        first = order[np.unique(cells[order], return_index=True)[1]]
        largest = np.zeros(cells.max() + 1, dtype=np.int64)
        largest[cells[first]] = fans[first]
        kept = (fans == largest[cells]).reshape(-1, 3).all(axis=1)
        if kept.all():
            return triangles
        triangles = triangles[kept]


def _fans(triangles: Indices) -> Indices:
    """Return for each corner (3 m,) its fan: corners at one cell that share edges of triangles."""
    corner = np.arange(3 * len(triangles)).reshape(-1, 3)
    starts, ends = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    cells = triangles.ravel()
    edges = np.sort(np.column_stack((cells[starts], cells[ends])), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    one, other = order[:-1][same], order[1:][same]  # two sides of an edge run opposite ways
    links = np.concatenate((starts[one], ends[one])), np.concatenate((ends[other], starts[other]))
    graph = coo_array((np.ones(len(links[0])), links), shape=(corner.size, corner.size))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def rim_edges(triangles: Indices) -> Indices:
    """Return the edges (k, 2) that only one of the triangles (m, 3) has, as they run in it."""
    edges = np.vstack([triangles[:, (i, (i + 1) % 3)] for i in range(3)])
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    return edges[first[count == 1]]


def _renumbered(triangles: Indices) -> tuple[Indices, Indices]:
    """Return the cells that triangles use, and the triangles by their rows in these."""
    used, rows = np.unique(triangles, return_inverse=True)
    return used, rows.reshape(triangles.shape)


def _values(sheet: MapSheet, name: BoundaryName, used: Indices) -> dict[str, Floats]:
    own, bone = sheet.sigma_mm(name), sheet.sigma_mm("thickness")
    values = {
        "thickness_mm": sheet.thickness_mm(),
        "sigma_mm": own["total"],
        "sigma_own_mm": own["own"],
        "sigma_common_mm": own["common"],
        "thickness_sigma_mm": bone["total"],
    }
    return {key: value.ravel()[used] for key, value in values.items()}
