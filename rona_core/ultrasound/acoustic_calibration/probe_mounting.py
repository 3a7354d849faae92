"""Mounting of the robot's probe: how far its face stands off its place in the holder.

A gauge plate of steel is screwed onto the holder, which presses the line by known depths. Echo time
over depth is a straight line: its slope gives the speed of sound in the line, its offset where the
uncompressed face ends. Both are those of now: at this temperature, wear and clamping.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.acoustic_calibration.delay_line import FAR_SHARE, clear_faces
from rona_core.ultrasound.detection.single.front_echo import standoff_mm
from rona_core.ultrasound.probe.probe_model import ProbeModel

LEAST_DEPTHS = 3
SCAN_DEPTH_MM = 1.5  # by which 3 N press the line in
LEAST_SPAN_MM = 0.5  # between the depths
FAR_MM = 2.0  # no holder is off by more
UNEVEN_MM = 0.03  # depths that disagree by more are not those of the gauge
LEAST_NOISE_MM = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class ProbeMounting:
    """Where the probe's face is in its holder, and how fast its line is."""

    probe: str
    offset_mm: float  # of the uncompressed face beyond its nominal place, into the bone
    line_delay_us: float  # two-way time through the uncompressed line
    sigma_mm: float  # of the face at the depth of a scan, the gauge's own error in it
    residuals_mm: Floats  # (k,) of the depths
    n_used: int
    verdict: str  # good, weak or bad
    reasons: tuple[str, ...]

    def shift_mm(self, probe: ProbeModel) -> float:
        """Return by how much the outer boundary lies farther out than ``probe`` as drawn has it.

        At the depth of a scan, where offset and line are known together better than either alone.
        """
        length = probe.line_length_mm
        slower = self.line_delay_us / probe.line_delay_us
        left = length - SCAN_DEPTH_MM
        return float((left - self.offset_mm) * slower - left)


def calibrate_mounting(
    tracks: Sequence[AScanTrack],
    depths_mm: Sequence[float] | Floats,
    gauge_sigma_mm: float,
    probe: ProbeModel,
    excitation: Excitation,
) -> ProbeMounting:
    """Return offset and line of a probe from A-scans on a gauge plate.

    Args:
        tracks: A-scans at each depth (k).
        depths_mm: By which the plate presses the line in (k), where the probe sits at its place.
        gauge_sigma_mm: Standard deviation of each depth, and of all together.
        probe: The probe, as its maker describes it.
        excitation: What it sent.

    Raises:
        InvalidInputError: too few depths, or too close together.
        DegenerateGeometryError: no clear echo of the plate.
    """
    depths = np.array([float(depth) for depth in depths_mm])
    if len(tracks) != len(depths) or len(depths) < LEAST_DEPTHS:
        raise InvalidInputError(
            f"a mounting needs A-scans at {LEAST_DEPTHS} depths or more, not {len(tracks)} tracks "
            f"and {len(depths)} depths"
        )
    if np.ptp(depths) < LEAST_SPAN_MM:
        raise InvalidInputError(
            f"the depths span {np.ptp(depths):.2f} mm: take some {LEAST_SPAN_MM} mm apart"
        )
    faces = [clear_faces(track, probe, excitation) for track in tracks]
    standoffs = np.array([float(np.median(standoff_mm(f.delay_us, probe))) for f in faces])
    design = np.column_stack((np.ones(len(depths)), -depths))
    (height, slope), *_ = np.linalg.lstsq(design, standoffs, rcond=None)
    residuals = standoffs - design @ (height, slope)
    # stand-off = (nominal over true speed) (length - depth - offset) - length
    length = probe.line_length_mm
    offset = length - (height + length) / slope
    scatter = max(float(np.sqrt((residuals**2).sum() / (len(depths) - 2))), LEAST_NOISE_MM)
    sigma = float(np.hypot(gauge_sigma_mm, scatter / np.sqrt(len(depths))))
    verdict, reasons = _judged(float(offset), float(slope), residuals)
    return ProbeMounting(
        probe=probe.name,
        offset_mm=float(offset),
        line_delay_us=probe.line_delay_us * float(slope),
        sigma_mm=sigma,
        residuals_mm=readonly(residuals),
        n_used=sum(len(face.delay_us) for face in faces),
        verdict=verdict,
        reasons=reasons,
    )


def _judged(offset: float, slope: float, residuals: Floats) -> tuple[str, tuple[str, ...]]:
    bad: list[str] = []
    if abs(slope - 1.0) > FAR_SHARE:
        bad.append(f"the line is {100 * (slope - 1.0):+.1f} % slower than stated: another echo?")
    if abs(offset) > FAR_MM:
        bad.append(f"the face would be {offset:+.1f} mm off its place: another gauge or probe?")
    if np.abs(residuals).max() > UNEVEN_MM:
        bad.append(f"the depths disagree by {np.abs(residuals).max():.3f} mm: seat the gauge anew")
    return ("bad" if bad else "good"), tuple(bad)
