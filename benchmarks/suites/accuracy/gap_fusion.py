"""Fusion with the pointer's cloud, where ultrasound is and in a gap that is cut into it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.maps.inputs import CLOUD_PRIOR
from rona_core.evaluation.map_metrics import cells as cells_of
from rona_core.evaluation.map_metrics import outer_errors_mm
from rona_core.evaluation.navigation_metrics import tip_errors
from rona_core.evaluation.truth import Truth, rms
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.rigid_fit import register_points
from rona_core.mapping.boundary_map import BoundaryMap, CloudFit, Maps
from rona_core.mapping.cloud_fusion import CloudPrior, fuse_cloud, thinned
from rona_core.mapping.fitting.plate_field import PlateField, fit_field
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.session.document import Session

GAP_MM = 18.0  # diameter
LEAST_CELLS = 50  # of a gap that are judged
KNOWN_MOTION = CloudPrior(shift_mm=1e-6, turn_rad=1e-8)  # of a cloud that is where it belongs


@dataclass(frozen=True, slots=True)
class FusionFigures:
    """RMS errors of the outer boundary for the same robot, in mm; None where nothing is known."""

    covered: dict[str, float | None]  # by "alone", "fused", "union", "true motion", "exact points"
    gap: dict[str, float | None]
    slide_mm: float | None  # of the corrected cloud along the bone, RMS of both axes
    slide_uncorrected_mm: float | None
    slide_stated_mm: float | None  # one standard deviation, RMS of both axes
    slide_ratio: float | None  # mean of (slide / stated)^2 of both axes


@dataclass(frozen=True, slots=True, eq=False)
class _Clouds:
    """The cloud (n, 3) as it was measured, with its true rigid motion, and as it really is.

    The latter two are None where the truth is not known.
    """

    measured: Floats
    moved: Floats | None
    exact: Floats | None


def fusion_figures(session: Session, truth: Truth) -> FusionFigures | None:
    """Return how well ultrasound alone, fusion and plain union do; None without maps or cloud.

    The union is that of the paper: points of the pointer as they are, beside those of the
    ultrasound, one surface through both. Two are what no session can know, for comparison: the
    cloud moved as it truly has to be, and each of its points where it truly was touched.
    """
    made, surface = session.results.maps, session.results.surface
    if made is None or surface is None:
        return None
    maps: Maps = made.value
    if maps.cloud_fit is None:
        return None
    T_map_base = maps.outer.T_base_map.inv()
    samples = (T_map_base @ maps.outer_points_base)[maps.outer_used]
    points, touched = surface.value.points_base, _touched(session, truth)
    clouds = _Clouds(T_map_base @ points, None, None)
    if touched is not None:
        moved = register_points(points, touched).T_b_a @ points
        clouds = replace(clouds, moved=T_map_base @ moved, exact=T_map_base @ touched)
    prior = required(CLOUD_PRIOR, session)
    whole = _plates(samples, clouds, prior)
    middle = samples[:, :2].mean(axis=0)
    outside = np.linalg.norm(samples[:, :2] - middle, axis=1) > GAP_MM / 2.0
    cut = _plates(samples[outside], clouds, prior)
    places = _places(maps.outer)
    there = maps.outer.ok
    inside = np.linalg.norm(places - middle, axis=1) < GAP_MM / 2.0
    far = KDTree(samples[outside, :2]).query(places)[0] > NEAR_MM
    gap = (inside & far).reshape(there.shape) & there

    def error_mm(plate: PlateField | None, cells: Bools) -> float | None:
        if plate is None or np.count_nonzero(cells) < LEAST_CELLS:
            return None
        heights = plate.heights(places).reshape(there.shape)
        drawn = cells_of(replace(maps.fused, height_mm=heights), cells)
        return rms(outer_errors_mm(drawn, truth, True))

    slide, uncorrected, stated, ratio = _slide(session, touched, maps.cloud_fit)
    return FusionFigures(
        covered={how: error_mm(plate, there) for how, plate in whole.items()},
        gap={how: error_mm(plate, gap) for how, plate in cut.items()},
        slide_mm=slide,
        slide_uncorrected_mm=uncorrected,
        slide_stated_mm=stated,
        slide_ratio=ratio,
    )


def _plates(samples: Floats, clouds: _Clouds, prior: CloudPrior) -> dict[str, PlateField | None]:
    """Return the plates that are compared, in ``map``."""
    alone = fit_field(samples[:, :2], samples[:, 2])
    both = np.vstack((samples, thinned(clouds.measured, alone.grid.step_mm)))

    def fused(cloud: Floats | None, prior: CloudPrior) -> PlateField | None:
        found = None if cloud is None else fuse_cloud(cloud, alone, NEAR_MM, prior)
        return None if found is None else found.plate

    return {
        "alone": alone,
        "fused": fused(clouds.measured, prior),
        "union": fit_field(both[:, :2], both[:, 2]),
        "true motion": fused(clouds.moved, KNOWN_MOTION),
        "exact points": fused(clouds.exact, KNOWN_MOTION),
    }


def _touched(session: Session, truth: Truth) -> Floats | None:
    """Return where the robot has to be sent (n, 3), in ``base``, to meet the places touched."""
    surface = session.results.surface
    if surface is None or truth.postures is None:
        return None
    points = surface.value.points_base
    errors = tip_errors(surface.value, session.captures.surface, truth)
    if len(errors) != len(points):
        return None
    touched = points - errors
    return touched - truth.scene.robot_error.systematic_mm(touched, truth.postures.at(touched))


def _slide(
    session: Session, touched: Floats | None, fit: CloudFit
) -> tuple[float | None, float | None, float | None, float | None]:
    """Return by how much the cloud lies off along the bone for the same robot, in mm.

    With and without its correction, as it is stated, and the squared ratio to that.
    """
    surface, maps = session.results.surface, session.results.maps
    if surface is None or maps is None or fit.covariance is None or touched is None:
        return None, None, None, None
    points = surface.value.points_base
    to_map = maps.value.outer.T_base_map.rotation.T
    places = _map_places(maps.value, points)
    over = KDTree(_map_places(maps.value, maps.value.outer_points_base)).query(places)[0] <= NEAR_MM

    def off(moved: Floats) -> Floats:
        return (to_map @ (moved - touched)[over].mean(axis=0))[:2]

    after, before = off(fit.correction @ points), off(points)
    stated = np.sqrt(np.diag(fit.covariance))[:2]
    return rms(after), rms(before), rms(stated), float(np.mean((after / stated) ** 2))


def _map_places(maps: Maps, points_base: Floats) -> Floats:
    return (maps.outer.T_base_map.inv() @ points_base)[:, :2]


def _places(boundary: BoundaryMap) -> Floats:
    """Return the places (nu nv, 2) of all cells."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.column_stack((u.ravel(), v.ravel()))
