"""How the beam spreads on its way through the bone, beside that on the face of the line.

Bone is as far as a way ``d c / c_line`` in the line (paraxial): the field of the disc there,
squared by reciprocity, over that on the face. The plain delay and loss of the way are left out.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.ultrasound.probe.beam import Beam, disc_field
from rona_core.ultrasound.probe.materials import Complexes
from rona_core.ultrasound.probe.probe_model import ProbeModel

DEPTHS_MM = np.linspace(0.0, 36.0, 13)  # in the line; the last is 20 mm of bone
FREQUENCIES = 24  # at which the field is counted; it is interpolated between them


class Spreading:
    """Factors of the rays' echoes of boundaries behind the face."""

    def __init__(self, probe: ProbeModel, beam: Beam) -> None:
        """Count the field behind the face of a probe at the rays of its beam."""
        self._line_mm_per_us = probe.line.speed_mm_per_us
        radii, rings = np.unique(np.hypot(*beam.points_mm.T).round(9), return_inverse=True)
        self.rings: Ints = np.asarray(rings, dtype=np.int64)  # of the rays (n,)
        f = beam.frequencies_mhz
        some = np.linspace(f[0], f[-1], FREQUENCIES)
        k, size = probe.line.wavenumber_per_mm(some), probe.aperture_radius_mm
        fields = np.array(
            [
                np.exp(1j * k * depth) * disc_field(size, probe.line_length_mm + depth, radii, k)
                for depth in DEPTHS_MM
            ]
        )
        share = ((fields / fields[0]) ** 2).reshape(-1, FREQUENCIES)
        between = [
            np.interp(f, some, row.real) + 1j * np.interp(f, some, row.imag) for row in share
        ]
        self._table: Complexes = np.array(between).reshape(len(DEPTHS_MM), len(radii), len(f))

    def at(self, bone_mm: Floats, speed_mm_per_us: float) -> Complexes:
        """Return the factors (n, rings, f) behind ways (n,) through bone of a speed."""
        depth = np.clip(bone_mm * speed_mm_per_us / self._line_mm_per_us, 0.0, DEPTHS_MM[-1])
        place = depth / DEPTHS_MM[1]
        low = np.minimum(place.astype(np.int64), len(DEPTHS_MM) - 2)
        share = (place - low)[:, None, None]
        return (1.0 - share) * self._table[low] + share * self._table[low + 1]
