"""Maps of both boundaries from A-scans with their poses, fused with the pointer cloud."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError, DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_points, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.mapping.boundary_map import BoundaryMap, CloudFit, Maps
from rona_core.mapping.cloud_fusion import CloudPrior, fuse_cloud
from rona_core.mapping.fitting.hampel_filter import agreeing
from rona_core.mapping.fitting.plate_field import PlateField, fit_field, plate_through
from rona_core.mapping.map_grid import NEAR_MM, MapGrid
from rona_core.mapping.pass_fusion import PassFusion, counting, fuse_passes
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.probe.beam import probe_beam
from rona_core.ultrasound.probe.materials import GEL
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model

LEAST_SHARE = 0.45  # of A-scans, that show an outer boundary
LEAST_WIDTH_MM = 7.5  # of an even strip that reaches as far across
STRIP_OVER_RMS = 12.0**0.5  # width of an even strip over the RMS distance from its middle


def require_share(used: Bools) -> None:
    """Refuse a map that most of its A-scans (n,) tell nothing of.

    Raises:
        DegenerateGeometryError: too few of them show an outer boundary that others agree with.
    """
    if np.mean(used) < LEAST_SHARE:
        raise DegenerateGeometryError(
            f"only {np.count_nonzero(used)} of {len(used)} A-scans show an outer boundary that "
            f"agrees with those around it, a map takes {100 * LEAST_SHARE:.0f} %: was the probe "
            "in contact, and is the bone smooth there, without a steep edge?"
        )


def require_area(points: Floats, axes: Floats) -> None:
    """Refuse points that lie in a strip of a row or two.

    A row over a dome lies in a plane of its own, and echoes of neighbouring rows are those of much
    the same bone: its course across the gap is not measured.

    Args:
        points: Of the outer boundary (n, 3), in mm, n >= 3.
        axes: Of the probe (n, 3), into the bone, in the same frame.

    Raises:
        DegenerateGeometryError: the points lie in such a strip.
    """
    inward = axes.mean(axis=0)
    inward = inward / np.linalg.norm(inward)
    flat = points - points.mean(axis=0)
    flat = flat - np.outer(flat @ inward, inward)
    spread_mm = np.linalg.svd(flat, compute_uv=False)[1] / np.sqrt(len(points))
    width_mm = float(STRIP_OVER_RMS * spread_mm)
    if width_mm < LEAST_WIDTH_MM:
        raise DegenerateGeometryError(
            f"the {len(points)} A-scans that show the outer boundary lie in a strip of "
            f"{width_mm:.1f} mm, a map takes {LEAST_WIDTH_MM:.1f} mm: scan more rows, or a wider "
            "region"
        )


LEAST_SAMPLES = 12
LEAST_THICKNESS_MM = 0.2  # the inner map stays at least this far below the outer one


def mean_curvature_per_mm(points_map: Floats) -> float:
    """Return the mean of the two curvatures of the quadric through points (n, 3); > 0: a dome.

    The points are heights over the plane that fits them best, +z out of the bone.
    """
    u, v, z = points_map.T
    design = np.column_stack((np.ones(len(u)), u, v, u * u, u * v, v * v))
    quadric = np.linalg.lstsq(design, z, rcond=None)[0]
    return -float(quadric[3] + quadric[5])


def lateness_mm(probe: ProbeModel, curvature_per_mm: float) -> float:
    """Return by how much the front echo of bone so curved puts the outer boundary too deep.

    The rays of the beam add up with the phase of their longer way; for a small phase that is
    <r^2> / 2R. A beam as wide as the crystal would give a^2 / 4R, the real one is narrower.
    """
    beam, spectrum = probe_beam(probe), block_template(probe, "pulse")
    fall = np.sum(beam.points_mm**2, axis=1) / 2.0 * curvature_per_mm
    k = 2.0 * np.pi * beam.frequencies_mhz / GEL.speed_mm_per_us
    flat = beam.weights.sum(axis=0)
    curved = (beam.weights * np.exp(-2j * np.outer(fall, k))).sum(axis=0)
    power = np.interp(
        beam.frequencies_mhz,
        spectrum.frequencies_mhz,
        spectrum.weights * np.abs(spectrum.spectrum) ** 2,
    )
    late = -np.angle(curved * np.conj(flat)) / (2.0 * k)
    return float(np.sum(power * late) / np.sum(power))


@dataclass(frozen=True, slots=True, eq=False)
class OuterMaps:
    """The outer boundary of a first pass, by ultrasound alone and together with the cloud."""

    points_base: Floats  # (n, 3) one for each A-scan, corrected for curvature
    late_mm: float  # by so much curvature makes front echoes late
    correction_mm: Floats  # (n, 3) what was subtracted for it from the point of each A-scan
    used: Bools  # (n,) went into the map
    grid: MapGrid
    plate: PlateField
    outer: BoundaryMap
    fused: BoundaryMap
    cloud_fit: CloudFit | None


@dataclass(frozen=True, slots=True, eq=False)
class LocatedDetection:
    """What was found in n A-scans, and the pose of the probe at each of them, z into the bone.

    Raises:
        InvalidInputError: numbers of A-scans and poses differ.
    """

    detection: Detection
    Ts_base_probe: Poses
    passes: Ints | None = None  # (n,) number of the pass of each, from 0; None: all of one

    def __post_init__(self) -> None:
        if len(self.Ts_base_probe) != len(self.detection):
            raise InvalidInputError(
                f"{len(self.detection)} A-scans need as many poses, not {len(self.Ts_base_probe)}"
            )

    def points(self) -> tuple[Floats, Floats]:
        """Return the points (n, 3) of the outer and the inner boundary, in ``base``."""
        return boundary_points(self.detection, self.Ts_base_probe)


def build_maps(
    found: LocatedDetection,
    cloud_points_base: ArrayLike | None = None,
    *,
    second: LocatedDetection | None = None,
    cell_mm: float = 1.0,
    probe: ProbeModel | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Maps:
    """Return the maps of the outer and inner boundary and of the outer one fused with the cloud.

    Args:
        found: In the A-scans, with the poses of the probe.
        cloud_points_base: Points of the pointer (m, 3) in ``base``.
        second: The same of the tilted passes. Only their inner boundary counts, and their points
            come last in those of the maps.
        cell_mm: Width of a cell.
        probe: That took the A-scans; None: the one that the detection names, unchanged.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between the parts.

    Raises:
        DegenerateGeometryError: too few A-scans have an outer boundary, or they lie on a line.
        CancelledError: ``cancel`` returned True.
    """
    outer = build_outer_maps(
        found, cloud_points_base, cell_mm=cell_mm, probe=probe, progress=progress, cancel=cancel
    )
    maps = add_inner_map(outer, found, second)
    progress(1.0)
    return maps


def build_outer_maps(
    found: LocatedDetection,
    cloud_points_base: ArrayLike | None = None,
    *,
    prior: CloudPrior | None = None,
    cell_mm: float = 1.0,
    probe: ProbeModel | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> OuterMaps:
    """Return what maps hold of the outer boundary; arguments and errors as of ``build_maps``.

    It does not depend on the speed of sound, nor on tilted passes. ``prior`` says how far off the
    cloud as a whole may be.
    """
    probe = probe or probe_model(found.detection.probe)
    T_base_map, late_mm = _curvature(found, probe)
    correction_mm = late_mm * found.Ts_base_probe.rotations[:, :, 2]
    points_base = found.points()[0] - correction_mm
    points_map = T_base_map.inv() @ points_base
    used = _agreeing_among(found.detection.outer_ok, points_map)
    require_share(used)
    require_area(points_base[used], found.Ts_base_probe.rotations[used, :, 2])
    used_map = T_base_map.inv() @ points_base[used]  # to the last bit as who has only those
    grid = MapGrid(T_base_map, used_map, cell_mm)
    _pause(progress, 0.2, cancel)
    plate = plate_through(used_map)
    outer = grid.boundary(plate, grid.near(used_map))
    _pause(progress, 0.4, cancel)
    fused, fit = outer, None
    if cloud_points_base is not None:
        cloud_map = T_base_map.inv() @ as_points(cloud_points_base)
        fused, fit = _fused(cloud_map, plate, grid, prior or CloudPrior())
    _pause(progress, 0.7, cancel)
    return OuterMaps(points_base, late_mm, correction_mm, used, grid, plate, outer, fused, fit)


def add_inner_map(
    outer: OuterMaps, found: LocatedDetection, second: LocatedDetection | None = None
) -> Maps:
    """Return the maps of both boundaries.

    Args:
        outer: Of the same A-scans and poses as ``found``.
        found: In the A-scans, at any speed of sound.
        second: The same of the tilted passes, see ``build_maps``.
    """
    detection, outer_base = found.detection, outer.points_base
    inner_base = found.points()[1] - outer.correction_mm
    usable = np.asarray(detection.outer_ok & detection.inner_ok & (detection.flag == 0))
    if second is not None:
        usable = np.concatenate((counting(detection), counting(second.detection)))
        late = outer.late_mm * second.Ts_base_probe.rotations[:, :, 2]
        second_outer, second_inner = second.points()
        outer_base = np.vstack((outer_base, second_outer - late))
        inner_base = np.vstack((inner_base, second_inner - late))
    T_base_map = outer.grid.T_base_map
    places_map, inner_map = T_base_map.inv() @ outer_base, T_base_map.inv() @ inner_base
    parts_map = places_map, inner_map
    fusion = None if second is None else _fused_passes(usable, parts_map, found, second, outer)
    if fusion is None:
        used = _agreeing_depths(usable, inner_map, outer)
    else:
        inner_map = fusion.corrected(inner_map)
        used = _agreeing_depths(fusion.agreeing, inner_map, outer)
        inner_base = T_base_map @ inner_map
    inner, inner_used = _inner(used, places_map, inner_map, outer)
    return Maps(
        outer_points_base=readonly(outer_base),
        inner_points_base=readonly(inner_base),
        outer_used=readonly(np.pad(outer.used, (0, len(outer_base) - len(outer.used)))),
        inner_used=readonly(inner_used),
        outer=outer.outer,
        inner=inner,
        fused=outer.fused,
        cloud_fit=outer.cloud_fit,
        offsets_mm=None if fusion is None else fusion.offsets_mm,
        offset_sigma_mm=0.0 if fusion is None else fusion.sigma_mm,
    )


def _curvature(found: LocatedDetection, probe: ProbeModel) -> tuple[Pose, float]:
    """Return the frame of the maps, and by how much curvature makes front echoes late (mm)."""
    axes_base = found.Ts_base_probe.rotations[:, :, 2]
    outer_base = found.points()[0]
    usable = found.detection.outer_ok
    if np.count_nonzero(usable) < LEAST_SAMPLES:
        raise DegenerateGeometryError(
            f"{np.count_nonzero(usable)} of {len(usable)} A-scans show the outer boundary, "
            f"{LEAST_SAMPLES} are the least for a map: was the probe in contact?"
        )
    T_base_map = map_frame(outer_base[usable], axes_base[usable])
    outer_map = T_base_map.inv() @ outer_base
    curvature = mean_curvature_per_mm(outer_map[_agreeing_among(usable, outer_map)])
    return T_base_map, lateness_mm(probe, curvature)


def boundary_points(detection: Detection, Ts_base_probe: Poses) -> tuple[Floats, Floats]:
    """Return where A-scans place the outer and the inner boundary (n, 3), in ``base``."""
    axes_base = Ts_base_probe.rotations[:, :, 2]
    outer_base = Ts_base_probe.translations + detection.standoff_mm[:, None] * axes_base
    return outer_base, outer_base + detection.thickness_mm[:, None] * axes_base


def map_frame(points: Floats, axes: Floats) -> Pose:
    """Return the frame ``map`` in base: origin in the middle, z out of the bone."""
    middle = points.mean(axis=0)
    _, widths, directions = np.linalg.svd(points - middle, full_matrices=False)
    if widths[1] < 1e-3 * max(widths[0], 1e-12):
        raise DegenerateGeometryError(
            f"the {len(points)} scanned points lie on one line: scan an area, not a stroke"
        )
    z = directions[2] if directions[2] @ axes.mean(axis=0) < 0 else -directions[2]
    x = np.array((1.0, 0.0, 0.0)) if abs(z[0]) < 0.9 else np.array((0.0, 1.0, 0.0))
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack((x, np.cross(z, x), z)), middle)


def _agreeing_among(usable: Bools, points_map: Floats) -> Bools:
    """Return which of the usable points (n, 3) have a height that agrees with their neighbours."""
    used = usable.copy()
    used[usable] = agreeing(points_map[usable, :2], points_map[usable, 2])
    return used


def _fused_passes(
    usable: Bools,
    parts_map: tuple[Floats, Floats],
    found: LocatedDetection,
    second: LocatedDetection,
    outer: OuterMaps,
) -> PassFusion:
    """Return how the depths of the first pass and of further ones fit together.

    ``parts_map``: where the sound entered the bone, and where it met the inner boundary (n, 3).
    """
    places_map, inner_map = parts_map
    further = np.zeros(len(second.detection), np.int64) if second.passes is None else second.passes
    passes = np.concatenate((np.zeros(len(found.detection), np.int64), 1 + further))
    depths = outer.plate.heights(inner_map[:, :2]) - inner_map[:, 2]
    return fuse_passes(places_map[:, :2], inner_map[:, :2], depths, usable, passes)


def _agreeing_depths(usable: Bools, inner_map: Floats, outer: OuterMaps) -> Bools:
    """Return which depths below the outer map agree with their neighbours."""
    if np.count_nonzero(usable) < LEAST_SAMPLES:
        return usable
    depths = np.zeros(len(usable))
    depths[usable] = outer.plate.heights(inner_map[usable, :2]) - inner_map[usable, 2]
    return _agreeing_among(usable, np.column_stack((inner_map[:, :2], depths)))


def _inner(
    used: Bools, places_map: Floats, inner_map: Floats, outer: OuterMaps
) -> tuple[BoundaryMap, Bools]:
    """Map what lies between the boundaries and subtract it, so that they never cross.

    It is mapped where A-scans entered the bone (n, 3), like the outer boundary.
    """
    grid, heights = outer.grid, outer.outer.height_mm
    if np.count_nonzero(used) < LEAST_SAMPLES:
        nothing = np.zeros(grid.shape, dtype=np.bool_)
        flat = grid.with_heights(heights - LEAST_THICKNESS_MM, nothing)
        return flat, np.zeros(len(used), dtype=np.bool_)
    below = outer.plate.heights(inner_map[used, :2]) - inner_map[used, 2]
    between = fit_field(inner_map[used, :2], below)
    depth = np.maximum(between.heights(grid.places), LEAST_THICKNESS_MM).reshape(grid.shape)
    ok = grid.near(places_map[used])
    return grid.with_heights(heights - depth, ok), used


def _fused(
    cloud_map: Floats, plate: PlateField, grid: MapGrid, prior: CloudPrior
) -> tuple[BoundaryMap, CloudFit | None]:
    found = fuse_cloud(cloud_map, plate, NEAR_MM, prior)
    alone = grid.near(plate.places_mm)
    if found is None:
        return grid.boundary(plate, alone), None
    correction = grid.T_base_map @ found.fit.correction @ grid.T_base_map.inv()
    in_base = replace(found.fit, correction=correction)
    return grid.boundary(found.plate, alone | grid.near(found.points_map)), in_base


def _pause(progress: Progress, share: float, cancel: Cancel) -> None:
    progress(share)
    if cancel():
        raise CancelledError("the mapping was cancelled")
