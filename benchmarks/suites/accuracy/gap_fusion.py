"""Fusion with the pointer's cloud, where ultrasound is and in a gap that is cut into it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.steps.maps.accuracy.probe_place import cloud_prior
from rona_core.evaluation.figures import rms
from rona_core.evaluation.maps.map_metrics import cells as cells_of
from rona_core.evaluation.maps.map_metrics import outer_errors_mm
from rona_core.evaluation.navigation_metrics import tip_errors
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import BoundaryMap, CloudFit, Maps
from rona_core.mapping.cloud_fusion import CloudPrior, fuse_cloud, thinned
from rona_core.mapping.fitting.plate_field import PlateField, fit_field
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.session.document import Session

GAP_MM = 18.0  # diameter
LEAST_CELLS = 50  # of a gap that are judged


@dataclass(frozen=True, slots=True)
class FusionFigures:
    """RMS errors of the outer boundary for the same robot, in mm; None where nothing is known."""

    covered: dict[str, float | None]  # by "alone", "fused" and "union"
    gap: dict[str, float | None]
    slide_mm: float | None  # of the corrected cloud along the bone, RMS of both axes
    slide_uncorrected_mm: float | None
    slide_ratio: float | None  # mean of (slide / stated)^2 of both axes


def fusion_figures(session: Session, truth: Truth) -> FusionFigures | None:
    """Return how well ultrasound alone, fusion and plain union do; None without maps or cloud.

    The union is that of the paper: points of the pointer as they are, beside those of the
    ultrasound, one surface through both.
    """
    made, surface = session.results.maps, session.results.surface
    if made is None or surface is None:
        return None
    maps: Maps = made.value
    if maps.cloud_fit is None:
        return None
    T_map_base = maps.outer.T_base_map.inv()
    samples = (T_map_base @ maps.outer_points_base)[maps.outer_used]
    cloud = T_map_base @ surface.value.points_base
    prior = cloud_prior(session)
    whole = _three(samples, cloud, prior)
    middle = samples[:, :2].mean(axis=0)
    outside = np.linalg.norm(samples[:, :2] - middle, axis=1) > GAP_MM / 2.0
    cut = _three(samples[outside], cloud, prior)
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

    slide, uncorrected, ratio = _slide(session, truth, maps.cloud_fit)
    return FusionFigures(
        covered={how: error_mm(plate, there) for how, plate in whole.items()},
        gap={how: error_mm(plate, gap) for how, plate in cut.items()},
        slide_mm=slide,
        slide_uncorrected_mm=uncorrected,
        slide_ratio=ratio,
    )


def _three(samples: Floats, cloud: Floats, prior: CloudPrior) -> dict[str, PlateField | None]:
    """Return the plates of ultrasound alone, of the fusion, and of the plain union, in ``map``."""
    alone = fit_field(samples[:, :2], samples[:, 2])
    fused = fuse_cloud(cloud, alone, NEAR_MM, prior)
    both = np.vstack((samples, thinned(cloud, alone.grid.step_mm)))
    return {
        "alone": alone,
        "fused": None if fused is None else fused.plate,
        "union": fit_field(both[:, :2], both[:, 2]),
    }


def _slide(
    session: Session, truth: Truth, fit: CloudFit
) -> tuple[float | None, float | None, float | None]:
    """Return by how much the cloud lies off along the bone, with and without its correction.

    For the same robot: where it would arrive if it were sent to a point, against the touched place.
    """
    surface, maps = session.results.surface, session.results.maps
    if surface is None or maps is None or fit.covariance is None or truth.postures is None:
        return None, None, None
    points = surface.value.points_base
    errors = tip_errors(surface.value, session.captures.surface, truth)
    if len(errors) != len(points):
        return None, None, None
    touched = points - errors
    arrive = truth.scene.robot_error.systematic_mm(touched, truth.postures.at(touched))
    to_map = maps.value.outer.T_base_map.rotation.T
    places = _map_places(maps.value, points)
    over = KDTree(_map_places(maps.value, maps.value.outer_points_base)).query(places)[0] <= NEAR_MM

    def off(moved: Floats) -> Floats:
        return (to_map @ (moved + arrive - touched)[over].mean(axis=0))[:2]

    after, before = off(fit.correction @ points), off(points)
    stated = np.sqrt(np.diag(fit.covariance))[:2]
    return rms(after), rms(before), float(np.mean((after / stated) ** 2))


def _map_places(maps: Maps, points_base: Floats) -> Floats:
    return (maps.outer.T_base_map.inv() @ points_base)[:, :2]


def _places(boundary: BoundaryMap) -> Floats:
    """Return the places (nu nv, 2) of all cells."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.column_stack((u.ravel(), v.ravel()))
