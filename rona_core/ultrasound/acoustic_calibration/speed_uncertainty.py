"""Relative uncertainty of the speed of sound: what a region shares, and what each place has."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    as_places,
    field_at,
)


def speed_uncertainty(
    calibration: SpeedCalibration, places_mm: ArrayLike, region_mm: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Return the relative standard deviations (n,) of the speed at places (n, 1 to 3), two parts.

    The first all places share: that of the mean over the region. The second is that of the place
    against that mean.

    Args:
        calibration: Of the speed; the prior alone, where nothing was calibrated.
        places_mm: In the frame of the reference points.
        region_mm: Places (m, 1 to 3) that what is shared is meant for; without, those asked for.

    Raises:
        InvalidInputError: places of another shape than those of the reference points.
    """
    places = as_places(places_mm, calibration)
    region = places if region_mm is None else as_places(region_mm, calibration)
    field = field_at(calibration, places, region)
    shared = np.sqrt(field.region_variance) / field.mean
    return shared, np.sqrt(field.own_variance) / field.mean
