"""The time of an inner echo that leans: fitted together with the lean, neighbours being asked.

Where the inner table leans against the outer one, one side of the beam is heard before the other.
That dulls the echo, puts a null into its band and delays what is left, so that a template of a
parallel plate fits best a whole cycle off, and so it does at the next place, which leans as much.
Here every time is weighed with every slope that the beam may see, and how high the echo stands then
tells the right pair: a parallel boundary would have to reflect far too little.

The fit of a parallel boundary (``refine.py``) is as exact as noise allows. What is done here moves
its time by steps, and only where lean or neighbours ask for it: other times than that one count for
less the less the boundary leans.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats
from rona_core.ultrasound.detection.single.candidates import BLOCK, Echoes
from rona_core.ultrasound.detection.single.front_echo import standoff_mm, subtract_fronts
from rona_core.ultrasound.detection.single.inner_echo import InnerChoice, bone_filter
from rona_core.ultrasound.detection.spatial.detectability import loud_enough
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links, plane_axes
from rona_core.ultrasound.detection.spatial.robust_planes import FLOOR, LEAST, LocalPlanes
from rona_core.ultrasound.probe.beam import probe_beam
from rona_core.ultrasound.probe.excitation import GRID
from rona_core.ultrasound.probe.materials import GEL, Complexes, Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

Singles = NDArray[np.float32]
STEEPEST = 2.2  # slope, over that at which a disc hears nothing at the centre frequency
SLOPES = 14  # that are tried, from 0
REACH_US = 0.65  # around the time as it is: further off is another boundary
STEPS_PER_CYCLE = 18
CLUTTER = 0.8  # what the template does not know, over a nominal echo, at each frequency
ALIKE = 2.0  # neighbouring frequencies do not err on their own: so much less they count
LEVEL_SD = 0.45  # natural logarithm of the level about that of the survey
LEAST_LEVEL = 1e-3
HELD_CYCLES = 0.3  # how far off a time may be that was fitted for a parallel boundary,
FLAT = 0.3  # if the slope is under this share of the steepest one
WITNESS = 0.5  # sureness from which on an echo is a witness for those beside it
ROUNDS = 4
OUTER_SD_MM = 0.03
EXPECTED_SD_US = 0.1  # of a time about the plane through its neighbours
SLOPE_SD = 0.05  # of a slope in us per mm about that of this plane
UNKNOWN_SD = 0.08  # where nothing tells the slope
STRANGERS = 1.5  # how much neighbours can weigh against the echo itself
BEND_PER_MM = 0.01  # where a boundary leans it also bends, by so much of its slope,
BEND_US_PER_MM2 = 4e-4  # and a little everywhere: the wider the beam, the less one time says
STRUCTURE_CYCLES = 0.035  # what the boundary itself adds: roughness, bend, layers,
LEANING_CYCLES = 0.11  # and with the outer boundary taken from a map


@dataclass(frozen=True, slots=True, eq=False)
class _Weighed:
    """What the A-scans (n,) say of each slope (s,) and time (t,) about the time they had."""

    slopes: Floats  # (s,) us per mm
    offsets_us: Floats  # (t,)
    likelihood: Singles  # (n, s, t) logarithm
    level: Singles  # (n, s, t) natural logarithm of the echo over a nominal one


def beam_transform(probe: ProbeModel, frequencies_mhz: Floats, slopes: Floats) -> Complexes:
    """Return what a boundary does to its echo (s, f) whose time rises by slopes (s,) in us per mm.

    It is the transform of the beam on the face of the line: 1 for a slope of 0.
    """
    beam = probe_beam(probe)
    ways = np.multiply.outer(beam.frequencies_mhz, beam.points_mm[:, 0])  # (f, rays)
    flat = beam.weights.sum(axis=0)
    seen = np.stack(
        [(beam.weights.T * np.exp(-2j * np.pi * ways * s)).sum(axis=1) / flat for s in slopes]
    )
    known = beam.frequencies_mhz
    return np.stack(
        [
            np.interp(frequencies_mhz, known, row.real)
            + 1j * np.interp(frequencies_mhz, known, row.imag)
            for row in seen
        ]
    )


def refit_wedges(
    echoes: Echoes,
    found: InnerChoice,
    bone: Material,
    positions_mm: Floats,
    links: Links,
    *,
    axes: Floats | None = None,
    upright: bool = True,
) -> InnerChoice:
    """Return the choice with times and sigmas that know of the lean of the inner boundary.

    Args:
        echoes: Of the survey.
        found: Which echoes are the inner ones; their times may be some cycle off.
        bone: Nominal bone.
        positions_mm: Where the probe stood (n, 3).
        links: Who is around whom.
        axes: Of the probe, into the bone (n, 3); None: not known, it is perpendicular if upright.
        upright: The probe is nearly perpendicular to the outer boundary, which it heard itself.
    """
    rows = np.flatnonzero(found.heard & (found.sureness > WITNESS))
    if len(rows) <= LEAST:
        return found
    weighed = _weigh(echoes, found.lag_us, rows, bone)
    probe, to_plane = echoes.template.probe, plane_axes(positions_mm[rows])
    places = positions_mm[rows] @ to_plane
    around = LocalPlanes(places)
    outer = np.zeros((len(rows), 2))
    if axes is not None:
        standoff = standoff_mm(echoes.fronts.delay_us[rows], probe)
        outer = _outer_rise(places, standoff, axes[rows] @ to_plane, around)
    told = around.known & (upright or axes is not None)
    lag, sd, level, rise = _settled(
        weighed, found.lag_us[rows], found.sigma_us[rows], around, outer, told, probe
    )
    times, sigmas = found.lag_us.copy(), found.sigma_us.copy()
    width_mm = 2.0 * probe.aperture_radius_mm
    bent = width_mm**2 * np.hypot(BEND_US_PER_MM2, BEND_PER_MM * np.hypot(*rise.T))
    cycles = STRUCTURE_CYCLES if upright else LEANING_CYCLES
    structure = np.hypot(bent, cycles / probe.centre_mhz)
    times[rows], sigmas[rows] = lag, np.hypot(sd, structure)
    # a time that is known better makes no echo surer than it was
    surer = _within(sigmas, bone) / np.maximum(_within(found.sigma_us, bone), 1e-12)
    sureness = found.sureness / np.maximum(surer, 1.0)
    sureness[rows] *= loud_enough(level, lag, rows, links, probe, bone)
    return replace(found, lag_us=times, sigma_us=sigmas, sureness=sureness)


def _settled(
    weighed: _Weighed,
    start_us: Floats,
    sigma_us: Floats,
    around: LocalPlanes,
    outer_rise: Floats,
    told: Bools,
    probe: ProbeModel,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return times (n,), deviations, logarithms of levels, and rises (n, 2) of the inner time.

    Each round weighs times and slopes by what the neighbours came to in the one before.

    Args:
        weighed: What the A-scans say by themselves.
        start_us: The times that the offsets count from (n,).
        sigma_us: And how far off they may be.
        around: Planes through the neighbours.
        outer_rise: What the outer boundary adds to the slope (n, 2).
        told: Where the slope is known from the neighbours (n,).
        probe: Its centre frequency tells how long a cycle is.
    """
    lag, sd = start_us, np.maximum(sigma_us, FLOOR)
    level, rise = np.zeros(len(lag)), np.zeros((len(lag), 2))
    held = _held(weighed, probe)
    slope_sd = np.where(told, SLOPE_SD, UNKNOWN_SD)[:, None]
    for turn in range(ROUNDS):
        expected, rise, scatter = around.planes(lag, sd)
        slope = np.where(told, np.hypot(*(rise + outer_rise).T), 0.0)
        unlike = (weighed.slopes - slope[:, None]) / slope_sd
        usual = _usual_level(weighed, slope)
        chances = weighed.likelihood - 0.5 * ((weighed.level - usual) / LEVEL_SD) ** 2
        chances = chances - 0.5 * unlike[:, :, None] ** 2 - held
        if turn:
            off = (start_us - expected)[:, None] + weighed.offsets_us
            strange = off / np.hypot(scatter, EXPECTED_SD_US)[:, None]
            together = -STRANGERS * np.log1p(0.5 * strange**2)
            chances = chances + np.where(around.known[:, None], together, 0.0)[:, None, :]
        lag, sd, level = _mean(weighed, chances, start_us)
    return lag, sd, level, rise


