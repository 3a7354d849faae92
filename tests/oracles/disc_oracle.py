"""The echo of a disc transducer without rays: what the product's beam is held against in 3-D.

Leaning flat layers: the whole angular spectrum of the disc, every plane wave with its own angle,
refraction and reflection; nothing is left out but shear. Curved bone: Huygens' principle point by
point, crystal to outer surface to inner surface and back, the surfaces taken as flat where each
wave meets them. The line ends in no face here: its material reaches down to the bone.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import j1

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.beam import WINDOW, probe_beam
from rona_core.ultrasound.probe.excitation import transducer_response
from rona_core.ultrasound.probe.materials import BRAIN, TABLE, Complexes, Material
from rona_core.ultrasound.probe.probe_model import PROBES, ProbeModel
from rona_core.virtual.acoustics.layer_stack import BoneStack, LayerProfile, Spreading
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import bent_share
from tests.oracles.kwave_cases import Comparison, envelope

BONE = replace(TABLE, shear_mm_per_us=0.0)
BONE_MM, GAP_MM = 6.0, 0.5
WIDEST_RAD, ANGLES, TURNS = 0.9, 400, 96  # of the angular spectrum
RINGS, SLOPE_MM = 26, 0.002  # of a shell; half a step to find a slope
FLAT_MM = 1e7  # radius
FACE = 1.25  # radius of the lit bone over that of the crystal, as the line ends there
LEAD_US = 4.0  # so that no echo begins before the record


@dataclass(frozen=True, slots=True)
class Echoes:
    """The product over the oracle: front and inner echo of one bone."""

    front_db: float
    front_ns: float
    inner_db: float
    inner_ns: float


def ideal_probe(name: str) -> ProbeModel:
    """Return a probe whose line has no loss, so that waves at an angle pay nothing for it."""
    probe = PROBES[name]
    line = Material(probe.line.speed_mm_per_us, probe.line.density_g_per_cm3)
    return replace(probe, line=line)


def leaning(name: str, lean_deg: float) -> Echoes:
    """Return rays over the angular spectrum for a flat plate of bone that leans."""
    probe, lean = ideal_probe(name), np.deg2rad(lean_deg)
    beam = probe_beam(probe)
    x = beam.points_mm[:, 0]
    outer, through = GAP_MM + x * np.tan(lean), np.full(len(x), BONE_MM / np.cos(lean))
    angle = np.full(len(x), lean)
    slope = np.vstack((np.tan(angle), 0.0 * angle))
    rays = _rays(probe, outer, through, (angle, angle), (slope, slope))
    return _compared(probe, rays, _angular_spectrum(probe, beam.frequencies_mhz, float(lean)))


def curved(name: str, radius_mm: float) -> Echoes:
    """Return rays over Huygens' principle for a shell of bone."""
    probe = ideal_probe(name)
    beam = probe_beam(probe)
    r = np.hypot(*beam.points_mm.T)
    inner_radius = radius_mm - BONE_MM
    outer = GAP_MM + _sag(r, radius_mm)
    through = GAP_MM + BONE_MM + _sag(r, inner_radius) - outer
    angles = np.arcsin(r / radius_mm), np.arcsin(r / inner_radius)
    away = beam.points_mm.T / r
    slopes = np.tan(angles[0]) * away, np.tan(angles[1]) * away
    rays = _rays(probe, outer, through, angles, slopes)
    f = beam.frequencies_mhz
    spectra = [_huygens(probe, float(one), radius_mm) for one in f]
    return _compared(probe, rays, np.array(spectra))


def _sag(r_mm: Floats, radius_mm: float) -> Floats:
    return radius_mm - np.sqrt(radius_mm**2 - r_mm**2)


def _rays(
    probe: ProbeModel,
    outer_mm: Floats,
    through_mm: Floats,
    angles: tuple[Floats, Floats],
    slopes: tuple[Floats, Floats],
) -> Complexes:
    """Return the product's echo (f,) of a plate under the rays of the beam."""
    beam = probe_beam(probe)
    medium = Medium(
        gel=probe.line,
        table=BONE,
        diploe=BONE,
        brain=BRAIN,
        ramp_mm=0.0,
        outer_roughness_mm=0.0,
        inner_roughness_mm=0.0,
        speckle=0.0,
    )
    stack = BoneStack(
        probe.line,
        medium,
        beam.frequencies_mhz,
        film_mm=0.0,
        seed=0,
        spreading=Spreading(probe, beam),
        exact=True,
    )
    faster = BONE.speed_mm_per_us / probe.line.speed_mm_per_us
    through_mm = through_mm * (1.0 + bent_share(*slopes, faster))
    profile = LayerProfile(
        outer_mm=outer_mm,
        table_mm=through_mm / 3.0,
        diploe_mm=through_mm / 3.0,
        inner_table_mm=through_mm / 3.0,
        hit=outer_mm > -np.inf,
        entries_skull=np.zeros((len(outer_mm), 3)),
        outer_angle_rad=angles[0],
        inner_angle_rad=angles[1],
    )
    return np.asarray(stack.echo(beam.weights, profile), dtype=np.complex128)


