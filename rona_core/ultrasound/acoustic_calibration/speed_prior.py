"""Prior distribution of the speed of sound in a skull, from published data alone.

Means of studies, through bone of which 45 % is diploe, at 2.25 MHz and in mm/us: 2.55 (Aubry 2022),
2.69 (Pichardo 2011), 2.71 (Fry 1978), 2.82 (White 2006). Which of them holds for a patient is not
knows, and pieces of bone of one study differ: of skull by 1.4 % (White 2006), of cortical bone by
7 % (17 pieces, Mathieu 2013). Places of one patient differ by 1.4 % at least, as if those pieces of
skull were one patient's, and by up to 5 %, where a diploe 15 to 20 % slower takes 0.2 to 0.7 of the
thickness. A piece is a place of a patient: what pieces differ by holds places in it, and patients
have the rest.
"""

from dataclasses import dataclass, field

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US

STUDY_MEANS_MM_PER_US = (2.55, 2.69, 2.71, 2.82)
STUDIES_SHARE = float(np.std(STUDY_MEANS_MM_PER_US, ddof=1) / np.mean(STUDY_MEANS_MM_PER_US))
PIECE_SHARES = (0.014, 0.07)  # of pieces about the mean of their study, least and most
PLACE_SHARES = (0.014, 0.05)  # of places about the mean of their patient, least and most


def _log_sd(least: float, most: float) -> float:
    """Return a range as a logarithm's deviation: its ends are two of them to either side."""
    return float(np.log(most / least) / 4.0)


def _rms(least: float, most: float) -> float:
    """Return the RMS of a spread that lies in a range."""
    return float(np.sqrt(least * most) * np.exp(_log_sd(least, most) ** 2))


LOCAL_LOG_SD = _log_sd(*PLACE_SHARES)
LOCAL_SHARE = _rms(*PLACE_SHARES)
# of patients about the mean of their study: what places leave of pieces
WITHIN_STUDY_SHARE = float(np.sqrt(_rms(*PIECE_SHARES) ** 2 - LOCAL_SHARE**2))
# of a patient, for whom it is unknown which study holds
PATIENTS_SHARE = float(np.hypot(STUDIES_SHARE, WITHIN_STUDY_SHARE))
LOCAL_LENGTH_MM = 20.0  # over which the diploe's share, and with it the speed, changes
TIMING_US = 0.03  # of all lags together: what is not known of the pulse and of rough boundaries
PLAUSIBLE_MM_PER_US = (2.1, 3.3)  # from trabecular bone alone to the stiffest cortex


@dataclass(frozen=True, slots=True)
class SpeedPrior:
    """Prior distribution of the speed: mean, spread between patients and between places."""

    mean_mm_per_us: float = NOMINAL_SPEED_MM_PER_US
    patient_sd_mm_per_us: float = PATIENTS_SHARE * NOMINAL_SPEED_MM_PER_US  # studies in it
    local_sd_mm_per_us: float = LOCAL_SHARE * NOMINAL_SPEED_MM_PER_US  # RMS over patients
    local_length_mm: float = LOCAL_LENGTH_MM
    # of the logarithm of that spread, between patients; 0: all have the same, as in older files
    local_log_sd: float = field(default=0.0, metadata={"omit_empty": True})
    timing_us: float = field(default=0.0, metadata={"omit_empty": True})

    def __post_init__(self) -> None:
        low, high = PLAUSIBLE_MM_PER_US
        if not low <= self.mean_mm_per_us <= high:
            raise InvalidInputError(
                f"the speed in bone must be {low} to {high} mm/us: {self.mean_mm_per_us}"
            )
        spreads = (self.patient_sd_mm_per_us, self.local_sd_mm_per_us)
        if not (0 < min(spreads) and max(spreads) < 1.0 and 0 < self.local_length_mm < 1e3):
            raise InvalidInputError("spreads and the length of a speed must be positive and small")
        if not (0 <= self.local_log_sd < 2.0 and 0 <= self.timing_us < 2.0):
            raise InvalidInputError("spread of a spread and shared timing must be 0 or small")


PUBLISHED = SpeedPrior(local_log_sd=LOCAL_LOG_SD, timing_us=TIMING_US)
