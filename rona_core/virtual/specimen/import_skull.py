"""Load a skull from a file: a mask, a CT with a threshold, or closed meshes."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.files.triangle_file import MESH_SUFFIXES
from rona_core.devices.files.voxels.refusals import refused
from rona_core.devices.files.voxels.voxel_reader import VOLUME_SUFFIXES
from rona_core.devices.protocols import Cancel, Progress, Work, never, silent
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.arrays import Vector3, as_vector3, readonly
from rona_core.geometry.pose import Pose
from rona_core.session.specimen import LoadedSkull
from rona_core.virtual.specimen.boundaries import RADII_MM
from rona_core.virtual.specimen.imported.display_mesh import display_mesh
from rona_core.virtual.specimen.imported.distance_grid import (
    BELOW_MM,
    as_micrometres,
    distance_from_mesh,
    distance_from_volume,
    grid_about,
    raised,
    without_small_pieces,
)
from rona_core.virtual.specimen.imported.holder_removal import without_holder
from rona_core.virtual.specimen.imported.imported_skull import (
    OFF_SURFACE_MM,
    WITHIN_MM,
    LoadedSpecimen,
    check_drawn,
    drawn_on_level,
)
from rona_core.virtual.specimen.imported.mesh_reader import (
    BoneMesh,
    inside,
    joined,
    read_mesh,
)
from rona_core.virtual.specimen.imported.region_choice import (
    GAP_MM,
    Choice,
    CoarseBone,
    choose_region,
    coarse_bone,
)
from rona_core.virtual.specimen.imported.upright import stand_as_the_bone_does
from rona_core.virtual.specimen.imported.volume_reader import (
    BoneVolume,
    read_volume,
    without,
)

COARSE_MM = 1.25  # voxels in which a mesh is looked over
FILLED = 0.5  # share of the bone met that has no inner boundary in a head that is filled
WHOLE = 0.98  # share of the disc whose thickness must exist


def import_skull(
    path: str | Path,
    *,
    inner: str | Path | None = None,
    threshold: float | None = None,
    label: int | None = None,
    center: ArrayLike | None = None,
    radius_mm: float = 25.0,
    **work: Unpack[Work],
) -> LoadedSkull:
    """Read the bone of a skull and fix its boundaries about the disc to be scanned.

    Args:
        path: A mask or CT (.nrrd, .nii, .nii.gz) or a closed mesh (.stl, .ply, .obj), in mm, z up
            and x to a side. With ``inner``, the filled head; else the bone itself.
        inner: The filled cavity of the head, a file of the same kind.
        threshold: Grey value from which a voxel is bone; needed for a CT only.
        label: Value of bone, needed for a map of several labels only.
        center: Centre of the disc (3,) on the outer surface, in coordinates of the file (left,
            posterior, superior where those are left-handed); None chooses a smooth, whole place on
            the side of the head.
        radius_mm: Radius of the disc.
        work: ``progress``, called with the share done, and ``cancel``, called between the steps.

    Raises:
        InvalidInputError: a file or value that does not fit; says what was expected.
        CancelledError: ``cancel`` said so.
    """
    low, high = RADII_MM
    if not low <= radius_mm <= high:
        raise InvalidInputError(f"radius_mm must be {low:g} to {high:g}, not {radius_mm}")
    chosen = None if center is None else as_vector3(center, name="center")
    paths = [Path(path)] if inner is None else [Path(path), Path(inner)]
    step = _stepper(work.get("progress", silent), work.get("cancel", never))
    step(0.02)
    source = _read(paths, threshold, label)
    freed, T_skull_upright = None, Pose.identity()
    if isinstance(source, BoneVolume):
        freed = without_holder(stand_as_the_bone_does(source))
        source, T_skull_upright = freed.bone, freed.bone.T_skull_upright
    step(0.25)
    coarse = _look_over(source)
    step(0.4)
    choice = (
        choose_region(coarse, radius_mm)
        if chosen is None
        else _place_at(coarse, chosen, T_skull_upright)
    )
    if freed is not None:
        freed.require_whole(choice.center_upright, radius_mm)
    draft = _draft(source, coarse, choice, float(radius_mm), T_skull_upright, step)
    sha256 = tuple(map(_sha256, paths))
    draft = replace(draft, name=paths[0].name, sha256=sha256, threshold=threshold, label=label)
    result = _settle(draft)
    check_drawn(result)
    step(1.0)
    return result


def _draft(
    source: BoneVolume | BoneMesh,
    coarse: CoarseBone,
    choice: Choice,
    radius_mm: float,
    T_skull_upright: Pose,
    step: Callable[[float], None],
) -> LoadedSkull:
    """Return the skull without name and thickness; all of it is moved by the one transform."""
    grid = grid_about(choice.center_upright, choice.outward_upright, radius_mm)
    half_mm = 0.5 * grid.spacing_mm * (grid.shape[0] - 1)
    grid = raised(grid, coarse.highest_mm(choice.center_upright, grid.axes_upright, half_mm))
    if isinstance(source, BoneMesh):
        kind, distance, smoothing_mm = "mesh", distance_from_mesh(source, grid), 0.0
    else:
        kind = "ct" if source.grey else "mask"
        source = without_small_pieces(source, grid)
        coarse = _look_over(source)  # what is drawn is what is measured
        distance, smoothing_mm = distance_from_volume(source, grid)
    step(0.8)
    vertices, faces = display_mesh(coarse)
    step(0.95)
    draft = LoadedSkull(
        name="",
        kind=kind,
        sha256=(),
        threshold=None,
        smoothing_mm=smoothing_mm,
        distance_um=as_micrometres(distance),
        spacing_mm=grid.spacing_mm,
        origin_skull=T_skull_upright @ grid.origin_upright,
        axes_skull=T_skull_upright.rotate(grid.axes_upright.T).T,
        mesh_vertices_skull=(T_skull_upright @ vertices).astype(np.float32),
        mesh_faces=faces.astype(np.int32),
        center_skull=T_skull_upright @ choice.center_upright,
        normal_skull=T_skull_upright.rotate(choice.outward_upright),
        radius_mm=radius_mm,
        mean_thickness_mm=0.0,
    )
    if isinstance(source, BoneMesh):
        return draft
    return drawn_on_level(draft, float(source.voxel_mm().max()))


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _stepper(progress: Progress, cancel: Cancel) -> Callable[[float], None]:
    def step(share: float) -> None:
        if cancel():
            raise CancelledError("loading the skull was cancelled")
        progress(share)

    return step


def _read(paths: list[Path], threshold: float | None, label: int | None) -> BoneVolume | BoneMesh:
    for path in paths:
        if not path.is_file():
            raise InvalidInputError(f"there is no file {path}: check the path")
    volumes = [path.name.lower().endswith(VOLUME_SUFFIXES) for path in paths]
    meshes = [path.name.lower().endswith(MESH_SUFFIXES) for path in paths]
    if all(volumes):
        parts = [read_volume(path, threshold, label) for path in paths]
        return parts[0] if len(parts) == 1 else without(parts[0], parts[1])
    if all(meshes):
        if threshold is not None or label is not None:
            raise refused("a threshold for a mesh")
        surfaces = [read_mesh(path) for path in paths]
        return surfaces[0] if len(surfaces) == 1 else joined(surfaces[0], surfaces[1])
    raise refused(
        "files of different kinds",
        names=", ".join(path.name for path in paths),
        volumes=", ".join(VOLUME_SUFFIXES),
        meshes=", ".join(MESH_SUFFIXES),
    )


def _look_over(source: BoneVolume | BoneMesh) -> CoarseBone:
    if isinstance(source, BoneVolume):
        return coarse_bone(source.mask, source.T_upright_voxel, source.back)
    low, high = source.bounds()
    low = low - 2.0 * COARSE_MM
    nx, ny, nz = np.ceil((high - low) / COARSE_MM).astype(int) + 3
    y, z = np.meshgrid(np.arange(ny) * COARSE_MM, np.arange(nz) * COARSE_MM, indexing="ij")
    columns = low + np.stack((np.zeros_like(y), y, z), axis=-1).reshape(-1, 3)
    solid = inside(source, columns, np.array((COARSE_MM, 0.0, 0.0)), int(nx))
    mask = np.moveaxis(solid.reshape(ny, nz, nx), 2, 0)
    return CoarseBone(mask, low, np.full(3, COARSE_MM), 0)


def _place_at(bone: CoarseBone, center_skull: Vector3, T_skull_upright: Pose) -> Choice:
    """Return the outer surface at a centre (3,), on the line to it from the middle of the head.

    Other bone on that line, farther out or in, does not count.

    Raises:
        InvalidInputError: the centre is off the bone, or on the inside.
    """
    center = T_skull_upright.inv() @ center_skull
    heights = np.flatnonzero(bone.mask.any(axis=(0, 1))) * bone.voxel_mm[2]
    lowest = max(0, int(np.floor((heights.max() - 100.0) / bone.voxel_mm[2])) + 1)
    upper = bone.mask[:, :, lowest:]  # the braincase, without the face
    places = [np.flatnonzero(np.asarray(upper.any(axis=axes))) for axes in ((1, 2), (0, 2), (0, 1))]
    places[2] = places[2] + lowest
    span = np.array([place[0] + place[-1] for place in places])
    middle: Vector3 = bone.origin_upright + 0.5 * span * bone.voxel_mm
    outward = center - middle
    length = float(np.linalg.norm(outward))
    if length < 1.0:
        raise refused("a centre in the middle of the head", center=center_skull.round(1).tolist())
    outward = outward / length
    step = 0.25 * float(bone.voxel_mm.min())
    t = np.arange(length + 60.0, 0.0, -step)  # inwards
    index = np.round((middle + t[:, None] * outward - bone.origin_upright) / bone.voxel_mm)
    held = ((index >= 0) & (index < bone.mask.shape)).all(axis=1)
    i, j, k = np.where(np.asarray(held)[:, None], index, 0).astype(int).T
    solid = np.flatnonzero(bone.mask[i, j, k] & held)
    # the line enters bone where it was in air for longer than in the gaps of the diploe
    enters = solid[np.diff(solid, prepend=-len(t)) * step > GAP_MM]
    off = t[enters] - length
    off = float(off[np.argmin(np.abs(off))]) if len(off) else np.inf
    # from within the bone it goes out to the surface, but not from the cavity
    within = bool(len(solid)) and np.abs(t[solid] - length).min() <= OFF_SURFACE_MM
    if off < -OFF_SURFACE_MM or off > (WITHIN_MM if within else OFF_SURFACE_MM):
        raise refused(
            "a centre off the bone",
            center=center_skull.round(1).tolist(),
            nearest=_nearest_bone_mm(bone, center),
            off=abs(off),
            within=OFF_SURFACE_MM,
        )
    return Choice(center + off * outward, outward)


def _nearest_bone_mm(bone: CoarseBone, center: Vector3) -> float:
    off = [
        bone.origin_upright[axis] + bone.voxel_mm[axis] * np.arange(n) - center[axis]
        for axis, n in enumerate(bone.mask.shape)
    ]
    flat = off[1][:, None] ** 2 + off[2] ** 2
    squares = [
        x**2 + flat[layer].min() for x, layer in zip(off[0], bone.mask, strict=True) if layer.any()
    ]  # layer by layer, to spare memory
    return float(np.sqrt(min(squares)))


def _settle(draft: LoadedSkull) -> LoadedSkull:
    """Put the centre on the surface, fill in the normal and thickness, and check the disc.

    Raises:
        InvalidInputError: the disc is not whole bone.
    """
    specimen = LoadedSpecimen(draft, radius_mm=draft.radius_mm)
    region = specimen.region
    first = draft.axes_skull[:, 0] - (draft.axes_skull[:, 0] @ region.normal_skull) * (
        region.normal_skull
    )
    first = first / np.linalg.norm(first)
    across = np.stack((first, np.cross(region.normal_skull, first)))
    side = np.arange(-draft.radius_mm, draft.radius_mm + 1e-9, 1.0)
    lattice = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    lattice = lattice[np.linalg.norm(lattice, axis=1) <= draft.radius_mm]
    o = region.center_skull + lattice @ across + 10.0 * region.normal_skull
    d = np.repeat(-region.normal_skull[None], len(o), axis=0)
    t = specimen.ray(o, d)
    points = o[np.isfinite(t)] + t[np.isfinite(t), None] * d[np.isfinite(t)]
    thickness = specimen.thickness(points, -specimen.normal(points))
    valid = np.isfinite(thickness)
    share, met = float(valid.sum()) / len(lattice), len(points) / len(lattice)
    if share < WHOLE:
        center = region.center_skull.round(1).tolist()
        # below most holes of real bone there is some on either side; a filled head has no inside
        if met - share > FILLED * met:
            deep = 1.0 - share / met
            raise refused(
                "bone without an inner surface", share=deep, center=center, depth=BELOW_MM
            )
        raise refused("holes in the disc", share=share, center=center, missing=1.0 - share)
    return replace(
        draft,
        center_skull=readonly(region.center_skull.copy()),
        normal_skull=readonly(region.normal_skull.copy()),
        mean_thickness_mm=float(thickness[valid].mean()),
    )
