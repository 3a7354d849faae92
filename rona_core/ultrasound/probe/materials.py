"""Acoustic materials with loss and dispersion, and nominal values of them.

Shared by detection and by the virtual world: the physics of a material, and published values that
everybody knows. What the bone of a specimen really is, is in ``virtual.acoustics.medium`` alone.

Speeds are mm/us, densities g/cm3, attenuations dB/cm at 1 MHz. Published values of the speed in
skull bone differ by 13 %, so every speed is an explicit parameter and nothing else knows it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

REFERENCE_MHZ = 1.5  # frequency at which a phase speed is quoted: between the two probes
NEPER_PER_MM = 1.0 / 86.85889638  # one dB/cm in Np/mm
LINEAR = 1e-6  # exponents this close to 1 take the logarithmic law

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Material:
    """A fluid, or a solid with shear; layers are counted by their compression waves alone."""

    speed_mm_per_us: float
    density_g_per_cm3: float
    attenuation_db_per_cm: float = 0.0  # at 1 MHz; grows with frequency to the power below
    power: float = 1.0
    shear_mm_per_us: float = 0.0  # 0: a fluid

    def __post_init__(self) -> None:
        if not (self.speed_mm_per_us > 0 and self.density_g_per_cm3 > 0):
            raise InvalidInputError("a material needs a speed and a density above 0")
        if self.attenuation_db_per_cm < 0 or not 0.5 <= self.power <= 2.0:
            raise InvalidInputError("attenuation must be >= 0 and its power 0.5 to 2")
        if not 0.0 <= self.shear_mm_per_us < self.speed_mm_per_us:
            raise InvalidInputError("shear must be slower than compression")

    def wavenumber_per_mm(self, frequencies_mhz: Floats) -> Complexes:
        """Return the complex wavenumber (f,): a wave travels as exp(-j k x).

        The loss is a power law and the dispersion its Kramers-Kronig partner (Szabo 1995).
        """
        f = frequencies_mhz
        loss = self.attenuation_db_per_cm * NEPER_PER_MM
        if abs(self.power - 1.0) < LINEAR:
            slowness = -loss / np.pi**2 * np.log(f / REFERENCE_MHZ)
        else:
            turn = np.tan(np.pi * self.power / 2.0)
            spread = f ** (self.power - 1.0) - REFERENCE_MHZ ** (self.power - 1.0)
            slowness = loss / (2.0 * np.pi) * turn * spread
        slowness = slowness + 1.0 / self.speed_mm_per_us
        return 2.0 * np.pi * f * slowness - 1j * loss * f**self.power

    def impedance(self, frequencies_mhz: Floats) -> Complexes:
        """Return the characteristic impedance (f,) in MRayl."""
        k = self.wavenumber_per_mm(frequencies_mhz)
        return self.density_g_per_cm3 * 2.0 * np.pi * frequencies_mhz / k


GEL = Material(1.50, 1.00, 0.05, 1.0)
TABLE = Material(2.85, 1.90, 6.0, 1.0, shear_mm_per_us=1.5)  # White 2006
DIPLOE = Material(2.45, 1.70, 12.0, 1.0)  # Pichardo 2011; loss with scatter, Fry and Barger 1978
BRAIN = Material(1.55, 1.04, 0.5, 1.0)
