"""Voxels of a NIfTI file, header and data in one."""

import gzip
from typing import Any, BinaryIO

import nibabel
import numpy as np

from rona_core.devices.files.voxels.refusals import refused
from rona_core.devices.files.voxels.voxel_layers import UNREAD, Voxels, checked_shape, layers_of
from rona_core.errors import InvalidInputError

GZIP_MAGIC = b"\x1f\x8b"
UNITS_MM = {"meter": 1000.0, "micron": 0.001}
KINDS = "fiu"  # values that can be compared: float, int, unsigned
HEADERS = {348: nibabel.Nifti1Header, 540: nibabel.Nifti2Header}
SINGLE_FILE = (b"n+1", b"n+2")  # a pair of header and image says ni1 or ni2


def begin_nifti(file: BinaryIO, name: str) -> Voxels:
    """Return the voxels of a file, of which the header is read."""
    zipped = file.read(2) == GZIP_MAGIC
    file.seek(0)
    stream: Any = gzip.GzipFile(fileobj=file) if zipped else file
    start = stream.read(4)
    size = next(
        (n for order in ("little", "big") if (n := int.from_bytes(start, order)) in HEADERS), 0
    )
    if not size:
        raise InvalidInputError(
            f"{name} {UNREAD}NIfTI (its header has another size): export it again"
        )
    header: Any = HEADERS[size](start + stream.read(size - 4))
    if bytes(header["magic"])[:3] not in SINGLE_FILE:
        raise refused("voxels in another file", name=name)
    shape = tuple(int(n) for n in header.get_data_shape())
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    checked = checked_shape(name, shape)
    unit = header.get_xyzt_units()[0]
    if unit in UNITS_MM:
        raise refused("another unit", name=name, unit=unit, factor=UNITS_MM[unit])
    dtype = header.get_data_dtype()
    if dtype.kind not in KINDS:
        raise InvalidInputError(f"{name} holds values of type {dtype}: expected numbers")
    skip = int(header.get_data_offset()) - size
    if skip < 0:
        raise InvalidInputError(f"{name} {UNREAD}NIfTI: its voxels begin too early")
    while skip and (part := stream.read(min(skip, 1 << 20))):  # extensions of the header
        skip -= len(part)
    slope, start_value = header.get_slope_inter()
    layers = layers_of(stream.read, checked, dtype, name, to_the_end=False)
    if slope is not None and (slope, start_value) != (1.0, 0.0):
        layers = (layer.astype(np.float64) * slope + start_value for layer in layers)
    return Voxels(checked, np.array(header.get_best_affine(), dtype=np.float64), -1, layers)
