"""Calibration of a probe's delay line on a flat metal block, at one temperature or several.

The line stands on the block with a film of coupling fluid; the first echo is that of its face. Its
delay places the outer boundary of the bone, and changes by some 0.1 % a kelvin.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.robust import mad_sigma
from rona_core.ultrasound.detection.single.front_echo import find_fronts
from rona_core.ultrasound.detection.single.matched_filter import (
    BONE_REFLECTION,
    block_template,
    trace_spectra,
)
from rona_core.ultrasound.probe.materials import GEL
from rona_core.ultrasound.probe.probe_model import ProbeModel

BLOCK_REFLECTION = 0.93  # of steel against gel; brass 0.92, aluminium 0.84
LEAST_SNR = 20.0
LEAST_SCANS = 3
TEMPERATURES_C = (0.0, 50.0)
LEAST_SPREAD_C = 3.0  # between temperatures, for a coefficient
NOMINAL_PER_K = 0.0017  # relative change of the delay of an elastomer: speed falls 2.7 m/s/K
PER_K_SD = 0.0006  # and how far elastomers differ in that
PER_K_LIMIT = 0.006
STEADY_US = 0.01  # scatter of a line at rest; more is a film that is still being pressed out
FAR_SHARE = 0.06  # off the nominal delay: not this line, or not its face
LEVEL_RANGE = (0.4, 1.6)  # amplitude over that expected from the block
FAR_SD = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class DelayLine:
    """The two-way time through the uncompressed line at a temperature."""

    probe: str
    delay_us: float  # at the reference temperature
    sigma_us: float
    reference_c: float
    slope_us_per_k: float
    slope_sigma_us_per_k: float
    slope_measured: bool  # False: the nominal one, temperatures were too alike
    level: float  # amplitude over that of a perfect mirror on a nominal line
    residuals_us: Floats  # (n,) of the A-scans that were used
    n_used: int
    n_rejected: int
    verdict: str  # "good", "weak" or "bad"
    reasons: tuple[str, ...]

    def at(self, temperature_c: float) -> tuple[float, float]:
        """Return the delay and its standard deviation at a temperature, in us.

        Raises:
            InvalidInputError: a temperature that no line is used at.
        """
        _check_temperature(temperature_c)
        away = temperature_c - self.reference_c
        sigma = float(np.hypot(self.sigma_us, self.slope_sigma_us_per_k * away))
        return self.delay_us + self.slope_us_per_k * away, sigma


def calibrate_delay_line(
    tracks: Sequence[AScanTrack],
    temperatures_c: Sequence[float],
    probe: ProbeModel,
    excitation: Excitation,
    *,
    film_mm: float = 0.0,
) -> DelayLine:
    """Return the delay of the line from A-scans on a block, a capture for each temperature.

    Args:
        tracks: Captures of the line at rest on the block.
        temperatures_c: Of the line in each capture.
        probe: The nominal probe.
        excitation: What it sent.
        film_mm: Fluid between line and block, where it is known; its time is taken off.

    Raises:
        InvalidInputError: not a capture for each temperature, no A-scans, clipped ones, another
            sampling rate, or temperatures that no line is used at.
        DegenerateGeometryError: no clear echo of a face.
    """
    _check(tracks, temperatures_c, probe, film_mm)
    faces = [clear_faces(track, probe, excitation) for track in tracks]
    film_us = 2.0 * film_mm / GEL.speed_mm_per_us
    delays = [face.delay_us + probe.line_delay_us - film_us for face in faces]
    line = _fit_line(delays, temperatures_c, probe)
    level = float(np.median(np.concatenate([face.level for face in faces])))
    expected = BLOCK_REFLECTION / BONE_REFLECTION
    verdict, reasons = _judged(line, level / expected, probe)
    delay = np.concatenate(delays)
    return DelayLine(
        probe=probe.name,
        delay_us=line.middle_us,
        sigma_us=float(max(line.scatter_us, 1e-4) / np.sqrt(len(tracks))),
        reference_c=line.reference_c,
        slope_us_per_k=line.slope,
        slope_sigma_us_per_k=line.slope_sigma,
        slope_measured=line.slope_measured,
        level=level * BONE_REFLECTION,
        residuals_us=readonly(line.residuals_us),
        n_used=len(delay),
        n_rejected=sum(face.rejected for face in faces),
        verdict=verdict,
        reasons=reasons,
    )


def calibrated_probe(probe: ProbeModel, line: DelayLine, temperature_c: float) -> ProbeModel:
    """Return the probe with the calibrated delay: what detection takes in place of the nominal one.

    Raises:
        InvalidInputError: the calibration is of another probe, or bad.
    """
    if line.probe != probe.name:
        raise InvalidInputError(f"the line of the {line.probe} probe is not that of {probe.name}")
    if line.verdict == "bad":
        raise InvalidInputError(f"this calibration cannot be used: {'; '.join(line.reasons)}")
    return probe.with_line_delay(line.at(temperature_c)[0])


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """Echoes (n,) of the metal face in one capture."""

    delay_us: Floats  # against the nominal one
    level: Floats  # over flat bone
    rejected: int


def clear_faces(track: AScanTrack, probe: ProbeModel, excitation: Excitation) -> Faces:
    """Return the clear echoes of the face in a capture."""
    template = block_template(probe, excitation)
    spectra, noise = trace_spectra(track.rf.astype(np.float64), track.start_us, template)
    front = find_fronts(spectra, noise, template)
    ok = (front.snr > LEAST_SNR) & front.positive & ~np.asarray(track.clipped)
    if ok.sum() < LEAST_SCANS:
        raise DegenerateGeometryError(
            f"{int(ok.sum())} of {len(track)} A-scans show the clear echo of a metal face, "
            f"at least {LEAST_SCANS} are needed: press the line flat onto the block"
        )
    delay = front.delay_us[ok]
    off = np.abs(delay - np.median(delay))
    kept = off <= max(FAR_SD * mad_sigma(off), 1e-3)
    return Faces(delay[kept], front.level[ok][kept], len(track) - int(kept.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """The delay over temperature: a straight line through the captures."""

    middle_us: float  # at the reference temperature
    reference_c: float
    slope: float  # us per kelvin
    slope_sigma: float
    slope_measured: bool
    scatter_us: float  # of A-scans within a capture
    residuals_us: Floats  # (n,) of all A-scans


def _fit_line(delays: list[Floats], temperatures_c: Sequence[float], probe: ProbeModel) -> _Line:
    """Fit delay over temperature by weighted least squares through the captures' medians."""
    kelvin = np.concatenate(
        [np.full(len(d), float(t)) for d, t in zip(delays, temperatures_c, strict=True)]
    )
    reference = float(kelvin.mean())
    measured = float(np.ptp(kelvin)) >= LEAST_SPREAD_C
    slope, slope_sigma = NOMINAL_PER_K * probe.line_delay_us, PER_K_SD * probe.line_delay_us
    scatter = mad_sigma(np.concatenate([d - np.median(d) for d in delays]))
    medians = np.array([float(np.median(d)) for d in delays])
    at = np.array([float(t) for t in temperatures_c])
    weights = np.array([float(len(d)) for d in delays])
    if measured:
        centred = at - (weights * at).sum() / weights.sum()
        power = (weights * centred**2).sum()
        slope = float((weights * centred * medians).sum() / power)
        # one capture, one film: captures scatter more than A-scans do
        slope_sigma = float(max(scatter, 1e-4) * np.sqrt(weights.mean() / power))
    middle = float((weights * (medians - slope * (at - reference))).sum() / weights.sum())
    residuals = np.concatenate(delays) - middle - slope * (kelvin - reference)
    return _Line(middle, reference, slope, slope_sigma, measured, scatter, residuals)


