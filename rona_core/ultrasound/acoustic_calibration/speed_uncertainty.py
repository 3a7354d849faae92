"""Relative uncertainty of the speed of sound: the share of the patient and that of the place."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration, speed_at

# The mean speeds of respectable studies of skull bone differ by 13 % (White 2006, Pichardo 2011).
# Which of them holds for a patient nobody knows: evenly spread over that range.
STUDIES_APART = 0.13
STUDIES_SHARE = STUDIES_APART / 12.0**0.5


def speed_uncertainty(calibration: SpeedCalibration, places_mm: ArrayLike) -> tuple[Floats, Floats]:
    """Return the relative standard deviations (n,) of the speed at places (n, 1 to 3), two parts.

    The first all places share: the mean of the patient. Its prior stands for patients about the
    published mean; what studies differ by is added as far as reference points have not replaced
    that prior. The second is that of the place against that mean.

    Args:
        calibration: Of the speed; the prior alone, where nothing was calibrated.
        places_mm: In the frame of the reference points.

    Raises:
        InvalidInputError: places of another shape than those of the reference points.
    """
    speed, sigma = speed_at(calibration, places_mm)
    relative, prior = sigma / speed, calibration.prior
    patient = np.minimum(calibration.sigma_mm_per_us / speed, relative)
    place = np.sqrt(np.maximum(relative**2 - patient**2, 0.0))
    share = prior.patient_sd_mm_per_us / prior.mean_mm_per_us
    studies = np.sqrt(max(STUDIES_SHARE**2 - share**2, 0.0))
    total = prior.patient_sd_mm_per_us**2 + prior.local_sd_mm_per_us**2
    # of the prior's variance: what the mean of the patient still owes to it, and the place
    left = np.minimum(
        (calibration.sigma_mm_per_us / prior.patient_sd_mm_per_us) ** 2, sigma**2 / total
    )
    return np.hypot(patient, left * studies), place
