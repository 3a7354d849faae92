"""Nuisance echoes fitted together with an inner echo: the front whatever its shape, multiples.

Everything is linear and made for white noise, so that the time of the inner echo loses no more by
it than it must, and neither the gap nor the shape of the front moves it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.detection.single.front_echo import TAP_SPACING, TAPS, Fronts, standoff_mm
from rona_core.ultrasound.detection.single.matched_filter import (
    BONE_REFLECTION,
    GEL_MRAYL,
    Template,
)
from rona_core.ultrasound.probe.materials import GEL, Complexes

SHAPE_SD = 0.3  # of a copy beside the middle one over the front: what tilt and curvature do
SHAPE_WIDTH = 0.3  # over the bandwidth: copies further off are smaller than that
SHAPE_FLOOR = 1e-6  # of the front's power: finer shapes than that are not believed
MOST_LEVEL = 1.2  # a louder front is not the template's


def without_gap(aligned: Complexes, fronts: Fronts, template: Template) -> Complexes:
    """Return aligned spectra (n, f) as they are when line and gel are of one impedance.

    They are nearly, but what the face of the line returns comes before the front echo by the way
    through the gel, and again behind it and behind the inner echo: a hundredth of the front, enough
    to move times by a nanosecond, and by another one at each distance.
    """
    line = template.probe.line.speed_mm_per_us * template.probe.line.density_g_per_cm3
    face = (GEL_MRAYL - line) / (GEL_MRAYL + line)
    gap_mm = np.maximum(standoff_mm(fronts.delay_us, template.probe), template.probe.film_mm)
    early = template.shift(2.0 * gap_mm / GEL.speed_mm_per_us)
    late = np.conj(early)
    level = np.where(fronts.measured & fronts.positive, np.minimum(fronts.level, MOST_LEVEL), 0.0)
    beside = (early + BONE_REFLECTION**2 * late) * template.spectrum
    clear = aligned * (1.0 + face * BONE_REFLECTION * late) ** 2
    return clear - (face * level)[:, None] * beside


@dataclass(frozen=True, slots=True, eq=False)
class FrontShapes:
    """What a front echo may look like: orthogonal shapes and the power expected in each."""

    shapes: Complexes  # (k, f) of unit power
    power: Floats  # (k,)

    def without(self, spectra: Complexes, density: Floats) -> Complexes:
        """Return what of spectra (n, f) a front in noise of power ``density`` (n,) leaves.

        It is linear, and the best that can be done with shapes that are normally distributed.
        """
        share = self.power / (self.power + density[:, None] + SHAPE_FLOOR * self.power[0])
        return spectra - (spectra @ self.shapes.conj().T * share) @ self.shapes


@lru_cache(maxsize=16)
def front_shapes(template: Template) -> FrontShapes:
    """Return the shapes of a front aligned to time 0: delayed copies, the middle one the largest.

    Noise is white here, so all frequencies count alike: what the shapes take from the inner echo
    is as little as can be.
    """
    band = template.probe.bandwidth * template.probe.centre_mhz
    offsets = (np.arange(TAPS, dtype=np.float64) - TAPS // 2) * TAP_SPACING
    sd = SHAPE_SD * np.exp(-0.5 * (offsets / SHAPE_WIDTH) ** 2)
    sd[TAPS // 2] = 1.0
    copies = template.spectrum * np.conj(template.shift(offsets / band))
    _, size, shapes = np.linalg.svd(BONE_REFLECTION * sd[:, None] * copies, full_matrices=False)
    return FrontShapes(readonly(shapes), readonly(size**2))


def front_times(fronts: Complexes, template: Template) -> Floats:
    """Return the times (n,) of front echoes (n, f) near time 0, with weights for noise alone."""
    omega = 2.0 * np.pi * template.frequencies_mhz
    power = np.abs(template.spectrum) ** 2
    height = np.real(fronts @ np.conj(template.spectrum)) / power.sum()
    slope = -np.imag(fronts @ (omega * np.conj(template.spectrum))) / (power @ omega**2)
    return slope / np.maximum(height, 1e-12)


class Rest:
    """Projection of spectra off all that a front and a second echo may be.

    The inner echo comes again after twice the time, from the outer boundary and back; how strongly
    depends on tilts, so that its height is as unknown as the shape of the front.
    """

    def __init__(
        self, shapes: FrontShapes, density: Floats, again: Complexes, amplitude: Floats
    ) -> None:
        self._shapes, self._density = shapes, density
        self._again = shapes.without(again, density)
        expected = density / np.maximum(amplitude, 1e-12) ** 2
        self._power = products(again, self._again).real + expected

    def of(self, spectra: Complexes) -> Complexes:
        """Return what is left of spectra (n, f)."""
        residual = self._shapes.without(spectra, self._density)
        height = products(self._again, spectra) / self._power
        return residual - height[:, None] * self._again


def products(a: Complexes, b: Complexes) -> Complexes:
    """Return the inner products (n,) of spectra (n, f)."""
    return np.asarray(np.einsum("nf,nf->n", np.conj(a), b), dtype=np.complex128)