def _angular_spectrum(probe: ProbeModel, frequencies_mhz: Floats, lean_rad: float) -> Complexes:
    """Return the echo (f,) of a leaning plate: all plane waves that the disc sends."""
    nodes, shares = np.polynomial.legendre.leggauss(ANGLES)
    angle = (nodes + 1.0) / 2.0 * WIDEST_RAD
    turn = 2.0 * np.pi * (np.arange(TURNS) + 0.5) / TURNS
    sine, cosine = np.sin(angle)[:, None], np.cos(angle)[:, None]
    way = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine + 0.0 * turn])  # (3, a, t)
    solid = (shares * WIDEST_RAD / 2.0)[:, None] * sine * cosine * 2.0 * np.pi / TURNS
    normal = np.array((-np.sin(lean_rad), 0.0, np.cos(lean_rad)))  # outer_mm grows with x
    along = np.tensordot(normal, way, 1)
    back = way - 2.0 * along * normal[:, None, None]
    there, here = sine + 0.0 * turn, np.hypot(back[0], back[1])
    reach = (probe.line_length_mm + GAP_MM) * np.cos(lean_rad)
    a, c = probe.aperture_radius_mm, probe.line.speed_mm_per_us
    echo = np.zeros(len(frequencies_mhz), dtype=np.complex128)
    for i, f in enumerate(frequencies_mhz):
        k = 2.0 * np.pi * f / c
        sent, heard = (2.0 * np.pi * a**2 * _jinc(k * a * s) for s in (there, here))
        bone = _plate(probe.line, float(f), k * np.sqrt(1.0 - np.minimum(along, 1.0) ** 2))
        wave = sent * heard * bone * np.exp(-2j * k * along * reach)
        echo[i] = np.sum(wave * solid) * k**2 / (4.0 * np.pi**3 * a**2)
    return echo * _undelayed(probe, frequencies_mhz)


def _jinc(x: Floats) -> Floats:
    small = np.maximum(x, 1e-9)
    return np.asarray(j1(small) / small, dtype=np.float64)


def _plate(line: Material, f: float, across: Floats) -> Complexes:
    """Return the reflection of a plate of bone for waves with these wavenumbers along it."""
    one = np.array([f])
    layers = (line, BONE, BRAIN)
    kz = [np.sqrt(m.wavenumber_per_mm(one)[0] ** 2 - across**2 + 0j) for m in layers]
    kz = [np.where(k.imag > 0, -k, k) for k in kz]
    z = [m.density_g_per_cm3 / k for m, k in zip(layers, kz, strict=True)]
    near, far = (z[1] - z[0]) / (z[1] + z[0]), (z[2] - z[1]) / (z[2] + z[1])
    far = far * np.exp(-2j * kz[1] * BONE_MM)
    return (near + far) / (1.0 + near * far)


def _undelayed(probe: ProbeModel, f: Floats) -> Complexes:
    return np.exp(4j * np.pi * f * probe.line_length_mm / probe.line.speed_mm_per_us)


@dataclass(frozen=True, slots=True, eq=False)
class _Shell:
    """A round surface, sampled in rings: one point for a ring, and all points of all rings."""

    ring_points: Floats  # (r, 3)
    ring_normals: Floats  # (r, 3) away from the crystal
    ring_areas: Floats  # (r,)
    points: Floats  # (r * TURNS, 3)
    normals: Floats  # (r * TURNS, 3)

    def spread(self, values: Complexes) -> Complexes:
        """Return values of the rings (r,), times area, for all points (r * TURNS,)."""
        return np.repeat(values * self.ring_areas / TURNS, TURNS)