def _held(weighed: _Weighed, probe: ProbeModel) -> Singles:
    """Return how unlikely offsets are (s, t) from a time that was fitted for a parallel boundary.

    The flatter the boundary, the more that time counts.
    """
    cycles = weighed.offsets_us * probe.centre_mhz
    flat = np.exp(-((weighed.slopes / (FLAT * weighed.slopes[-1])) ** 2))
    return np.multiply.outer(flat, 0.5 * (cycles / HELD_CYCLES) ** 2).astype(np.float32)


def _within(sigma_us: Floats, bone: Material) -> Floats:
    """Return the chance (n,) that a boundary with this sigma of its time is right to 1 mm."""
    sigma_mm = np.maximum(sigma_us * bone.speed_mm_per_us / 2.0, 1e-9)
    return np.asarray(erf(1.0 / sigma_mm / np.sqrt(2.0)))


def _weigh(echoes: Echoes, lag_us: Floats, rows: Ints, bone: Material) -> _Weighed:
    template = echoes.template
    probe, f = template.probe, template.frequencies_mhz
    null = 1.22 / (2.0 * probe.aperture_radius_mm * probe.centre_mhz)
    slopes = as_floats(np.linspace(0.0, STEEPEST * null, SLOPES))
    step = 1.0 / (STEPS_PER_CYCLE * probe.centre_mhz)
    reach = round(REACH_US / step)
    offsets = as_floats(np.arange(-reach, reach + 1) * step)
    ways = beam_transform(probe, f, slopes)
    turns = template.shift(offsets).T  # (f, t)
    parts = [
        _block(echoes, lag_us, rows[k : k + BLOCK], bone, ways, turns)
        for k in range(0, len(rows), BLOCK)
    ]
    likelihood, level = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _Weighed(slopes, offsets, likelihood, level)


