"""The tilt that halves the echo, against the disc integrated point by point."""

import numpy as np
import pytest

from rona_core.ultrasound.probe.beam import GEL_MM_PER_US, half_echo_tilt_deg
from rona_core.ultrasound.probe.probe_model import PROBES


@pytest.mark.parametrize("name", sorted(PROBES))
def test_half_of_a_plane_wave_is_left_on_the_disc(name):
    probe = PROBES[name]
    slope = np.sin(2.0 * np.deg2rad(half_echo_tilt_deg(probe)))
    x = np.linspace(-1.0, 1.0, 20_001) * probe.aperture_radius_mm
    width = np.sqrt(np.maximum(probe.aperture_radius_mm**2 - x**2, 0.0))
    phase = np.exp(2j * np.pi * probe.centre_mhz / GEL_MM_PER_US * slope * x)
    assert abs((width * phase).sum()) / width.sum() == pytest.approx(0.5, abs=1e-4)


def test_the_default_probe_loses_half_at_two_degrees():
    assert half_echo_tilt_deg(PROBES["2.25MHz"]) == pytest.approx(2.1, abs=0.05)