def _judged(line: _Line, level: float, probe: ProbeModel) -> tuple[str, tuple[str, ...]]:
    bad: list[str] = []
    weak: list[str] = []
    off = line.middle_us / probe.line_delay_us - 1.0
    if abs(off) > FAR_SHARE:
        bad.append(
            f"the delay is {100 * off:+.1f} % off that of a {probe.name} line: another echo?"
        )
    if abs(line.slope) > PER_K_LIMIT * probe.line_delay_us:
        bad.append(f"the delay changes by {line.slope:.3f} us/K, more than that of any line")
    low, high = LEVEL_RANGE
    if not low <= level <= high:
        weak.append(f"the echo has {level:.2f} of the height expected: tilt, air, or another block")
    if line.scatter_us > STEADY_US:
        weak.append(f"the delay scatters by {line.scatter_us:.3f} us: hold the probe still")
    if not line.slope_measured:
        weak.append("one temperature: the change with temperature is the nominal one")
    verdict = "bad" if bad else "weak" if weak else "good"
    return verdict, (*bad, *weak)


def _check(
    tracks: Sequence[AScanTrack],
    temperatures_c: Sequence[float],
    probe: ProbeModel,
    film_mm: float,
) -> None:
    if not len(tracks) or len(tracks) != len(temperatures_c):
        raise InvalidInputError(
            f"expected a capture for each temperature, got {len(tracks)} and {len(temperatures_c)}"
        )
    for temperature in temperatures_c:
        _check_temperature(temperature)
    if not 0.0 <= film_mm <= 2.0:
        raise InvalidInputError(f"the film must be 0 to 2 mm thick: {film_mm}")
    for track in tracks:
        if not len(track):
            raise InvalidInputError("a capture without A-scans calibrates nothing")
        if track.sampling_mhz != probe.sampling_mhz:
            raise InvalidInputError(
                f"the {probe.name} probe samples at {probe.sampling_mhz} MHz, "
                f"these A-scans were sampled at {track.sampling_mhz} MHz"
            )
        if np.asarray(track.clipped).all():
            raise InvalidInputError("all A-scans on the block are clipped: lower the gain")


def _check_temperature(temperature_c: float) -> None:
    low, high = TEMPERATURES_C
    if not low <= temperature_c <= high:
        raise InvalidInputError(
            f"the temperature of the line must be {low:g} to {high:g} degrees C: {temperature_c}"
        )
