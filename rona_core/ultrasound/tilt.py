"""How far a probe may lean on the bone before half of its echo is lost."""

import numpy as np

from rona_core.ultrasound.probe import ProbeModel

HALF = 2.21509  # 2 J1(x) / x = 1/2: the echo of a plane, seen by a disc, is half as high
GEL_MM_PER_US = 1.5


def half_echo_tilt_deg(probe: ProbeModel) -> float:
    """Return the tilt of a flat bone at which the front echo falls to half its height, degrees.

    A disc of radius a receives a plane wave that comes back at twice the tilt; its mean over the
    disc is 2 J1(x) / x with x = k a sin(2 tilt).
    """
    wavenumber_per_mm = 2.0 * np.pi * probe.centre_mhz / GEL_MM_PER_US
    sine = min(HALF / (wavenumber_per_mm * probe.aperture_radius_mm), 1.0)
    return float(np.rad2deg(0.5 * np.arcsin(sine)))
