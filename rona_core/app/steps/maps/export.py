"""Files of the maps for other programs: meshes, images, markups, a table; all in ``base``."""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from functools import partial

from rona_core import __version__
from rona_core.app.declarations.declarations import Export
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.steps.maps.inputs import MAPS, map_accuracy
from rona_core.app.steps.maps.volume import volume_file
from rona_core.errors import StaleResultError
from rona_core.mapping.accuracy.error_terms import CellSigma
from rona_core.mapping.files.map_mesh import MapMesh, boundary_mesh, plate_mesh
from rona_core.mapping.files.map_sheet import BOUNDARIES, MapSheet, SigmaOverGrid
from rona_core.mapping.files.map_table import maps_csv, maps_schema
from rona_core.mapping.files.markups import maps_markups
from rona_core.mapping.files.mesh_files import ply_bytes, stl_bytes, vtp_bytes
from rona_core.session.codec import digest
from rona_core.session.document import Session

ALL = "maps.zip"
MANIFEST = "manifest.json"
EPOCH = (1980, 1, 1, 0, 0, 0)  # of every entry, so that the same maps give the same archive
FRAME = (
    "Places are in base, the frame of the robot, in mm. Where a format names its space it says "
    "left-posterior-superior, so that all files lie on each other; base is no anatomical frame."
)
Maker = Callable[[MapSheet], bytes]
MESHES = {  # by their ending
    "ply": ("PLY, with σ at every corner", ply_bytes),
    "stl": ("STL", stl_bytes),
    "vtp": ("VTP, with σ at every corner", vtp_bytes),
}


def _nrrd(sheet: MapSheet) -> bytes:
    from rona_core.mapping.files.map_images import maps_nrrd  # pynrrd is slow to import

    return maps_nrrd(sheet)


def _segmentation(sheet: MapSheet) -> bytes:
    from rona_core.mapping.files.map_images import bone_seg_nrrd

    return bone_seg_nrrd(sheet)


def _meshes() -> Iterator[tuple[str, str, Maker]]:
    for ending, (words, write) in MESHES.items():
        for name in BOUNDARIES:
            mesh = partial(boundary_mesh, name=name)
            yield f"{name}.{ending}", f"{name} boundary: {words}", _written(write, mesh)
        yield f"bone.{ending}", f"bone between the boundaries: {words}", _written(write, plate_mesh)


def _written(write: Callable[[MapMesh], bytes], mesh: Callable[[MapSheet], MapMesh]) -> Maker:
    return lambda sheet: write(mesh(sheet))


FILES: tuple[tuple[str, str, Maker], ...] = (  # name, what it holds, what makes it
    *_meshes(),
    ("maps.nrrd", "heights, thickness and σ over the grid, in channels", _nrrd),
    ("bone.seg.nrrd", "bone as a segmentation", _segmentation),
    ("maps.mrk.json", "rim, thinnest and thickest place for 3D Slicer", maps_markups),
    ("maps.csv", "a cell a row", maps_csv),
    ("maps.schema.json", "JSON Schema of a row of maps.csv", lambda _: maps_schema()),
)


def map_sheet(session: Session) -> MapSheet:
    """Return the maps with what is stated of them.

    Raises:
        StepBlockedError: nothing was mapped.
        StaleResultError: the maps are out of date.
    """
    maps = required(MAPS, session)
    reason = stale_reason("maps", session)
    if reason is not None:
        raise StaleResultError(f"the maps are stale: {reason}")
    accuracy = map_accuracy(session)
    if accuracy is None:
        return MapSheet(maps, {})
    names = (*BOUNDARIES, "thickness")
    stated: dict[str, CellSigma] = {name: getattr(accuracy, name) for name in names}
    sigmas = {
        name: SigmaOverGrid(sigma.whole_own_mm(), sigma.whole_shared_mm())
        for name, sigma in stated.items()
    }
    return MapSheet(maps, sigmas)


def _archive(session: Session) -> bytes:
    """Return all files in one, with a manifest."""
    sheet = map_sheet(session)
    file, entries = io.BytesIO(), []
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, _, make in FILES:
            data = make(sheet)
            archive.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED)
            sha256 = hashlib.sha256(data).hexdigest()
            entries.append({"name": name, "bytes": len(data), "sha256": sha256})
        manifest = {
            "program": f"RONA {__version__}",
            "session": {"id": session.id, "name": session.name, "maps": digest(sheet.maps)},
            "frame": FRAME,
            "sigma": "one standard deviation: total, own (each cell's), common (all cells share)",
            "files": entries,
        }
        text = json.dumps(manifest, indent=1).encode("ascii")
        archive.writestr(zipfile.ZipInfo(MANIFEST, EPOCH), text, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def _of_session(make: Maker) -> Callable[[Session], bytes]:
    return lambda session: make(map_sheet(session))


EXPORTS = (
    Export(ALL, "all files of the maps, with a manifest", _archive),
    *(Export(name, says, _of_session(make), "maps") for name, says, make in FILES),
)
VOLUME = Export("echo_volume.nrrd", "echoes as a volume over the maps", volume_file, "volume")
