"""Figures of steps 9 and 10: the maps, and the bone that a bed would leave."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import KDTree

from rona_core.app.dependencies.judge import fresh
from rona_core.app.steps.implant.view import floor_base
from rona_core.evaluation.truth import Figures, Truth, rms
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_core.mapping.map_grid import NEAR_MM
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.virtual.milling.left_bone import LeftBone

if TYPE_CHECKING:
    from rona_core.calibration.handheld.tracked_probe import SonoCalibration
    from rona_core.mapping.boundary_map import BoundaryMap, Maps
    from rona_core.session.document import Session, SonoMaps


def map_figures(maps: "Maps", truth: Truth) -> Figures:
    """Return the errors of the maps, absolute and for the same robot, and their coverage."""
    outer, inner = cells(maps.outer), cells(maps.inner)
    figures: Figures = {}
    for suffix, systematic in (("", False), ("_same_robot", True)):
        figures[f"outer{suffix}_rms_mm"] = rms(outer_errors_mm(outer, truth, systematic))
        figures[f"inner{suffix}_rms_mm"] = rms(inner_errors_mm(inner, truth, systematic))
    figures["outer_other_roll_rms_mm"] = other_roll_rms_mm(outer, truth)
    thickness = thickness_errors_mm(maps, truth)
    known = thickness[np.isfinite(thickness)]
    figures["thickness_bias_mm"] = float(known.mean()) if len(known) else None
    figures["thickness_rms_mm"] = rms(thickness)
    fused = fused_on_outercells(maps)
    figures["fused_outer_rms_mm"] = rms(outer_errors_mm(fused, truth, False))
    region = truth.region_points()
    figures["coverage_fraction"] = covered(maps.outer, region)
    figures["inner_coverage_fraction"] = covered(maps.inner, region)
    return figures


def one_pass_figures(maps: "Maps", n_first: int, truth: Truth) -> Figures:
    """Return the share of the region whose inner boundary the first ``n_first`` A-scans show."""
    T_map_base = maps.inner.T_base_map.inv()
    used = maps.inner_used[:n_first]
    samples = (T_map_base @ maps.inner_points_base[:n_first][used])[:, :2]
    region = (T_map_base @ truth.region_points())[:, :2]
    near = KDTree(samples).query(region)[0] <= NEAR_MM if len(samples) else np.zeros(len(region))
    return {"inner_coverage_one_pass_fraction": float(np.mean(near)) if len(region) else 0.0}


def sono_calibration_figures(calibration: "SonoCalibration", truth: Truth) -> Figures:
    """Return how far face and axis of the probe are from where they really are."""
    true, found = truth.scene.T_sonomarker_probe, calibration.T_sonomarker_probe
    axes = true.rotation[:, 2], found.rotation[:, 2]
    angle = np.arctan2(np.linalg.norm(np.cross(*axes)), axes[0] @ axes[1])
    off = np.linalg.norm(found.translation - true.translation)
    return {"sono_face_error_mm": float(off), "sono_axis_error_deg": float(np.rad2deg(angle))}


def sono_map_figures(result: "SonoMaps", truth: Truth) -> Figures:
    """Return the errors of the maps of a scan by hand, and their coverage.

    Without the robot they are in the frame of the base marker; then its true mounting brings them
    to ``base``, here alone.
    """
    maps = result.maps
    if result.frame == "basemarker":
        maps = maps.seen_from(truth.scene.T_base_basemarker)
    region = truth.region_points()
    return {
        "sono_outer_rms_mm": rms(outer_errors_mm(maps.outer.points_base(), truth, False)),
        "sono_inner_rms_mm": rms(inner_errors_mm(maps.inner.points_base(), truth, False)),
        "sono_thickness_rms_mm": rms(thickness_errors_mm(maps, truth)),
        "sono_coverage_fraction": covered(maps.outer, region),
        "sono_inner_coverage_fraction": covered(maps.inner, region),
    }


def outer_errors_mm(points_base: Floats, truth: Truth, systematic: bool) -> Floats:
    """Return the signed errors (n,) of mapped outer points, along the true outer normal.

    With ``systematic`` the robot is sent to the mapped points, and the places where it really
    arrives are compared: what remains when the same robot uses the map.
    """
    arrived = arrived_base(points_base, truth) if systematic else points_base
    return truth.signed_distance_mm(arrived)


def other_roll_rms_mm(points_base: Floats, truth: Truth) -> float | None:
    """Return the RMS error of outer points (n, 3) where the same robot comes with another roll.

    None where it cannot, or where nothing is known of the postures of the scan.
    """
    model = robot_model(truth.scene.settings.robot.model)
    turned = None if truth.postures is None else truth.postures.turned(model)
    if turned is None:
        return None
    systematic = truth.scene.robot_error.systematic_mm(points_base, turned.at(points_base))
    return rms(truth.signed_distance_mm(points_base + systematic))


def inner_errors_mm(points_base: Floats, truth: Truth, systematic: bool) -> Floats:
    """Return the signed errors (n,) of mapped inner points, along the true outer normal.

    Positive where the map has the inner boundary too far outside, infinite where the true bone has
    none.
    """
    arrived = arrived_base(points_base, truth) if systematic else points_base
    foot, normals = truth.foot(arrived)
    depth = ((foot - arrived) * normals).sum(axis=1)
    return truth.thickness_mm(foot, normals) - depth


def thickness_errors_mm(maps: "Maps", truth: Truth) -> Floats:
    """Return mapped minus true thickness (n,), both along the true outer normal.

    Each unflagged inner cell whose cell of the outer map is not flagged either counts; infinite
    where the error is not known. The line along the true normal through the inner point meets the
    outer map where that map's error, a smooth field of fractions of a millimetre, is interpolated.
    """
    both = maps.inner.ok & maps.outer.ok
    if not both.any():
        return np.zeros(0)
    outer_error = np.zeros(maps.outer.ok.shape)
    outer_error[maps.outer.ok] = truth.signed_distance_mm(cells(maps.outer))
    points = cells(maps.inner, both)
    foot, normals = truth.foot(points)
    depth = ((foot - points) * normals).sum(axis=1)
    above, found = _interpolated(maps.outer, outer_error, foot)
    errors = above + depth - truth.thickness_mm(foot, normals)
    return np.where(found, errors, np.inf)


def fused_on_outercells(maps: "Maps") -> Floats:
    """Return the fused map's points (n, 3) at those cells that the outer map vouches for."""
    points_base = cells(maps.outer)
    height, found = _interpolated(maps.fused, maps.fused.height_mm, points_base)
    points_map = maps.fused.T_base_map.inv() @ points_base
    points_map[:, 2] = height
    return maps.fused.T_base_map @ points_map[found]


