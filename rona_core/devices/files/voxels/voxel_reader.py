"""Reader of NRRD and NIfTI voxels in slabs, so that no volume lies in memory whole.

The voxels are read from the file itself: a header that points to another file is refused.
"""

import io
import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rona_core.devices.files.size_limits import open_file
from rona_core.devices.files.voxels.refusals import refused
from rona_core.devices.files.voxels.voxel_layers import UNREAD, Voxels, kind_of
from rona_core.errors import InvalidInputError, RonaError
from rona_core.geometry.arrays import Floats

VOLUME_SUFFIXES = (".nrrd", ".nii", ".nii.gz")
VOXELS_MM = (0.1, 3.0)  # edges of a voxel
SKEW = 1e-3  # largest cosine between grid axes
# imported when there is such a file: nibabel takes long
READERS = {"NRRD": ("nrrd_voxels", "begin_nrrd"), "NIfTI": ("nifti_voxels", "begin_nifti")}


@contextmanager
def open_voxels(source: Path | bytes, name: str) -> Generator[Voxels]:
    """Open a volume; errors in its data come while its layers are read.

    Args:
        source: A .nrrd, .nii or .nii.gz file, or its contents.
        name: Of the file; its extension names the format.

    Raises:
        InvalidInputError: no plain file, damaged, foreign, too large, with data elsewhere, or on a
            grid that is skewed or not in millimetres.
    """
    kind = kind_of(name)
    module, function = READERS[kind]
    begin: Callable[[BinaryIO, str], Voxels] = getattr(
        import_module(f"rona_core.devices.files.voxels.{module}"), function
    )
    whole = isinstance(source, bytes)
    try:
        with io.BytesIO(source) if whole else open_file(source, f"a {kind} file") as file:
            voxels = begin(file, name)
            _check_grid(name, voxels.T_mesh_voxel)
            yield voxels
    except RonaError:
        raise
    except Exception as error:  # the libraries throw whatever they like at damaged files
        words = re.sub(r"\s+", " ", str(error))[:160] or type(error).__name__
        raise InvalidInputError(f"{name} {UNREAD}{kind} ({words}): export it again") from error


def _check_grid(name: str, affine: Floats) -> None:
    edges = np.linalg.norm(affine[:3, :3], axis=0)
    if not np.isfinite(affine).all() or not edges.min() > 0.0:
        raise refused("no directions", name=name)
    low, high = VOXELS_MM
    if edges.min() < low:
        raise refused(
            "voxels too small", name=name, edges=edges.round(4).tolist(), low=low, high=high
        )
    if edges.max() > high:
        raise refused("slices too thick", name=name, edges=edges.round(4).tolist(), high=high)
    unit = affine[:3, :3] / edges
    cosine = float(np.abs(unit.T @ unit - np.eye(3)).max())
    if cosine > SKEW:
        angle = float(np.rad2deg(np.arcsin(min(cosine, 1.0))))
        raise refused("a skewed grid", name=name, angle_deg=angle)


def grey_values(name: str, low: float, high: float) -> InvalidInputError:
    """Return the refusal of a volume of grey values, without a threshold."""
    return refused("grey values without a threshold", name=name, low=low, high=high)
