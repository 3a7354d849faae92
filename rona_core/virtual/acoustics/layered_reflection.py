"""Reflection of layers, all multiples included, and of one boundary met at an angle.

A boundary is a two-port: what it reflects to either side and what passes it both ways. A graded
boundary is a pile of thin slices joined once, so that every ray may reuse it. At an angle a wave
from the side of the fluid turns partly into shear in the solid, and a wave from inside the solid
partly into shear that goes back: with the effective impedances of Brekhovskikh, *Waves in Layered
Media* (1980), section 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.probe.materials import Complexes, Material

RAMP_SLICES = 12
TABLE_STEPS = 128  # angles from 0 to the critical one at which factors are tabulated
SHORT_OF_CRITICAL = 0.98  # no further; a probe hears nothing of such angles

NOTHING = 1e-9  # a boundary that reflects less has no echo to scale


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """Reflection seen from near and far side, and transmission there and back, each (f,)."""

    near: Complexes
    far: Complexes
    through: Complexes

    def seen_with(self, beyond: Complexes) -> Complexes:
        """Return the reflection (..., f) when ``beyond`` (..., f) comes back from behind."""
        return self.near + self.through * beyond / (1.0 - self.far * beyond)


def step(near: Complexes, far: Complexes) -> Boundary:
    """Return the sharp boundary between two impedances (f,)."""
    r = (far - near) / (far + near)
    return Boundary(r, -r, 1.0 - r**2)


def join(first: Boundary, delay: Complexes, second: Boundary) -> Boundary:
    """Return two boundaries as one; ``delay`` (f,) is exp(-2 j k d) of the layer between."""
    loop = 1.0 - first.far * second.near * delay
    return Boundary(
        first.near + first.through * second.near * delay / loop,
        second.far + second.through * first.far * delay / loop,
        first.through * second.through * delay / loop**2,
    )


def ramp(near: Material, far: Material, width_mm: float, frequencies_mhz: Floats) -> Boundary:
    """Return the boundary over which one material turns into another linearly.

    It replaces ``width_mm / 2`` of the layer on either side.
    """
    z0, z1 = near.impedance(frequencies_mhz), far.impedance(frequencies_mhz)
    if width_mm == 0.0:
        return step(z0, z1)
    k0, k1 = near.wavenumber_per_mm(frequencies_mhz), far.wavenumber_per_mm(frequencies_mhz)
    shares = (np.arange(RAMP_SLICES) + 0.5) / RAMP_SLICES
    impedances = [z0, *((1.0 - share) * z0 + share * z1 for share in shares), z1]
    result = step(impedances[0], impedances[1])
    for i, share in enumerate(shares):
        k = (1.0 - share) * k0 + share * k1
        edge = step(impedances[i + 1], impedances[i + 2])
        result = join(result, np.exp(-2j * k * width_mm / RAMP_SLICES), edge)
    return result


def stack_reflection(
    materials: Sequence[Material], thicknesses_mm: Sequence[float], frequencies_mhz: Floats
) -> Complexes:
    """Return the reflection (f,) of layers with sharp boundaries, seen from the first material.

    Args:
        materials: From the half-space of the observer to the half-space behind, n + 2 of them.
        thicknesses_mm: Of the n layers between.
        frequencies_mhz: Shape (f,), above 0.

    Raises:
        InvalidInputError: the numbers of materials and thicknesses do not fit.
    """
    if len(materials) != len(thicknesses_mm) + 2:
        raise InvalidInputError(
            f"{len(materials)} materials need {len(materials) - 2} thicknesses, "
            f"not {len(thicknesses_mm)}"
        )
    z = [material.impedance(frequencies_mhz) for material in materials]
    reflection = step(z[-2], z[-1]).near
    for i in range(len(thicknesses_mm) - 1, -1, -1):
        k = materials[i + 1].wavenumber_per_mm(frequencies_mhz)
        reflection = reflection * np.exp(-2j * k * thicknesses_mm[i])
        reflection = step(z[i], z[i + 1]).seen_with(reflection)
    return reflection


@dataclass(frozen=True, slots=True, eq=False)
class ObliqueStep:
    """Pressure amplitudes and energies at one boundary for angles (n,) in the fluid."""

    from_fluid: Floats  # reflection seen from the fluid
    from_solid: Floats  # reflection of a compression wave seen from the solid
    through: Floats  # there and back as compression: the share of pressure that returns
    shear_energy: Floats  # of a wave from the fluid that goes on as shear


def critical_angle_rad(fluid: Material, solid: Material) -> float:
    """Return the angle in the fluid from which no compression wave enters the solid."""
    return float(np.arcsin(min(fluid.speed_mm_per_us / solid.speed_mm_per_us, 1.0)))


def oblique_step(fluid: Material, solid: Material, angles_rad: Floats) -> ObliqueStep:
    """Return what happens at a boundary without loss.

    Args:
        fluid: On the side of the angle.
        solid: With a speed of shear, or none: then it is a fluid as well.
        angles_rad: Between the wave in the fluid and the normal, shape (n,).

    Raises:
        InvalidInputError: an angle beyond the critical one.
    """
    sine = np.sin(angles_rad)
    slow, fast, shear = fluid.speed_mm_per_us, solid.speed_mm_per_us, solid.shear_mm_per_us
    sine_fast, sine_shear = sine * fast / slow, sine * shear / slow
    if np.any(np.abs(sine_fast) >= 1.0) or np.any(np.abs(sine_shear) >= 1.0):
        raise InvalidInputError(
            f"the angle must stay below {np.rad2deg(critical_angle_rad(fluid, solid)):.1f} degrees"
        )
    z_fluid = fluid.density_g_per_cm3 * slow / np.sqrt(1.0 - sine**2)
    z_fast = solid.density_g_per_cm3 * fast / np.sqrt(1.0 - sine_fast**2)
    z_shear = solid.density_g_per_cm3 * shear / np.sqrt(1.0 - sine_shear**2)
    twice_sine2 = (2.0 * sine_shear * np.sqrt(1.0 - sine_shear**2)) ** 2
    a, b, c = z_fluid, z_shear * twice_sine2, z_fast * (1.0 - twice_sine2)
    total = a + b + c
    return ObliqueStep(
        from_fluid=readonly((b + c - a) / total),
        from_solid=readonly((a + b - c) / total),
        through=readonly(4.0 * a * c / total**2),
        shear_energy=readonly(4.0 * a * b / total**2),
    )


class ObliqueFactors:
    """Amplitudes at an angle over those at normal incidence, tabulated for one boundary."""

    def __init__(self, fluid: Material, solid: Material) -> None:
        """Take the two sides; angles are given in the fluid."""
        self._ratio = fluid.speed_mm_per_us / solid.speed_mm_per_us
        most = SHORT_OF_CRITICAL * critical_angle_rad(fluid, solid)
        self._angles = np.linspace(0.0, most, TABLE_STEPS)
        found = oblique_step(fluid, solid, self._angles)
        self._from_fluid = _over_first(found.from_fluid)
        self._from_solid = _over_first(found.from_solid)
        self._through = _over_first(found.through)

    def front(self, angles_rad: Floats) -> Floats:
        """Return the factors (n,) of the echo of a boundary met from the fluid."""
        return np.interp(angles_rad, self._angles, self._from_fluid)

    def passage(self, angles_rad: Floats) -> Floats:
        """Return the factors (n,) of what passes the boundary there and back."""
        return np.interp(angles_rad, self._angles, self._through)

    def back(self, angles_rad: Floats) -> Floats:
        """Return the factors (n,) of the echo met from the solid, at angles in the solid."""
        in_fluid = np.arcsin(np.clip(np.sin(angles_rad) * self._ratio, 0.0, 1.0))
        return np.interp(in_fluid, self._angles, self._from_solid)


def _over_first(values: Floats) -> Floats:
    """Return values over that of normal incidence; ones where that is nothing."""
    return values / values[0] if abs(values[0]) > NOTHING else np.ones_like(values)