def covered(boundary: "BoundaryMap", region_base: Floats) -> float:
    """Return the share of points (n, 3) of the requested region that lie in unflagged cells."""
    if not len(region_base):
        return 0.0
    where = boundary.T_base_map.inv() @ region_base
    i, in_u = _nearest(boundary.u_mm, where[:, 0])
    j, in_v = _nearest(boundary.v_mm, where[:, 1])
    return float(np.mean(in_u & in_v & boundary.ok[i, j]))


def arrived_base(points_base: Floats, truth: Truth) -> Floats:
    """Return where the robot that made the maps really arrives (n, 3) when it is sent to points."""
    qs_rad = None if truth.postures is None else truth.postures.at(points_base)
    return points_base + truth.scene.robot_error.systematic_mm(points_base, qs_rad)


def cells(boundary: "BoundaryMap", which: Bools | None = None) -> Floats:
    """Return the points (n, 3) of the unflagged cells, or of the cells named, in ``base``."""
    chosen = boundary.ok if which is None else which
    i, j = np.nonzero(chosen)
    points_map = np.column_stack((boundary.u_mm[i], boundary.v_mm[j], boundary.height_mm[i, j]))
    return boundary.T_base_map @ points_map


def _interpolated(
    boundary: "BoundaryMap", values: Floats, points_base: Floats
) -> tuple[Floats, Bools]:
    """Interpolate cell values bilinearly among unflagged corners; also where one was found."""
    axes, ok = (boundary.u_mm, boundary.v_mm), boundary.ok
    known = np.stack((np.where(ok, values, 0.0), ok), axis=-1)
    ends = np.array([(axis[0], axis[-1]) for axis in axes]).T
    points_map = boundary.T_base_map.inv() @ points_base
    inside = np.clip(points_map[:, :2], *ends)
    total, weight = RegularGridInterpolator(axes, known)(inside).T
    found = weight > 1e-9
    return np.where(found, total / np.maximum(weight, 1e-9), 0.0), found


