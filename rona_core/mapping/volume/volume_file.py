"""NRRD of an echo volume: linear amplitudes with their place in ``base``, in mm."""

from typing import Any

import numpy as np

from rona_core.mapping.files.nrrd_file import nrrd_bytes
from rona_core.mapping.volume.echo_volume import EchoVolume

CONTENT = "echo amplitude of A-scans, relative to the front echo of flat bone in perfect contact"


def volume_nrrd(volume: EchoVolume, notes: dict[str, str] | None = None) -> bytes:
    """Return a volume as a NRRD file (Kindlmann 2004) that 3D Slicer and ITK-SNAP open.

    Voxel (i, j, k) has its centre at ``space origin`` + i, j, k times the rows of ``space
    directions``. Those of mask 0 are not known; the mask is not in the file, their amplitude is 0.

    Args:
        volume: To be written.
        notes: Further key/value pairs.
    """
    turn, steps = volume.T_base_map.rotation, np.array(volume.steps_mm)
    first = (volume.outer.u_mm[0], volume.outer.v_mm[0], volume.z_mm[0])
    header: dict[str, Any] = {
        "space directions": steps[:, None] * turn.T,
        "space origin": volume.T_base_map @ np.array([first])[0],
        "kinds": ["space", "space", "space"],
        "labels": ["u", "v", "z"],
        "content": CONTENT,
        "axes": "u and v in the plane of the map, z out of the bone",
        "unknown": "amplitude 0",
        **(notes or {}),
    }
    return nrrd_bytes(volume.amplitude, header)
