"""Iso-surface of an echo volume, by surface nets."""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.mesh import surface_nets
from rona_core.mapping.volume.echo_volume import SILENCE, EchoVolume

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
