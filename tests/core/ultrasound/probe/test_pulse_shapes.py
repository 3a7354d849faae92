from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from rona_core.devices.settings import PulseShape
from rona_core.ultrasound.probe.excitation import GRID, PULSES, Pulse, emission_spectrum
from rona_core.ultrasound.probe.probe_model import PROBES

SHAPES = pytest.mark.parametrize("shape", get_args(PulseShape))


def pulse(name, shape):
    probe = replace(PROBES[name], pulse_shape=shape)
    analytic = np.zeros(GRID, dtype=complex)
    analytic[: GRID // 2 + 1] = emission_spectrum(probe, "pulse")
    return np.abs(np.fft.ifft(analytic)), np.arange(GRID) / probe.sampling_mhz * probe.centre_mhz


def test_every_name_has_a_shape():
    assert set(PULSES) == set(get_args(PulseShape))


@SHAPES
def test_the_band_is_one_wide_at_half_the_height(shape):
    offsets = np.linspace(-3.0, 3.0, 60001)
    level = np.abs(PULSES[shape].resonance(offsets))
    loud = offsets[level >= level.max() / 2]
    assert loud[-1] - loud[0] == pytest.approx(1.0, abs=1e-3)
    assert PULSES[shape].resonance(np.zeros(1))[0] == pytest.approx(1.0)


def test_one_resonance_of_order_six_is_the_closed_form():
    x = np.linspace(-2.0, 2.0, 101)
    half = 0.5 / np.sqrt(4.0 ** (1.0 / 6) - 1.0)
    np.testing.assert_allclose(
        Pulse(((0.0, 6),), ()).resonance(x), (1.0 + 1j * x / half) ** -6, atol=1e-9
    )


@SHAPES
@pytest.mark.parametrize("name", list(PROBES))
def test_every_pulse_is_causal_and_has_a_later_lobe(name, shape):
    envelope, cycles = pulse(name, shape)
    before = envelope[GRID // 2 :].max()  # negative times
    assert before < 0.02 * envelope.max()
    first = cycles[np.argmax(envelope)]
    late = (cycles > first + 1.8) & (cycles < 12.0)
    assert envelope[late].max() > 0.02 * envelope.max()
    gone = (cycles > 14.0) & (cycles < cycles[GRID // 2])
    assert envelope[gone].max() < 0.02 * envelope.max()


def test_the_shapes_are_not_each_other():
    probes = [replace(PROBES["2.25MHz"], pulse_shape=shape) for shape in PULSES]
    found = [np.fft.irfft(emission_spectrum(probe, "pulse"), GRID) for probe in probes]
    found = [one / np.linalg.norm(one) for one in found]
    for i, one in enumerate(found):
        for other in found[:i]:
            lags = np.fft.irfft(np.fft.rfft(one) * np.conj(np.fft.rfft(other)))
            assert np.abs(lags).max() < 0.985
