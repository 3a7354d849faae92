"""Comparison of the robot's maps with a reference: a mesh, a CT, or the maps of another session.

It is a question about a session, and nothing of it is stored.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import Answer
from rona_core.app.steps.maps.inputs import MAPS, map_accuracy
from rona_core.app.steps.maps.messages import StartComparison
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.triangle_file import MESH_SUFFIXES, read_triangles
from rona_core.devices.files.voxels.voxel_reader import VOLUME_SUFFIXES
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import InvalidInputError, NotFoundError, StaleResultError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.comparison.map_errors import (
    ErrorFigures,
    MapErrors,
    compare_with_bone,
    figures_of,
    surface_cells,
)
from rona_core.mapping.comparison.reference_bone import (
    ReferenceBone,
    ReferencePlace,
    Registration,
    bone_of_mesh,
    check_extent,
    place_by_points,
    place_reference,
)
from rona_core.mapping.comparison.reference_volume import bone_of_volume
from rona_core.mapping.files.map_mesh import cell_triangles
from rona_core.session.document import Session
from rona_core.session.files import session_from_bytes

SESSION_SUFFIX = ".rona"
TRUTH = "true bone"  # of virtual devices


@dataclass(frozen=True, slots=True, eq=False)
class MapComparison:
    """The robot's maps beside a reference."""

    name: str  # of the reference
    maps: Maps  # that were compared
    errors: MapErrors
    figures: tuple[ErrorFigures, ...]
    place: ReferencePlace | None = None  # None: truth, which is where it is


def compare_maps(
    session: Session,
    data: bytes,
    name: str,
    how: Registration = "none",
    pairs: tuple[ArrayLike, ArrayLike] | None = None,
    threshold: float | None = None,
) -> MapComparison:
    """Return the robot's maps beside a reference file.

    Args:
        session: With its maps.
        data: Contents of the file: STL, PLY or OBJ in mm (a closed mesh holds both tables of the
            bone, an open one the outer table), a CT or a mask (NRRD, NIfTI), or another session.
        name: Of the file; its extension names the format.
        how: The reference comes to ``base``, see ``place_reference``.
        pairs: Named points (n, 3) in the frame of the file and in ``base``.
        threshold: From which a value of a CT is bone.

    Raises:
        InvalidInputError: the file is damaged, foreign, empty or in another unit, or grey values
            without a threshold.
        StepBlockedError: nothing was mapped, here or there.
        StaleResultError: the maps of either are out of date.
        DegenerateGeometryError: the surfaces do not lie on each other.
    """
    maps = _maps(session, "this session")
    if name.lower().endswith(VOLUME_SUFFIXES):
        T_mesh_base = place_by_points(how, pairs).T_base_mesh.inv()
        bone = bone_of_volume(data, name, T_mesh_base @ maps.outer.points_base(), threshold)
    else:
        bone = _read_bone(data, name)
    place = place_reference(bone, maps, how, pairs)
    errors = compare_with_bone(maps, bone.moved(place.T_base_mesh))
    return MapComparison(name, maps, errors, figures_of(maps, errors, _stated_mm(session)), place)


def compare_with_upload(
    activity: StartComparison, session: Session, context: ActivityContext
) -> tuple[Answer]:
    """Carry out `StartComparison`; raises as `compare_maps`.

    Raises:
        NotFoundError: the reference was not uploaded.
    """
    path = context.uploads / activity.file
    if not path.is_file():
        raise NotFoundError(f"there is no uploaded file {activity.file!r}: upload it first")
    found = context.run(_compare_with_file, session, path, activity)
    return (Answer(replace(found, maps=_maps(session, "this session"))),)


def _compare_with_file(
    session: Session, path: Path, wanted: StartComparison, *, progress: Progress, cancel: Cancel
) -> MapComparison:
    """Read a reference and compare: in the process of the job, which Cancel ends."""
    points = wanted.points_reference_mm, wanted.points_base_mm
    pairs = points if any(points) else None
    data = read_file(path, "an uploaded file")
    return compare_maps(session, data, path.name, wanted.register, pairs, wanted.threshold)


def compare_with_truth(session: Session, errors: MapErrors) -> MapComparison:
    """Return the robot's maps beside the true bone, given their errors; raises as above."""
    maps = _maps(session, "this session")
    return MapComparison(TRUTH, maps, errors, figures_of(maps, errors, _stated_mm(session)))


def _maps(session: Session, whose: str) -> Maps:
    maps: Maps = required(MAPS, session)
    if (reason := stale_reason("maps", session)) is not None:
        raise StaleResultError(f"the maps of {whose} are stale: {reason}")
    return maps


def _read_bone(data: bytes, name: str) -> ReferenceBone:
    suffix = Path(name).suffix.lower()
    if suffix == SESSION_SUFFIX:
        maps = _maps(session_from_bytes(data, name), name)
        outer = _mesh(maps.outer, name)
        return ReferenceBone(outer, _mesh(maps.inner, name) if maps.inner.ok.any() else None)
    if suffix not in MESH_SUFFIXES:
        known = ", ".join((*MESH_SUFFIXES, *VOLUME_SUFFIXES, SESSION_SUFFIX))
        raise InvalidInputError(f"{name} is no reference: expected one of {known}")
    mesh = read_triangles(data, name)
    check_extent(mesh, name)
    return bone_of_mesh(mesh)


def _mesh(boundary: BoundaryMap, name: str) -> Mesh:
    mesh = Mesh(surface_cells(boundary, np.ones_like(boundary.ok))[0], cell_triangles(boundary.ok))
    used = np.unique(mesh.faces)
    check_extent(replace(mesh, vertices=mesh.vertices[used]), name)
    return mesh


def _stated_mm(session: Session) -> dict[str, Floats] | None:
    """Return the standard deviations (nu, nv) that the maps state, all causes together."""
    accuracy = map_accuracy(session)
    if accuracy is None:
        return None
    thickness = accuracy.thickness.total_mm()
    return {
        "outer": accuracy.outer.total_mm(),
        "fused": accuracy.fused.total_mm(),
        "inner": accuracy.inner.total_mm(),
        "thickness": thickness,
        "thickness_nearest": thickness,
    }
