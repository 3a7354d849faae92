"""Images of the maps as NRRD: their values over the grid, and the bone as a segmentation.

NRRD (Kindlmann 2004) places the centre of voxel (i, j, k) at ``space origin`` + i, j, k times the
rows of ``space directions``; both are in ``base``.
"""

from typing import Any

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.files.map_sheet import BOUNDARIES, MapSheet, cell_sizes_mm
from rona_core.mapping.files.nrrd_file import nrrd_bytes

CHANNELS = (*BOUNDARIES, "thickness", *(f"sigma_{name}" for name in (*BOUNDARIES, "thickness")))
STEP_MM = 0.25  # height of a voxel of the segmentation
MOST_VOXELS = 20_000_000
SEGMENT = {  # as 3D Slicer writes a segment
    "Segment0_ID": "bone",
    "Segment0_Name": "bone between the outer and the inner boundary",
    "Segment0_Color": "0.90 0.84 0.72",
    "Segment0_LabelValue": "1",
    "Segment0_Layer": "0",
    "Segmentation_MasterRepresentation": "Binary labelmap",
    "Segmentation_ContainedRepresentationNames": "Binary labelmap|",
    "Segmentation_ReferenceImageExtentOffset": "0 0 0",
}


def maps_nrrd(sheet: MapSheet) -> bytes:
    """Return heights, thickness and standard deviations as channels over one sheet of voxels.

    float64, mm; heights count along z of the map from its plane; NaN where a map is not ok.
    ``channels`` names them in their order.
    """
    heights = [_ok_heights(sheet.boundary(name)) for name in BOUNDARIES]
    sigmas = [sheet.sigma_mm(name)["total"] for name in (*BOUNDARIES, "thickness")]
    values = np.stack((*heights, sheet.thickness_mm(), *sigmas))[..., None]
    outer = sheet.maps.outer
    header = {
        **_place(outer, (outer.u_mm[0], outer.v_mm[0], 0.0), 1.0),
        "kinds": ["vector", "space", "space", "space"],
        "labels": ["channel", "u", "v", "z"],
        "content": "maps of the bone boundaries: heights over a plane, thickness, sigma (mm)",
        "channels": " ".join(CHANNELS),
    }
    header["space directions"] = np.vstack((np.full(3, np.nan), header["space directions"]))
    return nrrd_bytes(values, header)


def bone_seg_nrrd(sheet: MapSheet) -> bytes:
    """Return the bone between both boundaries as a segmentation (``.seg.nrrd``) of 3D Slicer.

    A voxel is as wide as a cell.

    Raises:
        InvalidInputError: no cell has both boundaries, or there would be too many voxels.
    """
    labels, first_mm = bone_labels(sheet, STEP_MM)
    outer = sheet.maps.outer
    header = {
        **_place(outer, (outer.u_mm[0], outer.v_mm[0], first_mm), STEP_MM),
        "kinds": ["domain", "domain", "domain"],
        **SEGMENT,
        "Segment0_Extent": " ".join(f"0 {n - 1}" for n in labels.shape),
        "Segment0_Tags": "Segmentation.Status:completed|",
    }
    return nrrd_bytes(labels.astype(np.uint8), header)


def bone_labels(sheet: MapSheet, step_mm: float) -> tuple[Bools, float]:
    """Return which voxels (nu, nv, nz) have their centre in the bone, and the lowest height."""
    ok, outer, inner = sheet.thickness_ok(), sheet.maps.outer, sheet.maps.inner
    if not ok.any():
        raise InvalidInputError(
            "expected maps with both boundaries in some cells, got none: scan again (step 8)"
        )
    low = np.floor(float(inner.height_mm[ok].min()) / step_mm)
    high = np.ceil(float(outer.height_mm[ok].max()) / step_mm)
    if ok.size * (high - low + 1) > MOST_VOXELS:
        raise InvalidInputError(
            f"the segmentation would have {ok.size * (high - low + 1):.3g} voxels, "
            f"{MOST_VOXELS:.3g} are the most: map with larger cells (step 9)"
        )
    z_mm = step_mm * np.arange(low, high + 1.0)
    inside = (z_mm <= outer.height_mm[..., None]) & (z_mm >= inner.height_mm[..., None])
    return inside & ok[..., None], float(z_mm[0])


def _ok_heights(boundary: BoundaryMap) -> Floats:
    return np.where(boundary.ok, boundary.height_mm, np.nan)


def _place(boundary: BoundaryMap, first_map: tuple[float, ...], step_mm: float) -> dict[str, Any]:
    """Return the fields that say where the grid of a map lies."""
    steps = np.array((*cell_sizes_mm(boundary), step_mm))
    return {
        "space directions": steps[:, None] * boundary.T_base_map.rotation.T,
        "space origin": boundary.T_base_map @ np.array(first_map),
    }
