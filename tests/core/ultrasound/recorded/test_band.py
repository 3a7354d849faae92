"""What is made of lines by their band: noise told by their envelopes."""

import numpy as np
import pytest

from rona_core.ultrasound.recorded.band import Band, analytic, noise_rms

RATE_MHZ = 50.0
BAND = Band(2.25, 1.2)


def noise(rms, n=6, samples=6000):
    """Return analytic lines of noise that has this rms within the band."""
    z = analytic(np.random.default_rng(3).normal(size=(n, samples)), RATE_MHZ, BAND)
    return rms * z / z.real.std(axis=1)[:, None]


def test_noise_is_told_by_its_envelope_echoes_or_not():
    z = noise(0.02)
    assert noise_rms(np.abs(z)) == pytest.approx(np.full(6, 0.02), rel=0.1)
    z[:, 4000:4300] += 1.0
    assert noise_rms(np.abs(z)) == pytest.approx(np.full(6, 0.02), rel=0.15)


def test_where_echoes_fill_a_line_noise_is_told_before_the_front():
    z = noise(0.02)
    z[:, 1000:] += 1.0
    assert np.all(noise_rms(np.abs(z)) > 0.5)
    length = BAND.length_us * RATE_MHZ
    assert noise_rms(np.abs(z), 1000, length) == pytest.approx(np.full(6, 0.02), rel=0.15)
    # what is too short before it tells nothing
    assert np.all(noise_rms(np.abs(z), round(7.0 * length), length) > 0.5)
