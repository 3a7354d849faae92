"""Files of all that was recorded, and of all transforms between frames."""

import io
import json
import zipfile
from contextlib import suppress
from typing import Any

import numpy as np

from rona_core import __version__
from rona_core.app.declarations.declarations import Export, Step
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.overview.frame_graph import FrameRow, frame_rows
from rona_core.app.steps.scan.derivation import PLACES
from rona_core.errors import NotFoundError, RonaError, StepBlockedError
from rona_core.geometry.frame_graph import FrameEdge, FrameGraph
from rona_core.geometry.pose import Pose
from rona_core.session.capture_files import captures_hdf5
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull

EPOCH = (1980, 1, 1, 0, 0, 0)  # of every entry, so that the same session gives the same archive
BASE, SKULL = "base", "skull"
TURNED = np.diag((-1.0, -1.0, 1.0))  # right, anterior, superior to left, posterior, superior
NIFTI = (".nii", ".nii.gz")


def capture_file(session: Session) -> bytes:
    """Return all captures of a session as HDF5, and where the probe was at each A-scan.

    Raises:
        StepBlockedError: nothing was recorded.
    """
    held = {name: session.captures.get(name) for name in REGISTRY.captures}
    if all(one in (None, ()) for one in held.values()):
        raise StepBlockedError("nothing was recorded: there are no captures to export")
    devices = session.setup.devices
    about = {
        "program": f"RONA {__version__}",
        "session": session.name,
        "session_id": session.id,
        "created_utc": session.created_utc,
        "robot": devices.robot.model,
        "pointer": devices.pointer,
        "probe": devices.probe.name,
        "clocks": "times of a capture are seconds on its own clock, which starts at 0",
    }
    return captures_hdf5(held, about, _derived(session))


def _derived(session: Session) -> dict[str, Any]:
    """Return the pose of the probe in ``base`` at each A-scan of every pass, where it is known."""
    found: dict[str, Any] = {}
    with suppress(RonaError):
        places, scan = PLACES.read(session), session.captures.scan
        if places is not None and scan is not None:
            found["scan"] = places.poses(scan)
            for number, one in enumerate(session.captures.second):
                found[f"second_{number}"] = places.poses(one)
    return found


def transforms_json(session: Session) -> bytes:
    """Return every transform that the session holds, stale ones with their reason."""
    rows = [
        {
            "name": row.name,
            "parent": row.parent,
            "child": row.child,
            "matrix": row.pose.matrix().tolist(),
            "source": row.source,
            "time_utc": row.time_utc,
            "sigma_mm": row.sigma_mm,
            "sigma_deg": row.sigma_deg,
            "stale_reason": row.stale_reason,
        }
        for row in frame_rows(session)
    ]
    says = "matrix maps places in child to parent, in mm; sigma is one standard deviation"
    return json.dumps({"unit": "mm", "says": says, "transforms": rows}, indent=1).encode("ascii")


def transforms_zip(session: Session) -> bytes:
    """Return a transform file (``.tfm``) for every frame, as 3D Slicer takes them.

    Each leads to the frame of the CT where one was loaded and registered, else to ``base``; what is
    not connected to that is as it was measured.
    """
    rows = [row for row in frame_rows(session) if row.stale_reason is None]
    root = SKULL if any(row.child == SKULL for row in rows) else BASE
    turned = TURNED if root == SKULL and _is_nifti(session) else np.eye(3)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        placed = _poses_in(root, rows)
        files = {f"T_{root}_{frame}": tfm_bytes(T, turned) for frame, T in placed.items()}
        apart = [row for row in rows if row.child not in placed and row.child != root]
        files |= {row.name: tfm_bytes(row.pose, np.eye(3)) for row in apart}
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(f"{name}.tfm", EPOCH), data, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def _is_nifti(session: Session) -> bool:
    """Return whether the skull is in the coordinates of a NIfTI file: right, anterior, superior."""
    skull = session.setup.specimen
    return isinstance(skull, LoadedSkull) and skull.name.lower().endswith(NIFTI)


def _poses_in(root: str, rows: list[FrameRow]) -> dict[str, Pose]:
    """Return the pose of every frame that is connected to one."""
    edges: list[FrameEdge] = []
    for row in rows:
        edge = FrameEdge(row.parent, row.child, row.pose, row.source)
        with suppress(RonaError):  # a second way between frames
            FrameGraph((*edges, edge))
            edges.append(edge)
    graph, found = FrameGraph(tuple(edges)), dict[str, Pose]()
    for frame in sorted({name for edge in edges for name in (edge.left, edge.right)} - {root}):
        with suppress(NotFoundError):
            found[frame] = graph.pose(root, frame)
    return found


def tfm_bytes(pose: Pose, turned: np.ndarray) -> bytes:
    """Return a pose as an ITK transform, which leads from parent to child as Slicer saves them.

    Args:
        pose: Of the frame in the parent, in mm.
        turned: What turns (3, 3) coordinates of the parent into left, posterior, superior.
    """
    back = pose.inv()
    rotation = back.rotation @ turned.T
    numbers = " ".join(map(repr, (*rotation.ravel().tolist(), *back.translation.tolist())))
    return (
        "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n"
        f"Parameters: {numbers}\nFixedParameters: 0 0 0\n"
    ).encode("ascii")


STEP = Step(
    "overview",
    exports=(
        Export("captures.h5", "all that the devices recorded (HDF5)", capture_file, "captures"),
        Export("transforms.json", "all transforms between frames", transforms_json, "captures"),
        Export("transforms.zip", "the same for 3D Slicer (.tfm)", transforms_zip, "captures"),
    ),
)
REGISTRY.declare((STEP,))
