"""Named shapes of the pulse of an A-mode transducer: causal and with several lobes, as measured.

A shape is a product of resonances, poles off the real axis, and a few late packets: what comes
back from the backing and the matching layer. Its width is scaled so that the -6 dB band is the
one that the probe states.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rona_core.arrays import Floats
from rona_core.devices.settings import PulseShape
from rona_core.ultrasound.material import Complexes

HALF_POWER_STEPS = 60  # of the bisection for the width
REACH, SCAN = 6.0, 4001  # widths to either side, and samples, in which the band is sought


@dataclass(frozen=True)
class Pulse:
    """Poles (place, order) and late packets (size, cycles after the first).

    Places count in half widths of a pole, before the scaling, from the centre frequency.
    """

    poles: tuple[tuple[float, int], ...]
    lobes: tuple[tuple[float, float], ...]

    def resonance(self, offsets: Floats) -> Complexes:
        """Return the response (f,) at offsets from the centre over the -6 dB band; 1 at 0."""
        return self._poles(offsets * self._scale) / self._poles(np.zeros(1))

    def _poles(self, x: Floats) -> Complexes:
        response = np.ones(len(x), dtype=np.complex128)
        for place, order in self.poles:
            response *= (1.0 + 1j * (x - place)) ** -order
        return response

    @cached_property
    def _scale(self) -> float:
        """Half widths of a pole in the -6 dB band of the shape."""
        x = np.linspace(-REACH, REACH, SCAN)
        level = np.abs(self._poles(x))
        loud = x[level >= 0.5 * level.max()]
        low, high = (self._edge(float(x0), side) for x0, side in ((loud[0], -1), (loud[-1], 1)))
        return high - low

    def _edge(self, inside: float, side: int) -> float:
        half = 0.5 * float(np.abs(self._poles(np.linspace(-REACH, REACH, SCAN))).max())
        near, far = inside, inside + side * 2.0 * REACH / (SCAN - 1)
        for _ in range(HALF_POWER_STEPS):
            middle = 0.5 * (near + far)
            loud = np.abs(self._poles(np.array([middle])))[0] >= half
            near, far = (middle, far) if loud else (near, middle)
        return near


# A steep rise and a slow decay; well damped with a short echo of the backing; two humps of a
# matching layer; a light backing that rings on.
PULSES: dict[PulseShape, Pulse] = {
    "resonant": Pulse(((0.0, 6),), ((-0.10, 2.8),)),
    "damped": Pulse(((0.0, 9),), ((0.20, 1.7), (-0.07, 4.2))),
    "double": Pulse(((-1.0, 3), (1.0, 3)), ((-0.12, 3.4),)),
    "ringing": Pulse(((-0.2, 2), (0.2, 3)), ((-0.22, 2.3), (0.12, 4.9))),
}
