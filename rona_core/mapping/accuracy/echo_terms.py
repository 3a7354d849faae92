"""What echoes add to the errors of a map: time of flight, what lies between, silent A-scans."""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.error_terms import HIDDEN_ALIKE, ErrorTerm
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.fitting.plate_field import ROUGHNESS_MM, PlateField
from rona_core.ultrasound.probe.beam import LEAST_LEVEL, rms_roughness_mm
from rona_core.ultrasound.probe.probe_model import ProbeModel

INTERPOLATION = "interpolation"
ROWS = "scan closer rows, or with the probe tilted"
NEAREST = 6  # A-scans whose time of flight and level count at a cell
ROUGHNESS = "roughness within the beam"
PLACES = 24  # evenly over a face, at which a plate is looked at
DRAWS = 16  # of a plate, which tell how much rougher the bone is than its map
AT_ONCE = 4000  # cells, all of whose draws take 15 MB
NO_INNER_ECHO = "no inner echo"
NO_ECHO_MM = 0.45  # where no place around has an echo, both parts together
NO_FRONT_ECHO = "no front echo"
NO_FRONT_MM = 0.3  # the same of the outer boundary
NO_ECHO_REACH_MM = 2.0  # places this far away count as around, and errors hang together


def sampling_terms(
    boundary: BoundaryMap,
    samples: PlateField | None,
    surface: PlateField | None,
    sigma_mm: Floats,
    face_mm: float,
) -> tuple[ErrorTerm, ErrorTerm]:
    """Return what time of flight and interpolation add to each cell.

    A-scans less than the width of a face apart hear the same bone and err alike, so that the mean
    over a map is off by what is left after averaging over as many patches as it has.

    Args:
        boundary: Its grid is meant.
        samples: Plate through the samples (n); None where there are none.
        surface: The plate that the map is made of, as sure as it is between them.
        sigma_mm: Of the time of flight of each sample (n,).
        face_mm: Width of the probe's face.
    """
    shape = boundary.height_mm.shape
    if samples is None or surface is None:
        return ErrorTerm("time of flight"), ErrorTerm(INTERPOLATION, np.full(shape, np.inf))
    places = cells_map(boundary)[:, :2]
    timing = _rms_around(samples, sigma_mm, places)
    # two estimates of one deviation: what the samples state here, and how all of them scatter
    timing = 0.5 * (timing + samples.scatter_mm).reshape(shape)
    apart = surface.sigmas_mm(places).reshape(shape)
    return (
        ErrorTerm(
            "time of flight",
            timing,
            mean_error_mm(timing, boundary, face_mm),
            reach_mm=face_mm / 2.0,
        ),
        ErrorTerm(
            INTERPOLATION,
            apart,
            mean_error_mm(apart, boundary, face_mm),
            remedy=ROWS,
            reach_mm=face_mm / 2.0,
        ),
    )


def roughness_term(
    boundary: BoundaryMap, surface: PlateField, levels: Floats, probe: ProbeModel
) -> ErrorTerm:
    """Return what cells add since an A-scan hears all the bone below its face, not one place.

    How much of it there is in the whole follows from the map, and where it is from front echoes,
    which are the lower the rougher the bone is below the face.

    Args:
        boundary: Its grid is meant.
        surface: The plate that the map is made of, through samples (n).
        levels: Amplitudes of their front echoes (n,) over that of perfect contact. The highest
            stands for smooth bone, so that how hard it is drops out as long as none is clipped.
        probe: That took them.
    """
    cells, ok = cells_map(boundary)[:, :2], boundary.ok.ravel()
    ok = ok if ok.any() else np.ones_like(ok)
    mapped = _departure_mm(surface, cells, 2.0 * probe.aperture_radius_mm)
    whole_mm = np.sqrt(np.mean(np.maximum(mapped, ROUGHNESS_MM)[ok] ** 2))
    seen = rms_roughness_mm(probe, levels / max(float(levels.max()), LEAST_LEVEL))
    around = _rms_around(surface, np.hypot(seen, ROUGHNESS_MM), cells)
    share = around / np.sqrt(np.mean(around[ok] ** 2))
    return ErrorTerm(ROUGHNESS, (whole_mm * share).reshape(boundary.height_mm.shape))


def _departure_mm(surface: PlateField, cells: Floats, face_mm: float) -> Floats:
    """Return the RMS (m,) by which bone departs from a plane within a face at cells (m, 2).

    Less the dome of the whole. Bone that is rough where it is seen is no less so elsewhere, and
    none is as smooth as its map: its variance is that of the map, its mean, and of draws about it.
    """
    order = np.arange(PLACES)
    radii = face_mm / 2.0 * np.sqrt((order + 0.5) / PLACES)
    turns = order * np.pi * (3.0 - np.sqrt(5.0))  # as the seeds of a sunflower lie
    face = np.column_stack((radii * np.cos(turns), radii * np.sin(turns)))
    plane = np.linalg.qr(np.column_stack((np.ones(PLACES), face)))[0]
    found = []
    for start in range(0, len(cells), AT_ONCE):
        places = (face[:, None] + cells[start : start + AT_ONCE]).reshape(-1, 2)
        drawn = surface.drawn_errors(places, DRAWS, np.random.default_rng(0))
        over = np.vstack((surface.departures(places), drawn)).reshape(1 + DRAWS, PLACES, -1)
        squares = np.sum(over**2, axis=1) - np.sum((plane.T @ over) ** 2, axis=1)
        found.append((squares[0] + squares[1:].mean(axis=0)) / PLACES)
    return np.sqrt(np.maximum(np.concatenate(found), 0.0))


