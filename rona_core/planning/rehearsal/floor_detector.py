"""Detector of the inner boundary below the floor of a bed, with all that is known of the probe."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.acoustic_calibration.reference_points import at_speed
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    speed_at,
    uncalibrated,
)
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, detect
from rona_core.ultrasound.probe.probe_model import ProbeModel, ProbeSurvey

# relative sigma of the speed in what is left against that in the whole bone: of what is left none
# to all is diploe (two sigmas to either side), which is 15 to 20 % slower than the tables
MIXED_SHARE = 0.25 * 0.175


@dataclass(frozen=True, slots=True, eq=False)
class FloorDetector:
    """Measures the bone below a bed; a ``MeasureFloor``."""

    T_base_bed: Pose
    probe: ProbeModel
    excitation: Excitation
    bone_loss: float | None  # over the nominal one, as the scan of the bone found it
    speed: SpeedCalibration | None  # None: the published one

    def __call__(
        self, track: AScanTrack, places_bed: Floats
    ) -> tuple[Floats, Floats, Bools, float]:
        """Return thickness, sigma and whether it is sure (m,), and the speed's relative sigma."""
        places = self.T_base_bed @ places_bed
        axis = -self.T_base_bed.rotation[:, 2]
        found = detect(
            ProbeSurvey(
                track,
                self.probe,
                self.excitation,
                positions_mm=places,
                axes=np.tile(axis, (len(places), 1)),
            ),
            sound_speed_mm_per_us=NOMINAL_SPEED_MM_PER_US,
            bone_loss=self.bone_loss,
        )
        known = uncalibrated() if self.speed is None else self.speed
        speeds, sigmas = speed_at(known, places)
        found = at_speed(found, speeds)
        share = float(np.hypot(MIXED_SHARE, (sigmas / speeds).mean()))
        return found.thickness_mm, found.thickness_sigma_mm, found.inner_ok, share