def _nearest(axis_mm: Floats, values: Floats) -> tuple[Ints, Bools]:
    """Return the nearest index (n,) on a grid axis, and whether the value lies on the grid."""
    step = float(axis_mm[1] - axis_mm[0]) if len(axis_mm) > 1 else 1.0
    index = np.rint((values - axis_mm[0]) / step).astype(np.int64)
    inside = (index >= 0) & (index < len(axis_mm))
    return np.clip(index, 0, len(axis_mm) - 1), inside


def errors_of_maps(maps: "Maps", truth: Truth) -> MapErrors:
    """Return the signed errors of the maps over their grid, as a comparison has them."""
    found = cell_errors_mm(maps, truth)
    wanted = ("outer", "fused", "inner", "thickness")
    return MapErrors(
        {name: np.where(np.isfinite(found[name]), found[name], np.nan) for name in wanted}
    )


def cell_errors_mm(maps: "Maps", truth: Truth) -> dict[str, Floats]:
    """Return the signed errors of all maps over their grid (nu, nv), infinite where none is known.

    Keys are ``thickness``, and ``outer``, ``inner`` and ``fused``, absolute and, with the ending
    ``_same_robot``, for the same robot. All maps are on one grid.
    """
    errors: dict[str, Floats] = {}
    for suffix, systematic in (("", False), ("_same_robot", True)):
        for name, boundary, errors_mm in (
            ("outer", maps.outer, outer_errors_mm),
            ("fused", maps.fused, outer_errors_mm),
            ("inner", maps.inner, inner_errors_mm),
        ):
            found = errors_mm(cells(boundary), truth, systematic)
            errors[name + suffix] = _on_grid(boundary.ok, found)
    both = maps.inner.ok & maps.outer.ok
    errors["thickness"] = _on_grid(both, thickness_errors_mm(maps, truth))
    return errors


def _on_grid(which: Bools, values: Floats) -> Floats:
    """Return values (n,) in their cells, infinite elsewhere."""
    grid = np.full(which.shape, np.inf)
    grid[which] = values
    return grid


AROUND_MM = 2.0  # of the floor: where it leans, the nearest place of the boundary is beside it


def bed_figures(session: "Session", truth: Truth) -> Figures:
    """Return what is predicted of the bed, and the least bone that it would really leave."""
    held = fresh("bed", session)
    if held is None or held.placed is None:
        return {}
    placed = held.placed
    return {
        "bed_probability": placed.probability,
        "bed_residual_mm": placed.residual_mm,
        "bed_residual_true_mm": residual_mm(floor_base(held), truth),
    }


def residual_mm(floor_base: Floats, truth: Truth) -> float | None:
    """Return the shortest distance from any of places (n, 3) to the true inner boundary.

    The places are where the robot that made the maps arrives. Negative where the bed breaks
    through; None where the true bone has no inner boundary.
    """
    arrived = arrived_base(floor_base, truth)
    up = truth.foot(arrived)[1].mean(axis=0)
    up /= np.linalg.norm(up)
    x = np.linalg.svd(up[None])[2][1]
    rotation = np.column_stack((x, np.cross(up, x), up))
    T_base_bed = Pose(rotation, arrived.mean(axis=0))
    places = T_base_bed.inv() @ arrived
    reach_mm = float(np.abs(places[:, :2]).max()) + AROUND_MM
    T_skull_bed = truth.T_base_skull.inv() @ T_base_bed
    bone = LeftBone(truth.scene.specimen, T_skull_bed, reach_mm)
    least = float(bone.distances_to_inner_mm(places, np.zeros(len(places))).min())
    return least if np.isfinite(least) else None
