"""Reflection of a stack of layers, all multiples included, frequency by frequency.

A boundary is a two-port: what it reflects to either side and what passes it both ways. A graded
boundary is a pile of thin slices joined once, so that every ray may reuse it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Complexes, Material

RAMP_SLICES = 12


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
