"""The delay line and crystal of the virtual probe as they really are: warm, strained and aged."""

from dataclasses import replace

import numpy as np

from rona_core.devices.settings import ROOM_C
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import ProbeModel
from rona_core.virtual.world.world import World

SPEED_PER_K = -0.0025  # mm/us: rubber slows down as it warms
LOSS_PER_K = -0.012  # and loses less, as a share of its loss
LINE_N_PER_MM = 2.0  # stiffness: 12 mm wide, 15 mm long, about 0.25 MPa
SHEAR_N_PER_MM = 0.6  # likewise, sideways
WARMING_S = 60.0  # over which the line warms on the head, from the beginning of a capture


class TrueLine:
    """A delay line during one capture.

    Attributes:
        probe: The probe at the beginning: its stated values, its line at its temperature,
            its crystal as old.
        varies: Whether the line's speed changes in the course of the capture, or under pressure.
    """

    def __init__(self, stated: ProbeModel, stated_c: float, world: World) -> None:
        """Begin a capture at the stated temperature and what the world adds to it."""
        self._rise_k = stated_c + world.line_excess_k - ROOM_C
        self._stated, self._drift_k = stated, world.line_drift_k
        self._strain_share = world.line_strain_share
        self.probe = replace(
            stated,
            line=warmed(stated.line, self._rise_k),
            centre_mhz=stated.centre_mhz * (1.0 - world.pulse_loss),
        )
        self.varies = bool(self._drift_k or self._strain_share)

    def late_us(self, times_s: Floats, pressed_mm: Floats) -> Floats:
        """Return by how much later than through ``probe`` echoes of the face arrive (n,).

        Args:
            times_s: Since the beginning of the capture (n,).
            pressed_mm: By which the line is compressed (n,).
        """
        length = self._stated.line_length_mm
        warming_k = self._drift_k * (1.0 - np.exp(-times_s / WARMING_S))
        strain = np.clip(pressed_mm / length, 0.0, None)
        before = self.probe.line.speed_mm_per_us
        speed = (before + SPEED_PER_K * warming_k) * (1.0 + self._strain_share * strain)
        return 2.0 * (length - pressed_mm) * (1.0 / speed - 1.0 / before)


def warmed(line: Material, rise_k: float) -> Material:
    """Return a delay line by so much warmer than the room."""
    return replace(
        line,
        speed_mm_per_us=line.speed_mm_per_us + SPEED_PER_K * rise_k,
        attenuation_db_per_cm=line.attenuation_db_per_cm * (1.0 + LOSS_PER_K * rise_k),
    )
