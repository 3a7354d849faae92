"""How sure a thickness is: what patient, place, timing and wedge each add to its error."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.acoustic_calibration.speed_prior import TIMING_US


@dataclass(frozen=True, slots=True, eq=False)
class ThicknessBudget:
    """Standard deviation of thicknesses (n,) in mm, and the shares of it."""

    sigma_mm: Floats
    patient_mm: Floats  # by the mean speed of the patient
    local_mm: Floats  # by the place
    timing_mm: Floats
    wedge_mm: Floats  # by an inner boundary that is not parallel to the outer one


def thickness_budget(
    thickness_mm: ArrayLike,
    calibration: SpeedCalibration,
    *,
    lag_sigma_us: ArrayLike = TIMING_US,
    wedge_sigma_mm: ArrayLike = 0.0,
) -> ThicknessBudget:
    """Return how sure thicknesses (n,) are, and why no surer.

    Args:
        thickness_mm: As measured with the calibrated speed.
        calibration: Of the speed.
        lag_sigma_us: Standard deviation of the lags, one or (n,).
        wedge_sigma_mm: What an inner boundary that is not parallel adds, one or (n,).

    Raises:
        InvalidInputError: values that are not finite or negative.
    """
    d = np.atleast_1d(as_floats(thickness_mm, name="thickness_mm"))
    lag_sigma = np.broadcast_to(as_floats(lag_sigma_us, name="lag_sigma_us"), d.shape)
    wedge = np.broadcast_to(as_floats(wedge_sigma_mm, name="wedge_sigma_mm"), d.shape)
    if min(d.min(initial=0.0), lag_sigma.min(initial=0.0), wedge.min(initial=0.0)) < 0:
        raise InvalidInputError("thicknesses and standard deviations must not be negative")
    patient = d * calibration.sigma_mm_per_us / calibration.speed_mm_per_us
    local = d * calibration.local_sd_mm_per_us / calibration.speed_mm_per_us
    timing = lag_sigma * calibration.speed_mm_per_us / 2.0
    sigma = np.sqrt(patient**2 + local**2 + timing**2 + wedge**2)
    return ThicknessBudget(
        readonly(sigma), readonly(patient), readonly(local), readonly(timing), readonly(wedge + 0.0)
    )
