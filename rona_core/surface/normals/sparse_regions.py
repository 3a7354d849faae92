"""Regions where the cloud is too sparse for normals, with the reason."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, as_points, readonly
from rona_core.surface.normals.normals import Normals

MAX_SIGMA_DEG = 1.0  # a probe of 6 mm at 5 MHz loses half its echo at 1.0 degree, of 3 mm at 2.1
MOST = 16.0  # times as many points; more are not asked for at once
REASONS = {
    "too_few": "too few points near",
    "rank_deficient": "points along one strand only: slide across as well",
    "not_flat": "points as thick as wide: lifted pointer, or an edge",
    "one_sided": "points on one side only: slide beyond",
    "edge_on": "surface seen from its edge",
    "widened": "too few points near: a wider neighbourhood had to serve",
    "uncertain": "noise or fine relief leaves the normal uncertain: slide slower or denser",
}


@dataclass(frozen=True, slots=True, eq=False)
class ThinPlaces:
    """Places that another pass of the pointer would help, the worst first."""

    points_base: Floats  # (k, 3)
    places: Ints  # (k,) their numbers among the places that were asked about
    reasons: tuple[str, ...]  # keys of ``REASONS``
    times: Floats  # (k,) how many times as many points would do

    def __len__(self) -> int:
        return len(self.places)


def thin_places(
    normals: Normals, at: ArrayLike, *, max_sigma_deg: float = MAX_SIGMA_DEG
) -> ThinPlaces:
    """Return where ``normals`` are refused, served by a wider neighbourhood, or too uncertain.

    Args:
        normals: What ``NormalField.normals`` found.
        at: The places (m, 3) it was asked about.
        max_sigma_deg: Largest predicted error that is good enough.

    Raises:
        InvalidInputError: another number of places, or a bound that is not positive.
    """
    places = as_points(at, name="at")
    if len(places) != len(normals):
        raise InvalidInputError(f"{len(normals)} normals need as many places, not {len(places)}")
    if not 0.0 < max_sigma_deg < np.inf:
        raise InvalidInputError(f"max_sigma_deg must be positive, not {max_sigma_deg}")
    reasons = np.array(normals.flags, dtype=object)
    reasons[(reasons == "ok") & (normals.sigma_deg > max_sigma_deg)] = "uncertain"
    # the error falls with the root of the number of points
    times = np.clip((normals.sigma_deg / max_sigma_deg) ** 2, 1.0, MOST)
    if normals.radii_mm is not None:
        wide = normals.radii_mm > normals.radius_mm
        times = np.maximum(times, np.minimum((normals.radii_mm / normals.radius_mm) ** 2, MOST))
        reasons[(reasons == "ok") & wide] = "widened"
    times = np.where(np.isin(reasons, ("ok", "uncertain", "widened")), times, MOST)
    thin = np.flatnonzero(reasons != "ok")
    thin = thin[np.argsort(-times[thin], kind="stable")]
    return ThinPlaces(
        points_base=readonly(places[thin]),
        places=readonly(thin),
        reasons=tuple(str(reason) for reason in reasons[thin]),
        times=readonly(times[thin]),
    )
