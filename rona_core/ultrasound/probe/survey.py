"""A survey: A-scans with the probe that took them, and where it was at each of them."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.probe_model import ProbeModel


@dataclass(frozen=True, slots=True, eq=False)
class ProbeSurvey:
    """A-scans (n) of one probe; without positions in the order of the path.

    Args:
        track: The A-scans.
        probe: The probe that took them.
        excitation: What it sent.
        positions_mm: Where the probe stood (n, 3), in any fixed frame; None: not known, the
            A-scans support those before and after them only.
        axes: Of the probe, into the bone (n, 3), in the frame of the positions; None: not known.
        known_standoff_mm: Where the outer boundary is (n,), along the axis from the face of the
            uncompressed line, if that is known better than from these A-scans: a probe that is
            tilted towards the inner table hardly detects it. None: found in each A-scan.

    Raises:
        InvalidInputError: another sampling rate than the probe's, or axes or stand-offs of another
            shape, or not finite.
    """

    track: AScanTrack
    probe: ProbeModel
    excitation: Excitation
    positions_mm: Floats | None = None
    axes: Floats | None = None
    known_standoff_mm: Floats | None = None

    def __post_init__(self) -> None:
        n, probe, rate = len(self.track), self.probe, self.track.sampling_mhz
        if n and rate != probe.sampling_mhz:
            raise InvalidInputError(
                f"the {probe.name} probe samples at {probe.sampling_mhz} MHz, "
                f"these A-scans were sampled at {rate} MHz"
            )
        given = (
            ("axes", self.axes, (n, 3)),
            ("known stand-offs", self.known_standoff_mm, (n,)),
        )
        for what, values, shape in given:
            if values is not None and (values.shape != shape or not np.isfinite(values).all()):
                raise InvalidInputError(
                    f"{n} A-scans need {what} of shape {shape}, all finite: "
                    f"got {values.shape}, {int(np.isfinite(values).sum())} numbers finite"
                )

    def __len__(self) -> int:
        return len(self.track)
