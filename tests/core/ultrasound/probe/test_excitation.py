import numpy as np
import pytest
from scipy.signal import windows

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.excitation import (
    CHIRP_TAPER,
    GRID,
    chirp,
    emission_spectrum,
    grid_frequencies_mhz,
    transducer_response,
)
from rona_core.ultrasound.probe.probe_model import PROBES, probe_model

BOTH = pytest.mark.parametrize("name", list(PROBES))


def test_an_unknown_probe_is_refused_by_name():
    with pytest.raises(InvalidInputError, match="5MHz"):
        probe_model("5MHz")


@BOTH
def test_the_second_line_echo_falls_behind_the_thickest_bone(name):
    probe = probe_model(name)
    latest = probe.line_delay_us + 2 * probe.compliance_mm / 1.5 + 2 * probe.max_thickness_mm / 2.3
    assert 2 * probe.line_delay_us > latest
    assert probe.chirp_length_us < probe.start_us


@BOTH
def test_the_band_of_the_transducer_is_as_stated(name):
    probe = probe_model(name)
    f = np.linspace(0.2, 1.9, 4000) * probe.centre_mhz
    level = np.abs(transducer_response(probe, f))
    heard = f[level > level.max() / 2]
    assert (heard[-1] - heard[0]) / probe.centre_mhz == pytest.approx(probe.bandwidth, abs=0.02)


@BOTH
def test_the_pulse_begins_with_the_emission_and_has_a_second_lobe(name):
    probe = probe_model(name)
    pulse = np.fft.irfft(emission_spectrum(probe, "pulse"), GRID)
    t = np.arange(GRID) / probe.sampling_mhz
    early = np.abs(pulse[GRID // 2 :])  # negative times
    assert early.max() < 0.02 * np.abs(pulse).max()
    cycles = t[np.argmax(np.abs(pulse))] * probe.centre_mhz
    assert 0.5 < cycles < 3.0
    late = np.abs(pulse[(t * probe.centre_mhz > 4.0) & (t < GRID / 100)]).max()
    assert 0.02 < late / np.abs(pulse).max() < 0.3


@BOTH
def test_a_chirp_carries_much_more_energy_at_the_same_amplitude(name):
    probe = probe_model(name)
    sent = chirp(probe)
    assert np.abs(sent).max() <= 1.0
    echoes = [np.fft.irfft(emission_spectrum(probe, kind), GRID) for kind in ("pulse", "chirp")]
    energies = [np.sum((e / np.abs(e).max()) ** 2) for e in echoes]
    assert 10 * np.log10(energies[1] / energies[0]) > 6.0


@BOTH
def test_the_chirp_sweeps_its_band(name):
    probe = probe_model(name)
    power = np.abs(np.fft.rfft(chirp(probe), GRID)) ** 2
    f = grid_frequencies_mhz(probe)
    share = np.cumsum(power) / power.sum()
    low, high = np.interp((0.05, 0.95), share, f)
    middle, half = probe.centre_mhz, probe.chirp_band_mhz / 2
    assert (low + high) / 2 == pytest.approx(middle, rel=0.03)
    assert 0.6 * half < (high - low) / 2 < half


@BOTH
def test_the_chirp_is_tapered_by_the_window_of_tukey(name):
    probe = probe_model(name)
    sent = chirp(probe)
    t = np.arange(len(sent)) / probe.sampling_mhz
    band, middle = probe.chirp_band_mhz, probe.centre_mhz
    cycles = (middle - band / 2) * t + band / probe.chirp_length_us * t**2 / 2
    wanted = np.sin(2 * np.pi * cycles) * windows.tukey(len(sent), CHIRP_TAPER)
    np.testing.assert_allclose(sent, wanted, rtol=0, atol=1e-12)


def test_an_unknown_excitation_is_refused():
    with pytest.raises(InvalidInputError, match="noise"):
        emission_spectrum(probe_model("1MHz"), "noise")
