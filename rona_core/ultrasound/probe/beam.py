"""The sound field of the transducer on the face of its delay line, as weighted rays.

Shared by detection and by the virtual world: a laboratory knows the field of its probe from its
dimensions. That both use one model means that errors of this model do not show in rehearsals; an
independent disc oracle and k-space simulations in the tests hold it against others.

By reciprocity the echo of a smooth surface is the integral over the face of the squared incident
field times the local reflection. The field is that of a disc of constant pressure (second
Rayleigh integral), with the loss of the line in it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.probe.excitation import GRID, grid_frequencies_mhz, in_band
from rona_core.ultrasound.probe.materials import Complexes
from rona_core.ultrasound.probe.probe_model import ProbeModel

FACE_OVER_APERTURE = 1.25  # the line is wider than the crystal by this factor
RING_RAYS = (6, 8, 10, 12, 14, 16, 18, 20)  # rays on each ring, inside out: 104
WINDOW = 1280  # samples of the window that holds all echoes of one firing: 25.6 us
SOURCE_RADII, SOURCE_ANGLES = 32, 96  # quadrature over the crystal


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """Rays on the face and their complex weights; the weights of a perfect mirror add to its echo.

    The weights leave out the plain delay of the line's axis.
    """

    points_mm: Floats  # (n, 2) on the face, in probe x and y
    frequencies_mhz: Floats  # (f,) inside the band, on the grid of WINDOW samples
    bins: np.typing.NDArray[np.int64]  # (f,) their places on that grid
    weights: Complexes  # (n, f)


def face_rays(radius_mm: float) -> tuple[Floats, Floats, np.typing.NDArray[np.int64]]:
    """Return ray points (n, 2), their areas (n,) in mm2, and the ring of each (n,)."""
    nodes, shares = np.polynomial.legendre.leggauss(len(RING_RAYS))
    radii, areas = radius_mm * (nodes + 1.0) / 2.0, shares * radius_mm / 2.0
    points, weights, rings = [], [], []
    for i, (r, dr, count) in enumerate(zip(radii, areas, RING_RAYS, strict=True)):
        angle = 2.0 * np.pi * (np.arange(count) + 0.5 * (i % 2)) / count
        points.append(r * np.stack((np.cos(angle), np.sin(angle)), axis=1))
        weights.append(np.full(count, 2.0 * np.pi * r * dr / count))
        rings.append(np.full(count, i))
    return np.concatenate(points), np.concatenate(weights), np.concatenate(rings)


def disc_field(radius_mm: float, distance_mm: float, offsets_mm: Floats, k: Complexes) -> Complexes:
    """Return the field (m, f) of a disc of unit pressure at ``offsets_mm`` (m,) from its axis."""
    nodes, shares = np.polynomial.legendre.leggauss(SOURCE_RADII)
    r = radius_mm * (nodes + 1.0) / 2.0
    area = shares * radius_mm / 2.0 * r * 4.0 * np.pi / SOURCE_ANGLES  # of both halves of the disc
    angle = 2.0 * np.pi * (np.arange(SOURCE_ANGLES // 2) + 0.5) / SOURCE_ANGLES
    x, y = np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()
    area = np.repeat(area, SOURCE_ANGLES // 2)
    field = np.zeros((len(offsets_mm), len(k)), dtype=np.complex128)
    for i, offset in enumerate(offsets_mm):
        path = np.sqrt((x - offset) ** 2 + y**2 + distance_mm**2)
        share = area * distance_mm / (2.0 * np.pi * path**2)
        for j, kj in enumerate(k):
            field[i, j] = np.sum(share * (1j * kj + 1.0 / path) * np.exp(-1j * kj * path))
    return field


@lru_cache(maxsize=8)
def probe_beam(probe: ProbeModel) -> Beam:
    """Return the rays of a probe."""
    frequencies = grid_frequencies_mhz(probe, WINDOW)
    bins = np.flatnonzero(in_band(probe, frequencies))
    f = frequencies[bins]
    points, areas, rings = face_rays(FACE_OVER_APERTURE * probe.aperture_radius_mm)
    radii = np.array([np.hypot(*points[rings == i][0]) for i in range(len(RING_RAYS))])
    k = probe.line.wavenumber_per_mm(f)
    field = disc_field(probe.aperture_radius_mm, probe.line_length_mm, radii, k)
    crystal = np.pi * probe.aperture_radius_mm**2
    undelayed = np.exp(4j * np.pi * f * probe.line_length_mm / probe.line.speed_mm_per_us)
    weights = (areas / crystal)[:, None] * (field**2)[rings] * undelayed
    return Beam(readonly(points), readonly(f), readonly(bins), readonly(weights))


@lru_cache(maxsize=8)
def mirror_spectrum(probe: ProbeModel) -> Complexes:
    """Return the echo spectrum (GRID // 2 + 1,) of a flat perfect mirror on the face.

    It is what a reference block shows once per probe, over block and crystal: the diffraction and
    loss of the line, without the plain delay ``probe.line_delay_us``. It is 0 out of the band.
    """
    beam = probe_beam(probe)
    f = grid_frequencies_mhz(probe, GRID)
    total = beam.weights.sum(axis=0)
    spectrum = np.interp(f, beam.frequencies_mhz, total.real, left=0.0, right=0.0) + 1j * np.interp(
        f, beam.frequencies_mhz, total.imag, left=0.0, right=0.0
    )
    return readonly(spectrum)


HALF = 2.21509  # 2 J1(x) / x = 1/2: the echo of a plane, seen by a disc, is half as high
GEL_MM_PER_US = 1.5
LEAST_LEVEL = 0.01  # of a front echo over a plane's: lower ones add no evidence


def half_echo_tilt_deg(probe: ProbeModel) -> float:
    """Return the tilt of a flat bone at which the front echo falls to half its height, degrees.

    A disc of radius a receives a plane wave that comes back at twice the tilt; its mean over the
    disc is 2 J1(x) / x with x = k a sin(2 tilt).
    """
    sine = min(HALF / (_gel_wavenumber_per_mm(probe) * probe.aperture_radius_mm), 1.0)
    return float(np.rad2deg(0.5 * np.arcsin(sine)))


def rms_roughness_mm(probe: ProbeModel, levels: Floats) -> Floats:
    """Return the RMS roughness (n,) of bone below a face, from the levels of its front echoes.

    Of a rough surface the coherent echo is exp(-2 k^2 s^2) as high as that of a plane, k the wave
    number in gel and s the RMS of its depths (Eckart 1953). That holds for narrow bands, fine
    grains and s up to 0.1 mm; grains as wide as a third of the face look 0.7 as rough. A tilt of
    1 degree lowers the echo as 0.02 mm of roughness do.

    Args:
        probe: That took them.
        levels: Amplitudes over that of a plane (n,): 1 is smooth, and any below 0.01 as rough.
    """
    phases = np.sqrt(-0.5 * np.log(np.clip(levels, LEAST_LEVEL, 1.0)))  # k s, in rad
    return phases / _gel_wavenumber_per_mm(probe)


def _gel_wavenumber_per_mm(probe: ProbeModel) -> float:
    """Return the wave number in gel at the centre frequency."""
    return 2.0 * np.pi * probe.centre_mhz / GEL_MM_PER_US
