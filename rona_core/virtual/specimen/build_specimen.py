"""Build the specimen that a session names."""

from functools import lru_cache

from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import as_vector3
from rona_core.session.specimen import LoadedSkull, SimulatedSkull
from rona_core.virtual.specimen.boundaries import RADII_MM, SMOOTH, Relief, Specimen
from rona_core.virtual.specimen.imported.imported_skull import LoadedSpecimen
from rona_core.virtual.specimen.simulated.patient_sampling import step_relief
from rona_core.virtual.specimen.simulated.simulated_skull import SimulatedSpecimen

__all__ = ["Specimen", "build_specimen"]


def build_specimen(
    choice: SimulatedSkull | LoadedSkull,
    seed: int,
    *,
    center_mesh_mm: ArrayLike | None = None,
    radius_mm: float = 25.0,
    relief: Relief = SMOOTH,
) -> Specimen:
    """Return the specimen of a session; the same arguments give the same one.

    Up to four are kept and shared. What one computes on demand it keeps, and never changes.

    Args:
        choice: What is scanned.
        seed: Of the session; which simulated patient.
        center_mesh_mm: Centre of the region (3,) in ``skull``, on or near the outer surface. None:
            35 mm behind and 45 mm above the ear canal, or the stored region of a loaded skull.
        radius_mm: Radius of the region.
        relief: Unevenness of the boundaries, drawn from the seed. A loaded skull has its own,
            but for the step from outer table to diploe, which no file shows.

    Raises:
        InvalidInputError: a centre off the bone, or outside what was stored of a loaded skull.
    """
    low, high = RADII_MM
    if not low <= radius_mm <= high:
        raise InvalidInputError(f"radius_mm must be {low:g} to {high:g}, not {radius_mm}")
    if center_mesh_mm is None:
        return _build(choice, seed, None, radius_mm, relief)
    x, y, z = (float(value) for value in as_vector3(center_mesh_mm, name="center_mesh_mm"))
    return _build(choice, seed, (x, y, z), radius_mm, relief)


@lru_cache(maxsize=4)
def _build(
    choice: SimulatedSkull | LoadedSkull,
    seed: int,
    center: tuple[float, float, float] | None,
    radius_mm: float,
    relief: Relief,
) -> Specimen:
    if isinstance(choice, SimulatedSkull):
        return SimulatedSpecimen(seed, choice.side, center, radius_mm, relief)
    return LoadedSpecimen(choice, center, radius_mm, step_relief(seed, relief))