def _block(
    echoes: Echoes,
    lag_us: Floats,
    rows: Ints,
    bone: Material,
    ways: Complexes,
    turns: Complexes,
) -> tuple[Singles, Singles]:
    template = echoes.template
    lag = lag_us[rows]
    behind = subtract_fronts(echoes.aligned[rows], template) * template.shift(lag)
    echo = bone_filter(template, bone, lag * bone.speed_mm_per_us / 2.0)
    noise = GRID * np.maximum(echoes.noise[rows], 1e-9)[:, None] ** 2
    weights = 1.0 / (noise + (CLUTTER * np.abs(echo)) ** 2)
    shape = len(rows), len(ways), turns.shape[1]
    likelihood, level = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    matched = (behind * weights * np.conj(echo)).astype(np.complex64)
    energies = (weights * np.abs(echo) ** 2) @ (np.abs(ways) ** 2).T
    single = turns.astype(np.complex64)
    for k, way in enumerate(np.conj(ways).astype(np.complex64)):
        seen = np.maximum(((matched * way) @ single).real, 0.0)
        energy = energies[:, k, None]
        likelihood[:, k] = seen**2 / energy / ALIKE
        level[:, k] = np.log(np.maximum(seen / energy, LEAST_LEVEL))
    return likelihood, level


def _usual_level(weighed: _Weighed, slope: Floats) -> float:
    """Return the logarithm of how high the echoes of this survey are, where they lean like this."""
    nearest = np.abs(weighed.slopes - slope[:, None]).argmin(axis=1)
    rows = np.arange(len(nearest))
    best = weighed.likelihood[rows, nearest].argmax(axis=1)
    return float(np.median(weighed.level[rows, nearest, best]))


def _mean(weighed: _Weighed, chances: Floats, middle_us: Floats) -> tuple[Floats, Floats, Floats]:
    """Return mean and standard deviation (n,) of the times, and the mean level."""
    share = np.exp(chances - chances.max(axis=(1, 2), keepdims=True))
    share /= share.sum(axis=(1, 2), keepdims=True)
    level = (share * weighed.level).sum(axis=(1, 2))
    share = share.sum(axis=1)
    mean = share @ weighed.offsets_us
    spread = (share * (weighed.offsets_us - mean[:, None]) ** 2).sum(axis=1)
    return middle_us + mean, np.sqrt(spread), level


def _outer_rise(places: Floats, standoff_mm: Floats, axes: Floats, around: LocalPlanes) -> Floats:
    """Return how the time to the outer boundary rises (n, 2) across each probe, in us per mm.

    All coordinates are those of the plane of the survey, its normal last.
    """
    points = places + standoff_mm[:, None] * axes
    _, rise, _ = around.planes(points[:, 2], np.full(len(points), OUTER_SD_MM))
    return 2.0 / GEL.speed_mm_per_us * (axes[:, :2] + axes[:, 2:] * rise)
