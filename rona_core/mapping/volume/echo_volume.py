"""Echo volume: amplitudes of all A-scans on one grid in the frame of the maps."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.mesh import surface_nets
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.files.nrrd_file import nrrd_bytes

SILENCE = 1e-6  # amplitude that stands for none, where a logarithm is taken
NOISE_MM = 2.0  # at the bottom of a volume, below any inner boundary, there is noise alone


@dataclass(frozen=True, slots=True, eq=False)
class EchoVolume:
    """Linear echo amplitude over the columns (nu, nv) of a map and the heights (nz,) of its z axis.

    1 is the front echo of flat bone in perfect contact. Voxels that are neither ``measured`` nor
    ``filled`` are not known, and 0.
    """

    outer: BoundaryMap  # of the same columns: frame, places, and height of the front echo
    z_mm: Floats  # (nz,) ascending, out of the bone, even
    amplitude: NDArray[np.float32]  # (nu, nv, nz)
    measured: Bools  # (nu, nv, nz) an A-scan passes within a cell
    filled: Bools  # (nu, nv, nz) a hole that was filled from measured voxels
    blind_mm: float  # below the outer boundary; so deep the front echo hides what lies there
    deepest_mm: float  # below the outer boundary; no voxel is known further down

    @property
    def T_base_map(self) -> Pose:
        """Return the frame of the grid, z out of the bone."""
        return self.outer.T_base_map

    @property
    def known(self) -> Bools:
        """Return which voxels (nu, nv, nz) hold an amplitude."""
        return self.measured | self.filled

    @property
    def steps_mm(self) -> tuple[float, float, float]:
        """Return the size of a voxel along u, v and z."""
        u, v, z = self.outer.u_mm, self.outer.v_mm, self.z_mm
        return float(u[1] - u[0]), float(v[1] - v[0]), float(z[1] - z[0])

    def depths_mm(self) -> Floats:
        """Return how far below the outer boundary each voxel lies (nu, nv, nz), along z."""
        return self.outer.height_mm[:, :, None] - self.z_mm

    def level_db(self, gain_db_per_mm: float = 0.0) -> NDArray[np.float32]:
        """Return the levels (nu, nv, nz) in dB, raised by a gain with depth (time-gain control).

        Args:
            gain_db_per_mm: For each mm below the outer boundary; nothing is raised above it.
        """
        level = 20.0 * np.log10(np.maximum(self.amplitude, SILENCE))
        if gain_db_per_mm:
            level = level + gain_db_per_mm * np.clip(self.depths_mm(), 0.0, self.deepest_mm)
        return level.astype(np.float32)

    def noise(self) -> float:
        """Return the median amplitude below the thickest bone; 0 where nothing is known there."""
        depths = self.depths_mm()
        deep = self.known & (depths > self.deepest_mm - NOISE_MM) & (depths <= self.deepest_mm)
        return float(np.median(self.amplitude[deep])) if deep.any() else 0.0


ABOVE_NOISE_DB = 6.0  # a surface in what is fainter is one of noise
LEVELS_DB = (-80.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class IsoSurface:
    """Triangles where the echoes have one level, facing what is quieter."""

    points_base: Floats  # (n, 3)
    faces: Ints  # (m, 3) rows of the points
    depths_mm: Floats  # (n,) below the outer boundary, along z of the map

    def __len__(self) -> int:
        return len(self.faces)


def iso_surface(volume: EchoVolume, level_db: float, gain_db_per_mm: float = 0.0) -> IsoSurface:
    """Return the surface of a level; it is open where voxels are not known.

    It ends at the depth from which the gain raises noise to the level.

    Args:
        volume: In which the surface is sought.
        level_db: Over the front echo of flat bone in perfect contact.
        gain_db_per_mm: With depth, see ``EchoVolume.level_db``.

    Raises:
        InvalidInputError: the level is out of range.
    """
    if not LEVELS_DB[0] <= level_db <= LEVELS_DB[1]:
        raise InvalidInputError(
            f"the level must be {LEVELS_DB[0]:g} to {LEVELS_DB[1]:g} dB: {level_db:g}"
        )
    over = volume.level_db(gain_db_per_mm).astype(np.float64) - level_db
    noise_db = 20.0 * np.log10(max(volume.noise(), SILENCE))
    audible = level_db - gain_db_per_mm * volume.depths_mm() >= noise_db + ABOVE_NOISE_DB
    places, faces = surface_nets(over, volume.known & audible)
    u, v = volume.outer.u_mm, volume.outer.v_mm
    points_map = places * volume.steps_mm + (u[0], v[0], volume.z_mm[0])
    i, j = (np.rint(places[:, k]).astype(np.int64) for k in (0, 1))
    depths = volume.outer.height_mm[i, j] - points_map[:, 2]
    return IsoSurface(readonly(volume.T_base_map @ points_map), faces, readonly(depths))


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
