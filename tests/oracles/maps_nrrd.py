"""Exported maps read back by the rules of NRRD alone."""

import io

import nrrd
import numpy as np

from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap


def read_maps_nrrd(data: bytes) -> dict[str, BoundaryMap]:
    """Return the outer, inner and fused boundary of ``maps.nrrd``."""
    file = io.BytesIO(data)
    header = nrrd.read_header(file)
    values = nrrd.read_data(header, file)
    directions = np.asarray(header["space directions"], dtype=np.float64)[1:]
    steps = np.linalg.norm(directions, axis=1)
    T_base_map = Pose((directions / steps[:, None]).T, np.asarray(header["space origin"]))
    u, v = (
        np.asarray(step * np.arange(n), dtype=np.float64)
        for step, n in zip(steps[:2], values.shape[1:3], strict=True)
    )
    names = header["channels"].split()
    found: dict[str, BoundaryMap] = {}
    for name in ("outer", "inner", "fused"):
        heights = np.asarray(values[names.index(name), :, :, 0], dtype=np.float64)
        found[name] = BoundaryMap(T_base_map, u, v, heights, np.isfinite(heights))
    return found
