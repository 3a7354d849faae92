"""Files of the maps for other programs: meshes, images, markups, a table; all in ``base``."""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable

from rona_core import __version__
from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.maps.accuracy import map_accuracy
from rona_core.errors import NotFoundError, StaleResultError
from rona_core.mapping.accuracy.error_terms import CellSigma
from rona_core.mapping.files.map_mesh import boundary_mesh, plate_mesh
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
MESH_FORMATS = {"ply": ply_bytes, "stl": stl_bytes, "vtp": vtp_bytes}


def _nrrd(sheet: MapSheet) -> bytes:
    from rona_core.mapping.files.map_images import maps_nrrd  # pynrrd is slow to import

    return maps_nrrd(sheet)


def _segmentation(sheet: MapSheet) -> bytes:
    from rona_core.mapping.files.map_images import bone_seg_nrrd

    return bone_seg_nrrd(sheet)


def _schema(_: MapSheet) -> bytes:
    return maps_schema()


def _makers() -> dict[str, Callable[[MapSheet], bytes]]:
    """Return what makes each file, by name."""
    makers: dict[str, Callable[[MapSheet], bytes]] = {}
    for ending, write in MESH_FORMATS.items():
        for name in BOUNDARIES:
            makers[f"{name}.{ending}"] = lambda sheet, name=name, write=write: write(
                boundary_mesh(sheet, name)
            )
        makers[f"bone.{ending}"] = lambda sheet, write=write: write(plate_mesh(sheet))
    return makers | {
        "maps.nrrd": _nrrd,
        "bone.seg.nrrd": _segmentation,
        "maps.mrk.json": maps_markups,
        "maps.csv": maps_csv,
        "maps.schema.json": _schema,
    }


MAKERS = _makers()
NAMES = (ALL, *MAKERS)


def export_maps(session: Session, name: str) -> bytes:
    """Return a file of the robot's maps.

    Args:
        session: With its maps.
        name: One of ``NAMES``; ``maps.zip`` holds all others and says what they are.

    Raises:
        NotFoundError: there is no such file.
        StepBlockedError: nothing was mapped.
        StaleResultError: the maps are out of date.
        DegenerateGeometryError: the maps have no area.
    """
    if name not in NAMES:
        raise NotFoundError(f"there is no file {name!r} of the maps: {', '.join(NAMES)}")
    sheet = map_sheet(session)
    return MAKERS[name](sheet) if name != ALL else _archive(session, sheet)


def map_sheet(session: Session) -> MapSheet:
    """Return the maps with what is stated of them.

    Raises:
        StepBlockedError: nothing was mapped.
        StaleResultError: the maps are out of date.
    """
    maps = require_result(session.results.maps, "map the boundaries (step 9)").value
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


def _archive(session: Session, sheet: MapSheet) -> bytes:
    """Return all files in one, with a manifest."""
    file, entries = io.BytesIO(), []
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, make in MAKERS.items():
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