def _rms_around(samples: PlateField, values_mm: Floats, cells: Floats) -> Floats:
    """Return the RMS (m,) of values of the samples (n,) nearest to each cell (m, 2)."""
    near = KDTree(samples.places_mm).query(cells, k=min(NEAREST, len(values_mm)))[1]
    return np.sqrt(np.mean(values_mm[near.reshape(len(cells), -1)] ** 2, axis=1))


def no_echo_term(maps: Maps, T_map_base: Pose) -> ErrorTerm:
    """Return the error added in cells without inner echoes around them.

    An echo misses the probe where the inner table leans, and the map goes on from bone with an
    echo. It goes wrong the more of the places around have none: too thick where
    grooves are, too thin where crests are.
    """
    if not maps.inner_used.any():
        return ErrorTerm(NO_INNER_ECHO)
    places = (T_map_base @ maps.outer_points_base)[:, :2]
    off_mm = NO_ECHO_MM * _silent_share(maps.inner, places, maps.inner_used)
    return ErrorTerm(
        NO_INNER_ECHO,
        np.sqrt(1.0 - HIDDEN_ALIKE**2) * off_mm,
        HIDDEN_ALIKE * off_mm,
        remedy=ROWS,
        reach_mm=NO_ECHO_REACH_MM,
        hidden=True,
    )


def no_front_echo_term(maps: Maps, T_map_base: Pose, count: int) -> ErrorTerm:
    """Return the error added in cells without front echoes around them.

    None comes back from a steep edge or a groove, or one that disagrees with all around, and the
    map goes on over it.

    Args:
        maps: With the points of all A-scans.
        T_map_base: Their frame.
        count: Of A-scans in the first pass, which the outer map is made of.
    """
    places = (T_map_base @ maps.outer_points_base[:count])[:, :2]
    off_mm = NO_FRONT_MM * _silent_share(maps.outer, places, maps.outer_used[:count])
    return ErrorTerm(NO_FRONT_ECHO, off_mm, remedy=ROWS, reach_mm=NO_ECHO_REACH_MM)


def _silent_share(boundary: BoundaryMap, places: Floats, found: Bools) -> Floats:
    """Return the share (nu, nv) of scanned places around each cell without an echo.

    Args:
        boundary: Its grid is meant.
        places: Of A-scans (n, 2) in ``map``.
        found: Which of them (n,) have an echo of the boundary.
    """
    cell_mm, shape = _cell_mm(boundary), boundary.ok.shape
    if found.all():
        return np.zeros(shape)
    cells = np.rint((places - (boundary.u_mm[0], boundary.v_mm[0])) / cell_mm).astype(np.int64)
    cells = np.clip(cells, 0, np.array(shape) - 1)
    scanned, silent = np.zeros(shape), np.zeros(shape)
    scanned[tuple(cells.T)] = silent[tuple(cells.T)] = 1.0
    silent[tuple(cells[found].T)] = 0.0
    around, silent_around = (
        gaussian_filter(marked, NO_ECHO_REACH_MM / cell_mm, mode="constant")
        for marked in (scanned, silent)
    )
    return np.divide(silent_around, around, out=np.ones(shape), where=around > 0.0)


def mean_error_mm(own_mm: Floats, boundary: BoundaryMap, face_mm: float) -> float:
    """Return what the mean over a map is off by when each cell is off by ``own_mm`` (nu, nv)."""
    if not boundary.ok.any() or min(boundary.ok.shape) < 2:
        return 0.0
    cell_mm2 = (boundary.u_mm[1] - boundary.u_mm[0]) * (boundary.v_mm[1] - boundary.v_mm[0])
    reach_mm = face_mm / 2.0
    patches = boundary.ok.sum() * cell_mm2 / (2.0 * np.pi * reach_mm**2)  # a Gaussian's area
    return float(np.sqrt(np.mean(own_mm[boundary.ok] ** 2) / max(patches, 1.0)))


def _cell_mm(boundary: BoundaryMap) -> float:
    """Return how wide a cell is; a map may be a strip of one cell."""
    along_mm = max(boundary.u_mm, boundary.v_mm, key=len)
    return float(along_mm[1] - along_mm[0]) if len(along_mm) > 1 else 1.0


def cells_map(boundary: BoundaryMap) -> Floats:
    """Return all cells as points (nu nv, 3) in ``map``."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.column_stack((u.ravel(), v.ravel(), boundary.height_mm.ravel()))