def _shell(half_mm: float, depth_mm: float, radius_mm: float) -> _Shell:
    nodes, shares = np.polynomial.legendre.leggauss(RINGS)
    r = half_mm * (nodes + 1.0) / 2.0
    upright = np.sqrt(1.0 - (r / radius_mm) ** 2)
    area = 2.0 * np.pi * r * shares * half_mm / 2.0 / upright
    points = np.column_stack((r, 0.0 * r, depth_mm + _sag(r, radius_mm)))
    normals = np.column_stack((-r / radius_mm, 0.0 * r, upright))
    turn = 2.0 * np.pi * (np.arange(TURNS) + 0.5) / TURNS

    def turned(v: Floats) -> Floats:
        x, z = v[:, :1], v[:, 2:] + 0.0 * turn
        return np.stack((x * np.cos(turn), x * np.sin(turn), z), axis=2).reshape(-1, 3)

    return _Shell(points, normals, area, turned(points), turned(normals))


def _at(
    shell: _Shell, source: _Shell, double: Complexes, single: Complexes, k: complex
) -> tuple[Complexes, Complexes]:
    """Return the field on the rings of a shell (r,) and its slope along the normal.

    Args:
        shell: Where.
        source: From where.
        double: Double layer of the source along its normals, for each ring (r,).
        single: Single layer of the source, for each ring (r,).
        k: Wavenumber.
    """
    dipoles, poles = source.spread(double), source.spread(single)
    sides = []
    for side in (-1.0, 1.0):
        at = shell.ring_points + side * SLOPE_MM * shell.ring_normals
        way = at[:, None, :] - source.points
        length = np.sqrt(np.sum(way**2, axis=2))
        green = np.exp(-1j * k * length) / (4.0 * np.pi * length)
        turn = (1j * k + 1.0 / length) * np.einsum("rpi,pi->rp", way, source.normals) / length
        sides.append((green * (turn * dipoles + poles)).sum(axis=1))
    return (sides[0] + sides[1]) / 2.0, (sides[1] - sides[0]) / (2.0 * SLOPE_MM)


def _huygens(probe: ProbeModel, f: float, radius_mm: float) -> complex:
    """Return front and inner echo of a shell at one frequency, as wide as the face.

    The reflected wave on a surface is the incoming one times the reflection; what it is on the
    crystal follows by Green's theorem with the field of a crystal of point sources.
    """
    a = probe.aperture_radius_mm
    one, two, none = (np.full(RINGS, v, dtype=np.complex128) for v in (1.0, 2.0, 0.0))
    depth, line = probe.line_length_mm + GAP_MM, probe.line
    k, inside = (complex(m.wavenumber_per_mm(np.array([f]))[0]) for m in (line, BONE))
    z = [complex(m.impedance(np.array([f]))[0]) for m in (line, BONE, BRAIN)]
    near, far = (z[1] - z[0]) / (z[1] + z[0]), (z[2] - z[1]) / (z[2] + z[1])
    denser = BONE.density_g_per_cm3 / line.density_g_per_cm3
    crystal = _shell(a, 0.0, FLAT_MM)
    outer = _shell(FACE * a, depth, radius_mm)
    inner = _shell(FACE * a, depth + BONE_MM, radius_mm - BONE_MM)
    sent = _at(outer, crystal, two, none, k)
    heard = _at(outer, crystal, none, one, k)
    echo = -near * np.sum(outer.ring_areas * (sent[0] * heard[1] + heard[0] * sent[1]))
    (p, dp), (g, dg) = (
        _at(inner, outer, (1.0 + near) * value, -(1.0 - near) * denser * slope, inside)
        for value, slope in (sent, heard)
    )
    echo -= far / denser * np.sum(inner.ring_areas * (p * dg + g * dp))
    delay = 4.0 * np.pi * f * probe.line_length_mm / line.speed_mm_per_us
    return complex(echo / (np.pi * a**2) * np.exp(1j * delay))


def _compared(probe: ProbeModel, rays: Complexes, oracle: Complexes) -> Echoes:
    """Return front and inner echo of the product over those of the oracle, spectra (f,)."""
    beam = probe_beam(probe)
    f = beam.frequencies_mhz
    pulse = transducer_response(probe, f) * np.exp(-2j * np.pi * f * LEAD_US)
    records = []
    for spectrum in (rays, oracle):
        window = np.zeros(WINDOW // 2 + 1, dtype=np.complex128)
        window[beam.bins] = spectrum * pulse
        records.append(np.fft.irfft(window, WINDOW))
    step_us = 1.0 / probe.sampling_mhz
    front_us = float(np.argmax(envelope(records[1]))) * step_us
    inner_us = front_us + 2.0 * BONE_MM / BONE.speed_mm_per_us
    half = 1.5 / probe.centre_mhz
    front, inner = (
        Comparison(probe.name, records[0], records[1], step_us, (at - half, at + half))
        for at in (front_us, inner_us)
    )
    return Echoes(front.front_db, front.front_ns, inner.front_db, inner.front_ns)
